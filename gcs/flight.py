"""The flight process: ``python -m gcs.flight``. One hot thread receives, decodes, ticks and sends. Nothing else.

No disk, no bus, no compiler: frames go to the hub through a local datagram socket that is never waited for.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import selectors
import signal
import socket
import sys
import time
from collections import deque
from pathlib import Path
from types import FrameType

import msgspec

from controllers.gains import values
from gcs.commands import Request
from gcs.config import ConfigError, parameter_file
from gcs.mavlink.endpoints import Endpoint, LinkOpenError, LinkUrlError, open_endpoint
from gcs.offboard.configure import read_offboard_config
from gcs.offboard.modes import State
from gcs.offboard.state import OffboardConfig
from gcs.offboard.station import Station
from gcs.records import FlightMessage, FlightStart, Packet
from gcs.runtime import Runtime, RuntimeFolderError, end_with_parent, open_runtime

# Without an IMU sample for this long (vehicle time) a tick runs all the same, so that timeouts act.
WATCHDOG_S = 0.05
SHORTEST_WATCHDOG_S = 0.005
STATUS_PERIOD_S = 0.2
START_PERIOD_S = 5.0
FRAMES_KEPT = 4000
DATAGRAM_BYTES = 1 << 18
SEND_BUFFER_BYTES = 1 << 22
PRIORITY = 20
SWITCH_INTERVAL_S = 5e-4
TICKS_PER_OLDER_COLLECTION = 100


class FrameSender:
    """Frames to the hub, in order, never waiting: what the socket cannot take is kept; the oldest are lost, counted."""

    def __init__(self, path: Path) -> None:
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._waiting: deque[bytes] = deque()
        self._encoder = msgspec.msgpack.Encoder()
        self.dropped = 0

    def send(self, message: FlightMessage) -> None:
        """Queue a message and send as much as the socket takes."""
        if len(self._waiting) >= FRAMES_KEPT:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(self._encoder.encode(message))
        while self._waiting:
            try:
                self._socket.sendto(self._waiting[0], self._path)
            except OSError:
                return  # full, or no hub: it is tried again with the next frame
            self._waiting.popleft()


class Flight:
    """The loop around the station: vehicle link, request socket, and the way for MAVSDK of the actions process."""

    def __init__(
        self, station: Station, endpoint: Endpoint, runtime: Runtime, *, start: FlightStart, router_port: int | None
    ) -> None:
        self.station = station
        self.start = start
        self.endpoint = endpoint
        self.sender = FrameSender(runtime.flight_socket)
        self.requests = _bind_requests(runtime.command_socket)
        self.router = _connect_router(router_port)
        self._decoder = msgspec.msgpack.Decoder(Request)
        self._passed: list[Packet] = []
        self._stop = False
        self._ticked_s = time.monotonic()
        self._status_due_s = 0.0
        self._start_due_s = 0.0

    def stop(self, _signal: int, _frame: FrameType | None) -> None:
        """Ask the loop to end; a vehicle we steer is told to hold first."""
        self._stop = True

    def run(self) -> None:
        """Run until stopped."""
        with selectors.DefaultSelector() as selector:
            selector.register(self.requests, selectors.EVENT_READ, self._take_requests)
            if self.router is not None:
                selector.register(self.router, selectors.EVENT_READ, self._take_routed)
            generation = self._watch_endpoint(selector, None)
            while not self._stop:
                rate = max(self.station.link.clock.rate, 1e-3)
                watchdog_s = max(SHORTEST_WATCHDOG_S, min(WATCHDOG_S, WATCHDOG_S / rate))
                for key, _ in selector.select(watchdog_s):
                    key.data()
                now_s = time.monotonic()
                if self.station.due or now_s - self._ticked_s >= watchdog_s:
                    self._tick()
                    self._collect()
                self.endpoint.poll(now_s)
                if self.endpoint.generation != generation:
                    generation = self._watch_endpoint(selector, selector)
        self._leave()

    def _watch_endpoint(self, selector: selectors.BaseSelector, again: selectors.BaseSelector | None) -> int:
        """Register the endpoint's descriptor, which changes when a connection is lost or made."""
        if again is not None:
            for key in [k for k in selector.get_map().values() if k.data == self._take_packets]:
                selector.unregister(key.fileobj)
        if self.endpoint.fileno() >= 0:
            selector.register(self.endpoint.fileno(), selectors.EVENT_READ, self._take_packets)
        return self.endpoint.generation

    def _take_packets(self) -> None:
        for data in self.endpoint.receive():
            self.station.receive(data, time.monotonic())
            if self.router is not None:
                # Nobody listens on the router port, or it is full: telemetry there is not ours to keep.
                with contextlib.suppress(OSError):
                    self.router.send(data)

    def _take_routed(self) -> None:
        assert self.router is not None
        while True:
            try:
                data = self.router.recv(DATAGRAM_BYTES)
            except OSError:
                return
            self.endpoint.send(data)
            self._passed.append(Packet(int(time.time() * 1e6), False, data))

    def _take_requests(self) -> None:
        while True:
            try:
                data = self.requests.recv(DATAGRAM_BYTES)
            except OSError:
                return
            try:
                self.station.submit(self._decoder.decode(data))
            except msgspec.MsgspecError as error:
                print(f"flight: request refused, not readable: {error}", file=sys.stderr)

    def _tick(self) -> None:
        started_ns = time.perf_counter_ns()
        now_s = time.monotonic()
        turnout = self.station.tick(now_s)
        for packet in turnout.packets:
            self.endpoint.send(packet)
        duration_s = (time.perf_counter_ns() - started_ns) * 1e-9
        self._ticked_s = now_s
        utc_s = time.time()
        frame = self.station.frame(turnout, utc_s, duration_s)
        if self._passed:
            frame = msgspec.structs.replace(frame, packets=(*frame.packets, *self._passed))
            self._passed = []
        if now_s >= self._start_due_s:
            self._start_due_s = now_s + START_PERIOD_S
            self.sender.send(self.start)
        self.sender.send(frame)
        if now_s >= self._status_due_s or frame.events or frame.answers:
            self._status_due_s = now_s + STATUS_PERIOD_S
            self.sender.send(
                self.station.status(now_s, utc_s, link_url=self.endpoint.url.text, dropped_frames=self.sender.dropped)
            )

    def _collect(self) -> None:
        """Collect garbage between two ticks, so that it never happens within one."""
        gc.collect(1 if self.station.ticks % TICKS_PER_OLDER_COLLECTION == 0 else 0)

    def _leave(self) -> None:
        """Leave the vehicle safe: one we steer is told to hold."""
        if self.station.state.state in (State.STREAMING, State.ACTIVE):
            for packet in self.station.hold_packets():
                self.endpoint.send(packet)
        self.endpoint.close()
        self.requests.close()


