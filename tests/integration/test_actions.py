"""The actions process with the real MAVSDK, the simulated vehicle and the hub; only the flight process is imitated.

The vehicle has two links: one to MAVSDK, one to the test, which sees for itself what the vehicle does.
"""

from __future__ import annotations

import queue
import socket
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.bus import Bus, Topic, decode_event, open_client
from gcs.records import ActionRequest, Event
from gcs.runtime import Runtime
from tests.station_rig import (
    ImitatedFlight,
    running,
    runtime_folder,
    start_process,
    stop_process,
    tick_frame,
    wait_until,
)

SPEED = "4"


@dataclass
class Watcher:
    """A second receiver of the vehicle's telemetry."""

    socket: socket.socket
    parser: mavlink.MAVLink = field(default_factory=lambda: mavlink.MAVLink(None))
    armed: bool = False
    height_m: float = 0.0

    def update(self) -> None:
        for message in self.parser.parse_buffer(self.socket.recv(65536)) or []:
            if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            elif message.get_type() == "GLOBAL_POSITION_INT":
                self.height_m = message.relative_alt / 1000.0

    def wait(self, condition: Callable[[], bool]) -> None:
        for _ in range(20_000):
            if condition():
                return
            self.update()
        raise AssertionError(f"armed {self.armed}, height {self.height_m} m")


@dataclass
class Stage:
    """Everything a test of actions needs."""

    runtime: Runtime
    flight: ImitatedFlight
    events: queue.Queue[bytes]
    watcher: Watcher
    links: tuple[str, ...]
    vehicle: subprocess.Popen[str]
    sequence: int = 0

    def do(self, action: str, height_m: float = 0.0) -> Event:
        """Ask for an action as the flight process does, and wait for the outcome."""
        self.sequence += 1
        request = ActionRequest(self.sequence, action, "anna", height_m)  # type: ignore[arg-type]
        self.flight.send(tick_frame(self.sequence, actions=(request,)))
        while True:
            event = decode_event(self.events.get(timeout=30))
            if event.source == "actions":
                assert event.who == "anna"
                return event


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start_vehicle(links: tuple[str, ...]) -> subprocess.Popen[str]:
    return start_process("sitl", "--speed", SPEED, *links)


def refused_until_found(stage: Stage) -> None:
    wait_until(lambda: "not found the vehicle yet" not in stage.do("hold").text, timeout_s=30.0)


@pytest.fixture(scope="module")
def stage() -> Iterator[Stage]:
    port = free_udp_port()
    with runtime_folder() as runtime, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20.0)
        own = receiver.getsockname()[1]
        links = ("--link", f"udpout://127.0.0.1:{port}", "--link", f"udpout://127.0.0.1:{own}")
        folder = ("--runtime", str(runtime.folder))
        with running("gcs.hub", *folder), running("gcs.actions", *folder, "--port", str(port)):
            flight = ImitatedFlight(runtime)
            with open_client(runtime.zenoh_socket) as bus:
                stage = Stage(runtime, flight, _events(bus), Watcher(receiver), links, start_vehicle(links))
                try:
                    yield stage
                finally:
                    stop_process(stage.vehicle)
            flight.close()


def _events(bus: Bus) -> queue.Queue[bytes]:
    events: queue.Queue[bytes] = queue.Queue()
    bus.subscribe(Topic.EVENT, events.put)
    bus.backlog()
    return events


def test_take_off_hold_and_land(stage: Stage) -> None:
    refused_until_found(stage)
    assert stage.do("take_off", 3.0).text == "Taking off to 3.0 m."
    stage.watcher.wait(lambda: stage.watcher.armed and stage.watcher.height_m > 2.5)

    refused = stage.do("disarm")
    assert refused.level == "caution"
    assert refused.text.startswith("Disarm refused: ")
    assert '"' in refused.text, "the vehicle's own words are in the reason"

    assert stage.do("hold").text == "Holding."
    assert stage.do("land").text == "Landing."
    stage.watcher.wait(lambda: not stage.watcher.armed and stage.watcher.height_m < 0.3)


def test_arm_and_disarm_on_the_ground(stage: Stage) -> None:
    refused_until_found(stage)
    assert (stage.do("arm").level, stage.do("disarm").text) == ("advisory", "Disarmed.")


def test_the_vehicle_may_come_back(stage: Stage) -> None:
    refused_until_found(stage)
    stop_process(stage.vehicle)
    wait_until(lambda: stage.do("arm").text == "Arm refused: no vehicle is connected.", timeout_s=30.0)
    stage.vehicle = start_vehicle(stage.links)
    wait_until(lambda: stage.do("arm").text == "Armed.", timeout_s=30.0)


def test_a_port_in_use_is_said(stage: Stage, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        command = ("--runtime", str(stage.runtime.folder), "--port", str(holder.getsockname()[1]))
        with pytest.raises(AssertionError, match="ended with 2"):
            start_process("gcs.actions", *command)
