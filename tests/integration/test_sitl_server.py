"""The simulated vehicle as a process: lockstep with a driver, real time, links, and what it refuses."""

from __future__ import annotations

import itertools
import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

ROOT = Path(__file__).parents[2]


@contextmanager
def vehicle(*options: str) -> Iterator[dict[str, Any]]:
    command = [sys.executable, "-m", "sitl", "--json", *options]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
            assert process.wait(10) == 0


@contextmanager
def station_socket() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        station.bind(("127.0.0.1", 0))
        station.settimeout(10.0)
        yield station


class Driver:
    """Holds the step socket; ``step`` grants and receives exactly the packets announced."""

    def __init__(self, port: int, station: socket.socket) -> None:
        self.tcp = socket.create_connection(("127.0.0.1", port), timeout=20.0)
        self.station = station
        self.vehicle: tuple[str, int] | None = None

    def grant(self, until_us: int) -> tuple[int, int]:
        self.tcp.sendall(struct.pack("<Q", until_us))
        reply = b""
        while len(reply) < 12:
            part = self.tcp.recv(12 - len(reply))
            assert part
            reply += part
        time_us, count = struct.unpack("<QI", reply)
        return time_us, count

    def step(self, until_us: int) -> tuple[int, list[bytes]]:
        time_us, count = self.grant(until_us)
        packets = []
        for _ in range(count):
            data, self.vehicle = self.station.recvfrom(4096)
            packets.append(data)
        return time_us, packets


def command(number: int, *parameters: float) -> bytes:
    full = [*parameters, *[float("nan")] * (7 - len(parameters))]
    return dialect.MAVLink_command_long_message(1, 1, number, 0, *full).pack(dialect.MAVLink(None, 255, 190))


def lockstep_flight(seed: int) -> tuple[bytes, list[Any]]:
    with station_socket() as station:
        url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
        with vehicle(
            "--link", url, "--lockstep", "0", "--seed", str(seed), "--wind", "2,1,0", "--gust", "0.5"
        ) as ready:
            driver = Driver(ready["lockstep_port"], station)
            data = b""
            for k in range(1, 801):
                time_us, packets = driver.step(k * 10_000)
                assert time_us == k * 10_000
                data += b"".join(packets)
                assert driver.vehicle is not None
                if k == 20:
                    station.sendto(command(400, 1, 0), driver.vehicle)
                if k == 40:
                    station.sendto(command(22), driver.vehicle)
            driver.tcp.close()
    return data, dialect.MAVLink(None).parse_buffer(data)


def test_lockstep_flight_is_the_same_bytes_every_time_over_real_sockets():
    first, messages = lockstep_flight(7)
    second, _ = lockstep_flight(7)
    assert first == second
    results = [m.result for m in messages if m.get_type() == "COMMAND_ACK"]
    assert results == [0, 0]
    heights = [-m.z for m in messages if m.get_type() == "LOCAL_POSITION_NED"]
    assert heights[-1] > 1.5


def test_traffic_never_moves_time_and_one_driver_holds_the_step_socket():
    with station_socket() as station:
        url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
        with vehicle("--link", url, "--lockstep", "0") as ready:
            driver = Driver(ready["lockstep_port"], station)
            _, packets = driver.step(100_000)
            assert packets
            for _ in range(50):
                station.sendto(command(512, 148), driver.vehicle)
            # A step that grants nothing new: the answers come, the time stays.
            time_us, packets = driver.step(100_000)
            assert time_us == 100_000
            assert len(packets) == 100
            with socket.create_connection(("127.0.0.1", ready["lockstep_port"]), timeout=10.0) as second:
                assert second.recv(1) == b""
            assert driver.step(50_000)[0] == 100_000
            assert driver.step(110_000)[0] == 110_000
            driver.tcp.close()
            # The driver has gone: another may take over where time stands.
            for _ in range(50):
                again = Driver(ready["lockstep_port"], station)
                try:
                    assert again.step(120_000)[0] == 120_000
                    break
                except (AssertionError, ConnectionError):
                    again.tcp.close()
            else:
                pytest.fail("no second driver was let in")
            again.tcp.close()


def test_real_time_follows_the_clock_at_speed():
    with station_socket() as station:
        with vehicle("--link", f"udpout://127.0.0.1:{station.getsockname()[1]}", "--speed", "5"):
            parser, stamps = dialect.MAVLink(None), []
            while not stamps or stamps[-1][1] - stamps[0][1] < 5_000_000:
                for m in parser.parse_buffer(station.recv(4096)) or []:
                    if m.get_type() == "HIGHRES_IMU":
                        stamps.append((time.monotonic(), m.time_usec))
        # Never ahead of its clock; how far behind depends on what else the machine does.
        (start_s, start_us), (end_s, end_us) = stamps[0], stamps[-1]
        assert (end_us - start_us) * 1e-6 / (end_s - start_s) < 5.5
        assert {b[1] - a[1] for a, b in itertools.pairwise(stamps)} == {10_000}


def test_udpin_answers_whoever_spoke_last_on_each_link():
    with (
        vehicle("--link", "udpin://127.0.0.1:0", "--link", "udpin://127.0.0.1:0") as ready,
        station_socket() as a,
        station_socket() as b,
    ):
        for station, url in ((a, ready["links"][0]), (b, ready["links"][1])):
            port = int(url.rsplit(":", 1)[1])
            station.sendto(command(512, 148), ("127.0.0.1", port))
            parser, seen = dialect.MAVLink(None), set()
            while not {"COMMAND_ACK", "AUTOPILOT_VERSION", "HIGHRES_IMU"} <= seen:
                data, sender = station.recvfrom(4096)
                assert sender[1] == port
                seen |= {m.get_type() for m in parser.parse_buffer(data) or []}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--link", "foo"], "link 'foo' is not udpout://HOST:PORT or udpin://[HOST:]PORT"),
        (["--link", "udpin://127.0.0.1:99999"], "99999"),
        (["--link", "udpout://no.such.host.invalid:14550"], "no.such.host.invalid"),
        (["--wind", "3,1"], "three numbers n,e,d"),
        (["--wind", "30,0,0"], "at most 25 m/s"),
        (["--speed", "0"], "between 0.01 and 1000"),
        (["--position", "radar"], "gnss"),
        (["--seed", "-1"], "whole number"),
        (["--vehicle", "zeppelin"], "quadrotor"),
        (["--lockstep", "0", "--speed", "3"], "not allowed with"),
    ],
)
def test_bad_options_are_named_with_status_two(options, told, capsys):
    from sitl.__main__ import main

    try:
        status = main(options)
    except SystemExit as end:
        status = end.code
    assert status == 2
    assert told in capsys.readouterr().err


def test_port_in_use_says_so(capsys):
    from sitl.__main__ import main

    with station_socket() as taken:
        port = taken.getsockname()[1]
        assert main(["--link", f"udpin://127.0.0.1:{port}"]) == 2
    assert f"udpin://127.0.0.1:{port}" in (told := capsys.readouterr().err)
    assert "another" in told
    with socket.create_server(("127.0.0.1", 0)) as listener:
        assert main(["--link", "udpin://127.0.0.1:0", "--lockstep", str(listener.getsockname()[1])]) == 2
    assert "step port" in capsys.readouterr().err
