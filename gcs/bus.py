"""The station's bus: zenoh topics and queries, typed. One router session in the hub, everyone else a client of it.

The router listens on a unix socket in the runtime folder and nowhere else; there is no scouting. Who may enter the
folder may use the bus.

Topics (newest wins; a receiver that cannot keep up loses samples and holds up nobody)
    signals    one or more frames of :mod:`gcs.signals`, float64 little endian
    status     gcs.records.Status as JSON, at least twice a second
    event      gcs.records.Event as JSON
    recording  gcs.records.RecordingStatus as JSON, once a second
    report     gcs.records.Event as JSON, to the hub, which records it and publishes it as an event
Queries
    command    gcs.commands.Request as JSON -> gcs.commands.Answer as JSON (hub)
    action     gcs.records.ActionRequest as JSON -> gcs.records.ActionResult as JSON (actions process)
    backlog    nothing -> :class:`Backlog` as msgpack (hub)

Callbacks run on a thread of zenoh: they hand over and return.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import msgspec
import zenoh

from gcs.commands import Answer, AnyCommand, Identity, Request
from gcs.records import ActionRequest, ActionResult, Event, RecordingStatus, Status

ANSWER_TIMEOUT_S = 1.0
"""How long the hub waits for the flight process."""

_REQUEST_TIMEOUT_S = 2.0
_BACKLOG_TIMEOUT_S = 3.0
_ROOT = "rotorlab/station/"


class Topic(StrEnum):
    """Key expressions of the station."""

    SIGNALS = _ROOT + "signals"
    STATUS = _ROOT + "status"
    EVENT = _ROOT + "event"
    RECORDING = _ROOT + "recording"
    REPORT = _ROOT + "report"
    COMMAND = _ROOT + "command"
    ACTION = _ROOT + "action"
    BACKLOG = _ROOT + "backlog"


class BusError(Exception):
    """The bus cannot be reached or did not answer; the text says which and what to do."""


class Backlog(msgspec.Struct, frozen=True):
    """What a page that opens now should show at once: frames of the last two minutes, oldest first, and the state."""

    frames: bytes = b""
    events: tuple[Event, ...] = ()
    status: Status | None = None
    recording: RecordingStatus | None = None


_request_decoder = msgspec.json.Decoder(Request)
_answer_decoder = msgspec.json.Decoder(Answer)
_recording_decoder = msgspec.json.Decoder(RecordingStatus)
_action_decoder = msgspec.json.Decoder(ActionRequest)
_result_decoder = msgspec.json.Decoder(ActionResult)
_backlog_decoder = msgspec.msgpack.Decoder(Backlog)

_Record = TypeVar("_Record", Event, Status)


def _decode_numbers(payload: bytes, record: type[_Record]) -> _Record:
    """JSON has no NaN: a null where the record has a plain number is NaN again."""
    table = msgspec.json.decode(payload, type=dict[str, Any])
    for field in msgspec.structs.fields(record):
        if field.type is float and field.name in table and table[field.name] is None:
            table[field.name] = float("nan")
    return msgspec.convert(table, record)


def decode_status(payload: bytes) -> Status:
    """Status from JSON. Raises msgspec.DecodeError."""
    return _decode_numbers(payload, Status)


def decode_event(payload: bytes) -> Event:
    """Event from JSON. Raises msgspec.DecodeError."""
    return _decode_numbers(payload, Event)


def decode_recording(payload: bytes) -> RecordingStatus:
    """State of the recorder from JSON. Raises msgspec.DecodeError."""
    return _recording_decoder.decode(payload)


def _configuration(socket: Path, *, router: bool) -> zenoh.Config:
    endpoint = json.dumps([f"unixsock-stream/{socket}"])
    config = zenoh.Config()
    config.insert_json5("mode", '"router"' if router else '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("listen/endpoints", endpoint if router else "[]")
    if not router:
        config.insert_json5("connect/endpoints", endpoint)
        config.insert_json5("connect/timeout_ms", "500")
    return config


def open_router(socket: Path) -> Bus:
    """Open the station's router (the hub does) on a unix socket. Raises BusError if the socket cannot be used."""
    try:
        return Bus(zenoh.open(_configuration(socket, router=True)))
    except zenoh.ZError as error:
        raise BusError(f"{socket}: cannot open the bus: {error}") from error


def open_client(socket: Path, timeout_s: float = 10.0) -> Bus:
    """Connect to the station's router, waiting for it up to ``timeout_s``; afterwards zenoh reconnects by itself.

    Raises BusError when there is none.
    """
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            return Bus(zenoh.open(_configuration(socket, router=False)))
        except zenoh.ZError as error:
            if time.monotonic() >= deadline:
                raise BusError(f"no station answers at {socket}; start one with gcs up") from error


