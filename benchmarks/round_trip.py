"""Packet in to setpoint out over real UDP, beside a bare UDP echo and a MAVSDK offboard loop that does no work.

A tap stands between the simulated vehicle and the station, stamps each HIGHRES_IMU packet as it passes it on, and
stamps the first setpoint that comes back: the time in between is what the station takes. The echo answers the same.
Rates of 100 and 250 Hz, real time, vehicle in the air in OFFBOARD. Run: python benchmarks/round_trip.py [--seconds S]
Reach: our tick's work p99 <= 1 ms.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs import commands as c
from gcs.records import FlightMessage, TickFrame
from gcs.signals import SLICES

ROOT = Path(__file__).parents[1]
HIGHRES_IMU = 105
SETPOINTS = (82, 139)
ATTITUDE_TARGET, ACTUATOR_TARGET = SETPOINTS
WHO = c.Identity(name="benchmark", role="operator", client="benchmark")
ECHO = """
import socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(("127.0.0.1", int(sys.argv[1])))
while True:
    data, peer = s.recvfrom(2048); s.sendto(data, peer)
"""
MAVSDK_LOOP = """
import asyncio, sys
from mavsdk.asyncio import Mavsdk, Configuration, ComponentType
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import Attitude
async def main():
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    system = await mavsdk.first_autopilot(timeout_s=20)
    telemetry, offboard = TelemetryAsync(system), OffboardAsync(system)
    async for _ in telemetry.subscribe_imu():
        await offboard.set_attitude(Attitude(roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0, thrust_value=0.45))
asyncio.run(main())
"""


class Tap:
    """Vehicle on one socket, station on the other; times each IMU packet to the next setpoint [s]."""

    def __init__(self, station_port: int) -> None:
        self.vehicle_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.vehicle_side.bind(("127.0.0.1", 0))
        self.station_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.station_side.connect(("127.0.0.1", station_port))
        self.vehicle: tuple[str, int] | None = None
        self.latencies_s: list[float] = []
        self.imu_packets = 0
        self._imu_ns = 0
        self.frames: socket.socket | None = None
        self.work_s: list[float] = []
        self._decoder = msgspec.msgpack.Decoder(FlightMessage)
        self._sender = dialect.MAVLink(None, srcSystem=254, srcComponent=190)

    @property
    def port(self) -> int:
        return int(self.vehicle_side.getsockname()[1])

    def command(self, number: int, *parameters: float) -> None:
        """COMMAND_LONG to the vehicle from a station of the tap's own."""
        filled = (*parameters, *([0.0] * (7 - len(parameters))))
        packet = dialect.MAVLink_command_long_message(1, 1, number, 0, *filled).pack(self._sender)
        assert self.vehicle is not None
        self.vehicle_side.sendto(packet, self.vehicle)

    def run(self, seconds: float) -> None:
        """Pass packets both ways."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            sources = [self.vehicle_side, self.station_side, *([self.frames] if self.frames is not None else [])]
            ready, _, _ = select.select(sources, [], [], left_s)
            if self.frames in ready:
                self._take_frame()
            if self.station_side in ready:
                with contextlib.suppress(ConnectionRefusedError):
                    self._from_station(self.station_side.recv(2048))
            if self.vehicle_side in ready:
                data, self.vehicle = self.vehicle_side.recvfrom(2048)
                self._from_vehicle(data)

    def wait_for_vehicle(self) -> None:
        """Until the vehicle has spoken."""
        for _ in range(60):
            self.run(0.5)
            if self.vehicle is not None:
                return
        raise TimeoutError("the simulated vehicle does not speak")

    def _take_frame(self) -> None:
        """The work of a tick, as the flight process reports it."""
        assert self.frames is not None
        message = self._decoder.decode(self.frames.recv(1 << 18))
        if isinstance(message, TickFrame):
            self.work_s.append(float(np.frombuffer(message.signals)[SLICES["tick.duration"]][0]))

    def _from_vehicle(self, data: bytes) -> None:
        if data[7] == HIGHRES_IMU and data[8:10] == b"\0\0":
            self.imu_packets += 1
            self._imu_ns = time.perf_counter_ns()
        with contextlib.suppress(ConnectionRefusedError):
            self.station_side.send(data)

    def _from_station(self, data: bytes) -> None:
        if self._imu_ns and data[7] in (*SETPOINTS, HIGHRES_IMU):
            self.latencies_s.append((time.perf_counter_ns() - self._imu_ns) * 1e-9)
            self._imu_ns = 0
        if self.vehicle is not None and data[7] != HIGHRES_IMU:
            self.vehicle_side.sendto(data, self.vehicle)


@contextlib.contextmanager
def process(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL) as running:
        try:
            yield running
        finally:
            running.terminate()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def airborne(tap: Tap, rate_hz: float) -> None:
    """Ask for the IMU rate, arm, take off; returns in the air."""
    tap.wait_for_vehicle()
    tap.run(5.0)
    tap.command(511, HIGHRES_IMU, 1e6 / rate_hz)
    tap.run(4.0)
    tap.command(400, 1.0)
    tap.run(0.5)
    tap.command(22, *([float("nan")] * 7))
    tap.run(6.0)


def measure(tap: Tap, seconds: float) -> list[float]:
    tap.latencies_s.clear()
    tap.imu_packets = 0
    tap.run(seconds)
    return list(tap.latencies_s)


def vehicle_file(folder: Path, rate_hz: float) -> Path:
    path = folder / "vehicle.toml"
    text = (ROOT / "gcs/vehicles/sim_quadrotor.toml").read_text()
    path.write_text(text.replace("HIGHRES_IMU = 100.0", f"HIGHRES_IMU = {rate_hz:.1f}"))
    return path


def ours(rate_hz: float, seconds: float) -> tuple[list[float], list[float]]:
    """Latencies and the tick's own work [s], flown by the real flight process."""
    port = free_port()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        frames = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        frames.bind(str(folder / "flight.sock"))
        tap = Tap(port)
        tap.frames = frames
        vehicle = str(vehicle_file(folder, rate_hz))
        link, url = f"udpin://127.0.0.1:{port}", f"udpout://127.0.0.1:{tap.port}"
        with (
            process(sys.executable, "-m", "gcs.flight", "--vehicle", vehicle, "--link", link, "--runtime", name),
            process(sys.executable, "-m", "sitl", "--link", url, "--seed", "1"),
        ):
            airborne(tap, rate_hz)
            requests = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            orders: tuple[c.AnyCommand, ...] = (c.TakeControls(), c.StartOffboard())
            for number, command in enumerate(orders):
                request = c.Request(number=number, identity=WHO, command=command, utc_s=time.time())
                requests.sendto(msgspec.msgpack.encode(request), str(folder / "command.sock"))
            tap.run(3.0)
            tap.work_s.clear()
            return measure(tap, seconds), tap.work_s


