"""The hub: ``python -m gcs.hub``. Records what the flight process sends, publishes it, and carries commands to it.

Frames arrive on a datagram socket. They are recorded (:mod:`gcs.recorder`), thinned to the bus (:mod:`gcs.bus`), and
kept for pages that open later. Commands come in over the bus and are answered by the flight process within a second, or
refused here with the reason. The hub may die and come back at any time: flight, actions and web go on.
"""

from __future__ import annotations

import argparse
import contextlib
import selectors
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from gcs.bus import ANSWER_TIMEOUT_S, Backlog, Bus, BusError, Topic, decode_event, open_router
from gcs.commands import Answer, Request
from gcs.recorder import Recorder, RecorderOptions
from gcs.records import ActionRequest, Event, FlightMessage, FlightStart, Level, RecordingStatus, Status, TickFrame
from gcs.runtime import Runtime, RuntimeFolderError, end_with_parent, open_runtime
from gcs.signals import FRAME_SIZE

SIGNAL_PERIOD_S = 0.02
STATUS_PERIOD_S = 0.4
RECORDING_PERIOD_S = 1.0
FLIGHT_SILENT_S = 2.0
# Before the first frame the flight process has its kernels to load, on a busy machine slowly.
FLIGHT_START_S = 30.0
BACKLOG_S = 120.0
BACKLOG_FRAMES = 3000
BACKLOG_EVENTS = 500
ACTION_TIMEOUT_S = 60.0
DATAGRAMS_A_TURN = 200
DATAGRAM_BYTES = 1 << 18
RECEIVE_BUFFER_BYTES = 1 << 22
KEEP_GB = 20.0


@dataclass(slots=True)
class _Waiting:
    """A command under way: the asker's number, how to answer it, and until when."""

    number: int
    reply: Callable[[Answer], None]
    deadline_s: float


class CommandDesk:
    """Gives every command a number of its own, passes it to the flight process, and matches the answers."""

    def __init__(self, path: Path) -> None:
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._encoder = msgspec.msgpack.Encoder()
        self._waiting: dict[int, _Waiting] = {}
        self._lock = threading.Lock()
        # A hub that comes back must not reuse the numbers of its predecessor.
        self._next = int(time.time() * 1e3)

    def ask(self, request: Request, reply: Callable[[Answer], None]) -> None:
        """Pass a command on (any thread)."""
        with self._lock:
            number, self._next = self._next, self._next + 1
            self._waiting[number] = _Waiting(request.number, reply, time.monotonic() + ANSWER_TIMEOUT_S)
        try:
            self._socket.sendto(self._encoder.encode(msgspec.structs.replace(request, number=number)), self._path)
        except (FileNotFoundError, ConnectionRefusedError):
            self._refuse(number, "The flight process is not running. It restarts by itself; try again.")
        except BlockingIOError:
            self._refuse(number, "The flight process takes no more commands at the moment. Try again.")

    def answered(self, answer: Answer) -> None:
        """Take an answer of the flight process; one that nobody waits for is dropped."""
        with self._lock:
            waiting = self._waiting.pop(answer.number, None)
        if waiting is not None:
            waiting.reply(msgspec.structs.replace(answer, number=waiting.number))

    def expire(self, now_s: float) -> None:
        """Refuse what has waited too long."""
        with self._lock:
            late = [number for number, waiting in self._waiting.items() if waiting.deadline_s <= now_s]
        for number in late:
            self._refuse(number, f"The flight process does not answer for {ANSWER_TIMEOUT_S:g} s.")

    def _refuse(self, number: int, reason: str) -> None:
        self.answered(Answer(number, False, reason))

    def close(self) -> None:
        self._socket.close()