_Reply = TypeVar("_Reply")


class Bus:
    """A session on the station's bus. Usable from any thread, but never from the flight thread."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session: Any = session
        self._declared: list[Any] = []

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus."""
        self._session.close()

    def publish_signals(self, frames: bytes) -> None:
        """One or more signal frames, float64 little endian, oldest first."""
        self._session.put(Topic.SIGNALS.value, frames)

    def publish_status(self, status: Status) -> None:
        self._session.put(Topic.STATUS.value, msgspec.json.encode(status))

    def publish_event(self, event: Event) -> None:
        self._session.put(Topic.EVENT.value, msgspec.json.encode(event))

    def publish_recording(self, recording: RecordingStatus) -> None:
        self._session.put(Topic.RECORDING.value, msgspec.json.encode(recording))

    def report(self, event: Event) -> None:
        """Tell the station of an event; the hub records and publishes it."""
        self._session.put(Topic.REPORT.value, msgspec.json.encode(event))

    def subscribe(self, topic: Topic, callback: Callable[[bytes], None]) -> None:
        """Call ``callback`` with every payload of a topic, on a thread of zenoh."""
        self._declared.append(
            self._session.declare_subscriber(topic.value, lambda sample: callback(bytes(sample.payload)))
        )

    def request(self, request: Request, timeout_s: float = _REQUEST_TIMEOUT_S) -> Answer:
        """Give a command and wait for its answer. Raises BusError when no hub answers."""
        return self._ask(Topic.COMMAND, msgspec.json.encode(request), _answer_decoder.decode, timeout_s)

    def command(self, command: AnyCommand, identity: Identity, timeout_s: float = _REQUEST_TIMEOUT_S) -> Answer:
        """Give ``command`` as ``identity``; see :meth:`request`."""
        return self.request(Request(0, identity, command, time.time()), timeout_s)

    def backlog(self, timeout_s: float = _BACKLOG_TIMEOUT_S) -> Backlog:
        """The station's recent past. Raises BusError when no hub answers."""
        return self._ask(Topic.BACKLOG, b"", _backlog_decoder.decode, timeout_s)

    def run_action(self, action: ActionRequest, timeout_s: float) -> ActionResult:
        """Have the actions process do something and wait for the result. Raises BusError when none answers."""
        return self._ask(Topic.ACTION, msgspec.json.encode(action), _result_decoder.decode, timeout_s)

    def _ask(self, topic: Topic, payload: bytes, decode: Callable[[bytes], _Reply], timeout_s: float) -> _Reply:
        for reply in self._session.get(topic.value, payload=payload, timeout=timeout_s):
            if reply.ok is not None:
                return decode(bytes(reply.ok.payload))
            if reply.err is not None and bytes(reply.err.payload) != b"Timeout":
                raise BusError(f"{topic}: {bytes(reply.err.payload).decode(errors='replace')}")
        raise BusError(f"{topic}: no answer")

    def serve_commands(self, handler: Callable[[Request, Callable[[Answer], None]], None]) -> None:
        """Answer commands: ``handler`` gets a request and a function to call once, from any thread, with the answer."""
        self._serve(Topic.COMMAND, _request_decoder.decode, handler)

    def serve_actions(self, handler: Callable[[ActionRequest, Callable[[ActionResult], None]], None]) -> None:
        """Do actions: ``handler`` gets the request and a function to call once, from any thread, with the result."""
        self._serve(Topic.ACTION, _action_decoder.decode, handler)

    def serve_backlog(self, handler: Callable[[], Backlog]) -> None:
        """Answer requests for the recent past."""

        def on_query(query: Any) -> None:
            query.reply(query.key_expr, msgspec.msgpack.encode(handler()))

        self._declared.append(self._session.declare_queryable(Topic.BACKLOG.value, on_query))

    def _serve(self, topic: Topic, decode: Callable[[bytes], Any], handler: Callable[[Any, Any], None]) -> None:
        def on_query(query: Any) -> None:
            payload = b"" if query.payload is None else bytes(query.payload)
            try:
                request = decode(payload)
            except msgspec.DecodeError as error:
                query.reply_err(f"not understood: {error}".encode())
                return

            def reply(answer: Answer | ActionResult) -> None:
                query.reply(query.key_expr, msgspec.json.encode(answer))
                query.drop()

            handler(request, reply)

        self._declared.append(self._session.declare_queryable(topic.value, on_query))