def echo(rate_hz: float, seconds: float) -> list[float]:
    port = free_port()
    tap = Tap(port)
    url = f"udpout://127.0.0.1:{tap.port}"
    with (
        process(sys.executable, "-c", ECHO, str(port)),
        process(sys.executable, "-m", "sitl", "--link", url, "--seed", "1"),
    ):
        tap.wait_for_vehicle()
        tap.command(511, HIGHRES_IMU, 1e6 / rate_hz)
        return measure(tap, seconds)


def mavsdk(rate_hz: float, seconds: float) -> list[float]:
    port = free_port()
    tap = Tap(port)
    url = f"udpout://127.0.0.1:{tap.port}"
    with (
        process(sys.executable, "-c", MAVSDK_LOOP, str(port)),
        process(sys.executable, "-m", "sitl", "--link", url, "--seed", "1"),
    ):
        airborne(tap, rate_hz)
        return measure(tap, seconds)


def row(name: str, latencies_s: list[float], baseline_s: list[float]) -> str:
    p50, p99 = np.quantile(latencies_s, [0.5, 0.99]) * 1e6
    b50, b99 = np.quantile(baseline_s, [0.5, 0.99]) * 1e6
    numbers = f"p50 {p50:7.0f} us ({p50 / b50:4.1f} x)   p99 {p99:7.0f} us ({p99 / b99:4.1f} x)"
    return f"  {name:28s} {numbers}   n {len(latencies_s)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=15.0)
    seconds = parser.parse_args().seconds
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for rate_hz in (100.0, 250.0):
        bare = echo(rate_hz, seconds)
        station, work = ours(rate_hz, seconds)
        peer = mavsdk(rate_hz, seconds)
        print(f"{rate_hz:.0f} Hz, packet in to setpoint out (ratio to the bare echo)")
        print(row("bare UDP echo", bare, bare))
        print(row("rotorlab, EKF and LQR flying", station, bare))
        print(row("MAVSDK loop, no work", peer, bare))
        p50, p99 = np.quantile(work, [0.5, 0.99]) * 1e6
        print(f"  work of our tick               p50 {p50:7.0f} us            p99 {p99:7.0f} us   n {len(work)}")


if __name__ == "__main__":
    main()
