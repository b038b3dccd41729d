"""``gcs up`` with everything real: simulation, flight, hub, actions and web, started, killed, and stopped."""

from __future__ import annotations

import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from gcs.bus import Bus, Topic, decode_event, decode_recording, open_client
from gcs.commands import Identity, MarkEvent, TakeControls
from gcs.recording import RunInfo, list_runs, read_run
from gcs.recording_inputs import read_inputs
from gcs.runtime import Runtime
from tests.station_rig import ROOT, runtime_folder, wait_until

if sys.platform != "linux":
    pytest.skip("looks at /proc", allow_module_level=True)

START_TIMEOUT_S = 90.0
ME = Identity("anna", "operator", "test")


@dataclass
class Station:
    """A running ``gcs up`` and what it prints."""

    process: subprocess.Popen[str]
    runtime: Runtime
    runs: Path
    port: int
    lines: queue.Queue[str]

    def wait_for(self, pattern: str) -> str:
        """The next line that matches."""
        deadline = time.monotonic() + START_TIMEOUT_S
        while True:
            line = self.lines.get(timeout=max(0.1, deadline - time.monotonic()))
            if re.search(pattern, line):
                return line

    def children(self) -> dict[str, int]:
        """Process ids of the station by module."""
        found = {}
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                words = (entry / "cmdline").read_bytes().decode().split("\0")
                state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
            except OSError:
                continue
            if words[1:3] == ["-m", "gcs.child"] and words[3] == str(self.process.pid) and state != "Z":
                found[words[4]] = int(entry.name)
        return found

    def info(self) -> RunInfo:
        """The newest run."""
        return list_runs(self.runs)[-1][1]


