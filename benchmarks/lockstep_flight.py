"""How much faster than real time a lockstep flight runs: station and vehicle in one process, and over UDP.

Reach: >= 20 x real time. The plant alone is in ``plant_speed.py``. Run: python benchmarks/lockstep_flight.py
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

from gcs import commands as c
from gcs.offboard.configure import read_offboard_config
from gcs.offboard.lockstep import LockstepFlight, SteppedVehicle
from gcs.offboard.modes import State
from gcs.offboard.station import Station
from gcs.offboard.step_socket import SocketVehicle
from gcs.offboard.trajectories import Circle
from sitl.simulation import Simulation, SimulationConfig

ROOT = Path(__file__).parents[1]
WHO = c.Identity(name="benchmark", role="operator", client="benchmark")
FLIGHT_S = 20.0


class InProcess:
    """The simulated vehicle in this process; its packets are bytes all the same."""

    def __init__(self) -> None:
        self.simulation = Simulation(SimulationConfig(seed=1, position="gnss"))

    def advance(self, until_us: int) -> list[bytes]:
        return [packet.data for packet in self.simulation.advance(until_us)]

    def send(self, packet: bytes) -> None:
        self.simulation.receive(0, packet)


def order(flight: LockstepFlight, *commands: c.AnyCommand) -> None:
    """Give commands that have to be accepted."""
    for command in commands:
        answer = flight.command(command, WHO)
        assert answer.accepted, answer.reason


def circle_ratio(vehicle: SteppedVehicle) -> tuple[float, float]:
    """Take off, fly the circle; vehicle seconds per wall second and per processor second of this process."""
    station = Station(read_offboard_config(ROOT / "gcs/vehicles/sim_quadrotor.toml"), 0.0, clock_rate=1.0)
    flight = LockstepFlight(station, vehicle)
    flight.run(8.0)
    order(flight, c.TakeControls(), c.TakeOff(2.5))
    flight.run(7.0)
    order(flight, c.TakeControls(), c.StartOffboard())
    flight.run_until(lambda s: s.state.state is State.ACTIVE, 5.0, "offboard")
    order(flight, c.TakeControls(), c.FlyTrajectory(Circle()))
    wall_s, processor_s, begin_s = time.perf_counter(), time.process_time(), flight.time_s
    flight.run(FLIGHT_S)
    flown_s = flight.time_s - begin_s
    assert station.state.state is State.ACTIVE
    return flown_s / (time.perf_counter() - wall_s), flown_s / (time.process_time() - processor_s)


def over_udp() -> tuple[float, float]:
    """The same flight with the vehicle in its own process."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    url = f"udpout://127.0.0.1:{link.getsockname()[1]}"
    command = [sys.executable, "-m", "sitl", "--link", url, "--lockstep", "0", "--seed", "1", "--json"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            vehicle = SocketVehicle(link, int(json.loads(process.stdout.readline())["lockstep_port"]))
            ratios = circle_ratio(vehicle)
            vehicle.close()
        finally:
            process.terminate()
    return ratios


def main() -> None:
    wall, processor = circle_ratio(InProcess())
    udp_wall, udp_processor = over_udp()
    print(f"lockstep flight, one process   {wall:8.1f} x real time ({processor:.1f} x by processor time)")
    print(f"lockstep flight, over UDP      {udp_wall:8.1f} x real time ({udp_processor:.1f} x by processor time)")


if __name__ == "__main__":
    main()