class Past:
    """The last two minutes of signals, thinned, and the last events, for pages that open later. Any thread."""

    def __init__(self) -> None:
        self._frames: deque[tuple[float, bytes]] = deque(maxlen=BACKLOG_FRAMES)
        self._events: deque[Event] = deque(maxlen=BACKLOG_EVENTS)
        self.status: Status | None = None
        self._lock = threading.Lock()
        self._kept = False

    def add_frame(self, t_s: float, signals: bytes) -> None:
        """Keep every second published frame; a vehicle clock that jumps back empties the past."""
        with self._lock:
            if self._frames and t_s < self._frames[-1][0]:
                self._frames.clear()
            while self._frames and self._frames[0][0] < t_s - BACKLOG_S:
                self._frames.popleft()
            self._kept = not self._kept
            if self._kept:
                self._frames.append((t_s, signals))

    def add_event(self, event: Event) -> None:
        with self._lock:
            self._events.append(event)

    def backlog(self, recording: RecordingStatus) -> Backlog:
        with self._lock:
            frames = b"".join(signals for _, signals in self._frames)
            return Backlog(frames, tuple(self._events), self.status, recording)


class Hub:
    """Everything between the flight socket and the bus. ``run`` works until ``stop``."""

    def __init__(self, runtime: Runtime, options: RecorderOptions | None) -> None:
        self._runtime = runtime
        self._socket = _bind_flight_socket(runtime.flight_socket)
        self._waker, self._wake_end = socket.socketpair()
        self._waker.setblocking(False)
        self._wake_end.setblocking(False)
        self._jobs: deque[Callable[[], None]] = deque()
        self._stopping = False
        self._past = Past()
        self._desk = CommandDesk(runtime.command_socket)
        self._decoder = msgspec.msgpack.Decoder(FlightMessage)
        self._recorder = Recorder(options, self._recorder_event) if options is not None else None
        self._bus: Bus = open_router(runtime.zenoh_socket)
        self._newest: TickFrame | None = None
        self._t_s = float("nan")
        self._heard_s = time.monotonic() + FLIGHT_START_S - FLIGHT_SILENT_S
        self._silent = False
        self._signals_due_s = self._status_due_s = self._recording_due_s = 0.0
        self._bus.serve_commands(self._desk.ask)
        self._bus.serve_backlog(lambda: self._past.backlog(self._recording_status()))
        self._bus.subscribe(Topic.REPORT, self._on_report)

    def stop(self) -> None:
        """End ``run``; callable from a signal handler and from any thread."""
        self._stopping = True
        self._wake()

    def run(self) -> None:
        """Work until stopped."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            selector.register(self._waker, selectors.EVENT_READ)
            while not self._stopping:
                ready = {key.fileobj for key, _ in selector.select(SIGNAL_PERIOD_S)}
                if self._waker in ready:
                    self._waker.recv(4096)
                if self._socket in ready:
                    self._receive()
                while self._jobs:
                    self._jobs.popleft()()
                self._periodic(time.monotonic())
        self._close()

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._wake_end.send(b"x")

    def _later(self, job: Callable[[], None]) -> None:
        """Run ``job`` on the hub's own thread."""
        self._jobs.append(job)
        self._wake()

    def _receive(self) -> None:
        for _ in range(DATAGRAMS_A_TURN):
            try:
                data = self._socket.recv(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            try:
                message = self._decoder.decode(data)
            except msgspec.DecodeError as error:
                self._event("caution", f"Frame of the flight process not understood: {error}. Restart the station.")
                continue
            self._take(message)

    def _take(self, message: FlightMessage) -> None:
        self._heard_s = time.monotonic()
        if self._recorder is not None:
            self._recorder.put(message)
        match message:
            case TickFrame():
                self._tick(message)
            case Status():
                self._past.status = message
                self._publish_status(message, self._heard_s)
            case FlightStart():
                pass

    def _tick(self, frame: TickFrame) -> None:
        self._newest = frame
        self._t_s = frame.t_s
        for answer in frame.answers:
            self._desk.answered(answer)
        for event in frame.events:
            self._past.add_event(event)
            self._bus.publish_event(event)
        for action in frame.actions:
            threading.Thread(target=self._act, args=(action,), name="action", daemon=True).start()
        if time.monotonic() >= self._signals_due_s:
            self._publish_signals()

    def _publish_signals(self) -> None:
        frame, self._newest = self._newest, None
        if frame is None or len(frame.signals) != 8 * FRAME_SIZE:
            return
        self._signals_due_s = time.monotonic() + SIGNAL_PERIOD_S
        self._past.add_frame(frame.t_s, frame.signals)
        self._bus.publish_signals(frame.signals)

    def _publish_status(self, status: Status, now_s: float) -> None:
        self._status_due_s = now_s + STATUS_PERIOD_S
        self._bus.publish_status(status)

    def _periodic(self, now_s: float) -> None:
        self._desk.expire(now_s)
        if self._newest is not None and now_s >= self._signals_due_s:
            self._publish_signals()
        if self._past.status is not None and now_s >= self._status_due_s:
            self._publish_status(self._past.status, now_s)
        if now_s >= self._recording_due_s:
            self._recording_due_s = now_s + RECORDING_PERIOD_S
            self._bus.publish_recording(self._recording_status())
        self._watch_flight(now_s)

    def _watch_flight(self, now_s: float) -> None:
        silence_s = now_s - self._heard_s
        if silence_s > FLIGHT_SILENT_S and not self._silent:
            self._silent = True
            self._event("warning", "Flight process silent. The station sends no setpoints.")
        elif self._silent and silence_s < FLIGHT_SILENT_S:
            self._silent = False
            self._event("advisory", "Flight process is back.")

    def _recording_status(self) -> RecordingStatus:
        return self._recorder.status if self._recorder is not None else RecordingStatus("off")

    def _event(self, level: Level, text: str, *, source: str = "hub", who: str = "") -> None:
        self._take_event(Event(self._t_s, level, text, source, who))

    def _take_event(self, event: Event) -> None:
        self._past.add_event(event)
        self._bus.publish_event(event)
        if self._recorder is not None:
            self._recorder.put((event, time.time()))

    def _recorder_event(self, level: str, text: str) -> None:
        known: Level = "caution" if level == "caution" else "advisory"
        self._later(lambda: self._event(known, text, source="recorder"))

    def _on_report(self, payload: bytes) -> None:
        try:
            event = decode_event(payload)
        except msgspec.DecodeError:
            return
        self._later(lambda: self._take_event(event))

    def _act(self, action: ActionRequest) -> None:
        """Have an action done (own thread, it takes seconds) and tell the outcome."""
        level: Level = "caution"
        try:
            result = self._bus.run_action(action, ACTION_TIMEOUT_S)
        except BusError:
            text = f"{action.action.replace('_', ' ').capitalize()} refused: the actions process does not answer."
        else:
            text = result.text
            level = "advisory" if result.done else "caution"
        self._later(lambda: self._event(level, text, source="actions", who=action.who))

    def _close(self) -> None:
        if self._recorder is not None:
            self._recorder.close()
        self._bus.close()
        self._desk.close()
        for end in (self._socket, self._waker, self._wake_end):
            end.close()
        self._runtime.flight_socket.unlink(missing_ok=True)


def _bind_flight_socket(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    flight = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    flight.setblocking(False)
    flight.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    flight.bind(str(path))
    return flight


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m gcs.hub", description="Recorder and bus of the station.")
    parser.add_argument("--runtime", type=Path, help="runtime folder (0700)")
    parser.add_argument("--runs", type=Path, help="folder for recordings; none is made without it")
    parser.add_argument("--keep-gb", type=float, default=KEEP_GB, help="most that all runs together may take")
    parser.add_argument("--note", action="append", default=[], metavar="KEY=VALUE", help="noted in run.json")
    return parser.parse_args()


def main() -> int:
    """Start the hub; returns the exit status, 2 for a runtime folder or socket that cannot be used."""
    end_with_parent()
    arguments = _arguments()
    station = dict(note.partition("=")[::2] for note in arguments.note)
    options = RecorderOptions(arguments.runs, int(arguments.keep_gb * 1e9), station) if arguments.runs else None
    try:
        hub = Hub(open_runtime(arguments.runtime), options)
    except (RuntimeFolderError, BusError, OSError) as error:
        print(f"hub: {error}", file=sys.stderr)
        return 2
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: hub.stop())
    print("hub: ready", flush=True)
    hub.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