def free_tcp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start(runtime: Runtime, runs: Path, *arguments: str, port: int) -> Station:
    command = [sys.executable, "-m", "gcs.cli", "up", "--sim", "quadrotor", "--no-browser", "--port", str(port)]
    process = subprocess.Popen(
        [*command, "--runtime", str(runtime.folder), "--runs", str(runs), *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    lines: queue.Queue[str] = queue.Queue()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            lines.put(line.rstrip())

    threading.Thread(target=read, daemon=True).start()
    return Station(process, runtime, runs, port, lines)


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """One station for the tests of this file, in their order; the last of them stops it."""
    with runtime_folder() as runtime:
        started = start(runtime, tmp_path_factory.mktemp("runs"), "--seed", "5", port=free_tcp_port())
        try:
            yield started
        finally:
            if started.process.poll() is None:
                started.process.kill()
                started.process.wait()


@pytest.fixture
def bus(station: Station) -> Iterator[Bus]:
    with open_client(station.runtime.zenoh_socket, START_TIMEOUT_S) as client:
        yield client


def test_it_prints_a_link_that_leads_to_the_dashboard(station: Station, bus: Bus) -> None:
    link = station.wait_for(r"http://127\.0\.0\.1:\d+/login\?token=").strip()
    page = httpx.get(link)
    assert page.status_code == 200 and "Log in" in page.text
    assert httpx.get(f"http://127.0.0.1:{station.port}/").status_code in (303, 401)
    assert set(station.children()) == {"sitl", "gcs.hub", "gcs.flight", "gcs.actions", "web"}


def test_the_vehicle_is_connected_and_a_command_is_accepted(bus: Bus) -> None:
    wait_until(lambda: (status := bus.backlog().status) is not None and status.link_state == "live", START_TIMEOUT_S)
    assert bus.command(TakeControls(), ME).accepted
    assert bus.command(MarkEvent("hello"), ME).accepted


def test_a_killed_hub_comes_back_and_costs_at_most_a_second_of_recording(station: Station, bus: Bus) -> None:
    wait_until(lambda: any(station.runs.iterdir()) and station.info().ticks > 50, START_TIMEOUT_S)
    before = station.info().last_sequence
    os.kill(station.children()["gcs.hub"], signal.SIGKILL)
    station.wait_for(r"hub process ended \(killed by SIGKILL\), restart in 0.5 s")
    wait_until(lambda: station.info().last_sequence > before + 300, START_TIMEOUT_S)
    assert len(list_runs(station.runs)) == 1
    info = station.info()
    assert bus.command(MarkEvent("after the hub"), ME, START_TIMEOUT_S).accepted, "an old client is connected again"
    # Those that a killed hub had taken but not written to the disk yet: at most a second at 100 Hz.
    assert info.missing_ticks <= 110


def test_a_killed_web_process_comes_back_with_a_new_link(station: Station) -> None:
    os.kill(station.children()["web"], signal.SIGKILL)
    station.wait_for(r"web process ended \(killed by SIGKILL\)")
    link = station.wait_for(r"http://127\.0\.0\.1:\d+/login\?token=").strip()
    assert httpx.get(link).status_code == 200


def test_a_killed_flight_process_comes_back_into_a_new_run(station: Station) -> None:
    with open_client(station.runtime.zenoh_socket, START_TIMEOUT_S) as bus:
        events: queue.Queue[bytes] = queue.Queue()
        bus.subscribe(Topic.EVENT, events.put)
        recording: queue.Queue[bytes] = queue.Queue()
        bus.subscribe(Topic.RECORDING, recording.put)
        bus.backlog()
        first = station.info().session
        os.kill(station.children()["gcs.flight"], signal.SIGKILL)
        texts = []
        while not any("flight process ended (killed by SIGKILL)" in text for text in texts):
            texts.append(decode_event(events.get(timeout=START_TIMEOUT_S)).text)
        wait_until(lambda: len(list_runs(station.runs)) == 2, START_TIMEOUT_S)
        second = list_runs(station.runs)[-1][0].name
        while (newest := decode_recording(recording.get(timeout=START_TIMEOUT_S))).run != second or newest.ticks < 100:
            pass
        assert newest.state == "recording" and newest.missing_ticks == 0
        assert station.info().session != first
        wait_until(
            lambda: (status := bus.backlog().status) is not None and status.link_state == "live", START_TIMEOUT_S
        )
        status = bus.backlog().status
        assert status is not None and status.state.upper() in ("STANDBY", "DISCONNECTED")


def test_a_second_station_is_refused_and_starts_nothing(station: Station, tmp_path: Path) -> None:
    same_folder = start(station.runtime, tmp_path / "runs", port=free_tcp_port())
    assert same_folder.process.wait(START_TIMEOUT_S) == 2
    same_folder.wait_for(f"a station runs here already .process {station.process.pid}")
    with runtime_folder() as other:
        same_port = start(other, tmp_path / "runs", port=station.port)
        assert same_port.process.wait(START_TIMEOUT_S) == 2
        same_port.wait_for(rf"port {station.port} on 127.0.0.1: Address already in use.*--port {station.port + 1}")
        assert not other.zenoh_socket.exists()
    assert not (tmp_path / "runs").exists()
    assert set(station.children()) == {"sitl", "gcs.hub", "gcs.flight", "gcs.actions", "web"}


def test_ctrl_c_stops_everything_and_closes_the_recording(station: Station) -> None:
    station.process.send_signal(signal.SIGINT)
    assert station.process.wait(60) == 0
    station.wait_for("Station stopped")
    assert station.children() == {}
    (first, first_info), (second, second_info) = list_runs(station.runs)
    assert second_info.ended_utc and second_info.missing_ticks == 0
    assert second_info.station["sim.seed"] == "5"
    sequences = [record.sequence for record in read_inputs(second / "inputs.mpk")]
    assert len(sequences) == second_info.ticks
    assert sequences == list(range(second_info.first_sequence, second_info.last_sequence + 1))
    assert (first / "signals-2.mcap").exists()
    assert read_run(first) == first_info
    assert not station.runtime.login_url.exists()


def test_a_process_that_refuses_its_configuration_stops_the_start(tmp_path: Path) -> None:
    with runtime_folder() as runtime:
        station = start(runtime, tmp_path, "--wind", "99,0,0", port=free_tcp_port())
        assert station.process.wait(START_TIMEOUT_S) == 2
        station.wait_for("gcs: .*'99,0,0' is not a wind of at most")
        assert station.children() == {}


def test_nothing_is_left_when_the_supervisor_is_killed(tmp_path: Path) -> None:
    with runtime_folder() as runtime:
        station = start(runtime, tmp_path, port=free_tcp_port())
        station.wait_for("login")
        assert len(station.children()) == 5
        station.process.kill()
        station.process.wait()
        wait_until(lambda: station.children() == {}, 30.0)
