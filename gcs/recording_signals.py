"""Signals as MCAP with JSON messages and JSON schemas, which Foxglove opens without a plug-in.

One channel per group of the signal table (``/estimate``, ``/control``, ...), its unit in every schema and in the
channel's metadata; events are ``foxglove.Log`` messages on ``/event``. A value that is not there now is left out, since
JSON has no NaN. Stamps are UTC. Chunks are kept small, so that a crash loses less than a second; a file that was not
closed has no index and is still read from its beginning.
"""

from __future__ import annotations

import struct
from typing import Any, BinaryIO

import msgspec
from mcap.writer import CompressionType, Writer

from gcs.records import Event, TickFrame
from gcs.signals import FRAME_SIZE, SIGNALS, SLICES, Signal

_CHUNK_BYTES = 128 * 1024
_FRAME = struct.Struct(f"<{FRAME_SIZE}d")
_LOG_LEVELS = {"advisory": 2, "caution": 3, "warning": 4}

_LOG_SCHEMA = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "level": {"type": "integer", "description": "2 advisory, 3 caution, 4 warning"},
        "message": {"type": "string"},
        "name": {"type": "string", "description": "source, and who"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}


def signal_groups() -> dict[str, tuple[Signal, ...]]:
    """The signal table by group, the part of the name before the dot, in table order."""
    groups: dict[str, tuple[Signal, ...]] = {}
    for signal in SIGNALS:
        group = signal.name.partition(".")[0]
        groups[group] = groups.get(group, ()) + (signal,)
    return groups


def _field(signal: Signal) -> str:
    return signal.name.partition(".")[2] or signal.name


def group_schema(group: str, signals: tuple[Signal, ...]) -> dict[str, Any]:
    """JSON schema of a group: a number per scalar signal, an object of its components per vector, with units."""
    properties: dict[str, Any] = {}
    for signal in signals:
        number = {"type": "number", "unit": signal.unit, "description": f"{signal.description} [{signal.unit}]"}
        if signal.size == 1:
            properties[_field(signal)] = number
        else:
            properties[_field(signal)] = {
                "type": "object",
                "unit": signal.unit,
                "description": number["description"],
                "properties": {label: {"type": "number", "unit": signal.unit} for label in signal.labels},
            }
    return {"title": f"rotorlab.{group}", "type": "object", "properties": properties}


class SignalWriter:
    """Writes signal frames and events into a binary stream. Raises OSError as the stream does."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="rotorlab")
        self._encoder = msgspec.json.Encoder()
        self._groups: list[tuple[int, list[tuple[str, tuple[str, ...], slice]]]] = []
        for group, signals in signal_groups().items():
            channel = self._channel(f"/{group}", group_schema(group, signals), {s.name: s.unit for s in signals})
            self._groups.append((channel, [(_field(s), s.labels, SLICES[s.name]) for s in signals]))
        self._log = self._channel("/event", _LOG_SCHEMA, {})

    def _channel(self, topic: str, schema: dict[str, Any], units: dict[str, str]) -> int:
        schema_id = self._writer.register_schema(schema["title"], "jsonschema", msgspec.json.encode(schema))
        return int(self._writer.register_channel(topic, "json", schema_id, units))

    def append(self, frame: TickFrame) -> None:
        """Write one frame of signals, each group that has a value."""
        values = _FRAME.unpack(frame.signals)
        stamp_ns = int(frame.utc_s * 1e9)
        for channel, fields in self._groups:
            message: dict[str, Any] = {}
            for name, labels, place in fields:
                present = {
                    label: value for label, value in zip(labels, values[place], strict=True) if value - value == 0.0
                }
                if present:
                    message[name] = present if len(labels) > 1 else present[labels[0]]
            if message:
                self._writer.add_message(
                    channel_id=channel,
                    log_time=stamp_ns,
                    publish_time=stamp_ns,
                    sequence=frame.sequence & 0xFFFFFFFF,
                    data=self._encoder.encode(message),
                )

    def append_event(self, event: Event, utc_s: float) -> None:
        """Write an event as a log line."""
        stamp_ns = int(utc_s * 1e9)
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        message = {
            "timestamp": {"sec": seconds, "nsec": nanoseconds},
            "level": _LOG_LEVELS[event.level],
            "message": event.text,
            "name": f"{event.source}, {event.who}" if event.who else event.source,
            "file": "",
            "line": 0,
        }
        self._writer.add_message(
            channel_id=self._log,
            log_time=stamp_ns,
            publish_time=stamp_ns,
            data=self._encoder.encode(message),
        )

    def flush(self) -> None:
        """Hand the finished chunks to the operating system."""
        self._stream.flush()

    def close(self) -> None:
        """Write the index. The stream stays open."""
        self._writer.finish()
        self._stream.flush()