def _bind_requests(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    requests = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    requests.setblocking(False)
    requests.bind(str(path))
    return requests


def _connect_router(port: int | None) -> socket.socket | None:
    if port is None:
        return None
    router = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    router.setblocking(False)
    router.connect(("127.0.0.1", port))
    return router


def prefer_realtime() -> str:
    """Ask for SCHED_FIFO and a short switch interval; returns what came of it, for the log."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if not hasattr(os, "sched_setscheduler"):
        return "no real-time scheduling on this system"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return "no real-time scheduling: allow it with 'ulimit -r 20' or CAP_SYS_NICE"
    return f"SCHED_FIFO priority {PRIORITY}"


def flight_start(vehicle_path: Path, config: OffboardConfig, link_url: str, utc_s: float) -> FlightStart:
    """What this life of the flight process starts from, for the recorder."""
    return FlightStart(
        session=f"{os.getpid()}-{int(utc_s * 1e3)}",
        utc_s=utc_s,
        vehicle_name=config.vehicle.name,
        vehicle_toml=vehicle_path.read_text(encoding="utf-8"),
        parameters_toml=parameter_file(config.vehicle, vehicle_path).read_text(encoding="utf-8"),
        link_url=link_url,
        settings={f"{kind} {name}": values(gain_set) for (kind, name), gain_set in config.gain_sets.items()},
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m gcs.flight", description=__doc__)
    parser.add_argument("--vehicle", type=Path, required=True, help="vehicle file (TOML)")
    parser.add_argument("--link", help="link URL instead of the vehicle file's")
    parser.add_argument("--runtime", type=Path, help="runtime folder (0700)")
    parser.add_argument("--router-port", type=int, help="loopback UDP port of MAVSDK in the actions process")
    return parser.parse_args()


def main() -> int:
    """Start the flight process; returns the exit status, 2 for a configuration or link that cannot be used."""
    arguments = _arguments()
    end_with_parent()
    try:
        runtime = open_runtime(arguments.runtime)
        config = read_offboard_config(arguments.vehicle)
        endpoint = open_endpoint(arguments.link or config.vehicle.link)
    except (ConfigError, RuntimeFolderError, LinkUrlError, LinkOpenError) as error:
        print(f"flight: {error}", file=sys.stderr)
        return 2
    utc_s = time.time()
    start = flight_start(arguments.vehicle, config, endpoint.url.text, utc_s)
    station = Station(config, utc_s, session=start.session)
    flight = Flight(station, endpoint, runtime, start=start, router_port=arguments.router_port)
    signal.signal(signal.SIGTERM, flight.stop)
    signal.signal(signal.SIGINT, flight.stop)
    print(f"flight: {endpoint.url.text}, {prefer_realtime()}", flush=True)
    gc.collect()
    gc.freeze()
    gc.disable()  # the loop collects after each tick, when nothing waits
    flight.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
