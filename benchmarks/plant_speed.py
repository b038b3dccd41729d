"""How fast the simulated quadrotor runs: plant alone, the whole core with telemetry, and the process in lockstep.

Run: python benchmarks/plant_speed.py [--seconds S]. Ratios are vehicle time over wall time, one core, gusts on.
The lockstep figure has a driver that grants 10 ms steps, receives every packet over UDP and answers each step with an
attitude setpoint: what is left of real time for a ground station.
"""

from __future__ import annotations

import argparse
import json
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from models.parameters import load_quadrotor
from sitl import inner_loop
from sitl.simulation import Simulation, SimulationConfig
from sitl.vehicle import ImuConfig, QuadrotorVehicle
from sitl.wind import Wind

STEP_US = 10_000
WIND = Wind((3.0, 1.0, 0.0), 0.8)
ROOT = Path(__file__).parents[1]


def plant_alone(seconds: float) -> float:
    """RK4 plant at 500 Hz with gusts, inner loops and integrating IMU, advanced 10 ms at a time."""
    parameters = load_quadrotor()
    vehicle = QuadrotorVehicle(parameters, WIND, ImuConfig(), np.random.default_rng(1))
    vehicle.command[:] = (inner_loop.ATTITUDE, 1.0, 0.0, 0.0, 0.0, 9.9 * parameters.mass_kg)
    vehicle.advance(5)
    start = time.perf_counter()
    for k in range(2, round(seconds * 100)):
        vehicle.advance(5 * k)
    return seconds / (time.perf_counter() - start)


def core(seconds: float) -> tuple[float, float]:
    """Sensors, firmware and default telemetry too: ratio, and packets per 10 ms."""
    simulation = Simulation(SimulationConfig(seed=1, position="both", wind=WIND))
    simulation.advance(STEP_US)
    packets = 0
    start = time.perf_counter()
    for k in range(2, round(seconds * 100)):
        packets += len(simulation.advance(STEP_US * k))
    return seconds / (time.perf_counter() - start), packets / (seconds * 100)


def lockstep(seconds: float) -> float:
    """The process over real sockets, with a driver that does nothing but answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        station.bind(("127.0.0.1", 0))
        url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
        command = [sys.executable, "-m", "sitl", "--json", "--link", url, "--lockstep", "0", "--position", "mocap"]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            port = json.loads(process.stdout.readline())["lockstep_port"]
            target = dialect.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.4)
            setpoint = target.pack(dialect.MAVLink(None, 255, 190))
            with socket.create_connection(("127.0.0.1", port)) as driver:
                driver.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                start = time.perf_counter()
                for k in range(1, round(seconds * 100) + 1):
                    driver.sendall(struct.pack("<Q", STEP_US * k))
                    _, count = struct.unpack("<QI", driver.recv(12, socket.MSG_WAITALL))
                    for _ in range(count):
                        _, vehicle = station.recvfrom(4096)
                    station.sendto(setpoint, vehicle)
                ratio = seconds / (time.perf_counter() - start)
            process.terminate()
    return ratio


def main() -> None:
    """Print the three figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="vehicle time per figure")
    seconds = parser.parse_args().seconds
    plant = plant_alone(seconds)
    whole, packets = core(seconds)
    stepped = lockstep(seconds)
    print(f"plant alone            {plant:7.0f} x real time  {1e4 / plant:6.1f} us per 10 ms   (wanted >= 500 x)")
    print(f"core with telemetry    {whole:7.0f} x real time  {1e4 / whole:6.1f} us per 10 ms   ({packets:.1f} packets)")
    print(f"process in lockstep    {stepped:7.0f} x real time  {1e4 / stepped:6.1f} us per 10 ms")


if __name__ == "__main__":
    main()
