"""Fly the circle of the quadrotor paper in lockstep, with LQR and then PI cascade, and print how well each tracks.

    python examples/fly_circle.py [--wind N,E,D] [--seed N]

The station and the simulated vehicle exchange real MAVLink bytes; vehicle time runs as fast as the machine allows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gcs import commands as c
from gcs.offboard.configure import read_offboard_config
from gcs.offboard.lockstep import LockstepFlight
from gcs.offboard.modes import State
from gcs.offboard.station import Station
from gcs.offboard.trajectories import Circle
from gcs.records import TickFrame
from gcs.signals import SLICES
from sitl.simulation import Simulation, SimulationConfig
from sitl.wind import Wind

VEHICLE = Path(__file__).parents[1] / "gcs" / "vehicles" / "sim_quadrotor.toml"
WHO = c.Identity(name="script", role="operator", client="fly_circle")
LAP_S = 4.0 * np.pi


class SimulatedVehicle:
    """The simulated vehicle as the lockstep driver sees it."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def advance(self, until_us: int) -> list[bytes]:
        return [packet.data for packet in self._simulation.advance(until_us)]

    def send(self, packet: bytes) -> None:
        self._simulation.receive(0, packet)


def order(flight: LockstepFlight, command: c.AnyCommand) -> None:
    """Give a command; a refusal ends the script with its reason."""
    answer = flight.command(command, WHO)
    if not answer.accepted:
        raise SystemExit(f"{type(command).__name__} refused: {answer.reason}")


def fly(flight: LockstepFlight, duration_s: float) -> None:
    """Fly on and keep the controls: a holder silent for five seconds loses them."""
    end_s = flight.time_s + duration_s
    while flight.time_s < end_s:
        flight.run(min(2.0, end_s - flight.time_s))
        order(flight, c.KeepControls())


def tracking_rms_m(frames: list[TickFrame]) -> float:
    """Root mean square of estimate against reference, 3-D [m]."""
    values = np.array([np.frombuffer(frame.signals) for frame in frames])
    error = values[:, SLICES["estimate.position_ned"]] - values[:, SLICES["reference.position_ned"]]
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wind", default="0,0,0", help="mean wind, north,east,down, m/s")
    parser.add_argument("--seed", type=int, default=1, help="seed of all noise")
    options = parser.parse_args()
    north, east, down = (float(part) for part in options.wind.split(","))
    config = SimulationConfig(seed=options.seed, position="mocap", wind=Wind((north, east, down)))
    frames: list[TickFrame] = []
    station = Station(read_offboard_config(VEHICLE), 0.0, clock_rate=1.0)
    flight = LockstepFlight(station, SimulatedVehicle(Simulation(config)), record=frames.append)

    flight.run(8.0)
    order(flight, c.TakeControls())
    order(flight, c.TakeOff(2.5))
    fly(flight, 7.0)
    order(flight, c.StartOffboard())
    flight.run_until(lambda s: s.state.state is State.ACTIVE, 5.0, "offboard")
    order(flight, c.FlyTrajectory(Circle()))
    fly(flight, 8.0)
    for name, kind in (("LQR with integral action", None), ("PI/PID cascade", "pid")):
        if kind == "pid":
            order(flight, c.SelectController("pid"))
            fly(flight, 4.0)
        begin = len(frames)
        fly(flight, LAP_S)
        print(f"{name:26s} circle .8 m, one lap: {100.0 * tracking_rms_m(frames[begin:]):.1f} cm RMS")
    order(flight, c.Land())
    flight.run_until(lambda s: not s.state.view.armed, 20.0, "landed")
    print(f"landed after {flight.time_s:.0f} s of vehicle time")


if __name__ == "__main__":
    main()
