"""THE recording: the stream of tick inputs with an output hash per tick, from which a flight is replayed bit for bit.

File ``inputs.mpk``: the magic line, then records of length and CRC-32 (two little-endian uint32) before a msgpack
:class:`InputRecord`. Commands that change the configuration are part of the inputs; the configuration at the start is
in ``run.json``. A file that a crash has torn is good up to its last whole record.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec

from gcs.records import TickFrame, TickInputs

MAGIC = b"rotorlab inputs 1\n"
_HEAD = struct.Struct("<II")
_LARGEST_RECORD = 1 << 24


class RecordingError(Exception):
    """A recording that cannot be read; the text names the file and what is wrong."""


class InputRecord(msgspec.Struct, frozen=True, array_like=True):
    """One tick: its number, vehicle time [s], UTC [s], everything it was given, and the hash of what it put out."""

    sequence: int
    t_s: float
    utc_s: float
    inputs: TickInputs
    output_hash: bytes


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(InputRecord)


class InputWriter:
    """Appends ticks to a stream. Flushing is the caller's; raises OSError as the stream does."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        if stream.tell() == 0:
            stream.write(MAGIC)

    def append(self, frame: TickFrame) -> None:
        record = InputRecord(frame.sequence, frame.t_s, frame.utc_s, frame.inputs, frame.output_hash)
        body = _encoder.encode(record)
        self._stream.write(_HEAD.pack(len(body), zlib.crc32(body)) + body)


def read_inputs(path: Path) -> Iterator[InputRecord]:
    """Ticks of a recording in order, up to the first record that is torn or damaged.

    Raises RecordingError if the file is not a recording, OSError if it cannot be read.
    """
    for record, _ in _records(path):
        yield record


def whole_part(path: Path) -> tuple[int, int | None, int]:
    """How far a recording is good: size in bytes, number of the last tick (None if there is none), count of ticks."""
    end, last, count = len(MAGIC), None, 0
    for record, record_end in _records(path):
        end, last, count = record_end, record.sequence, count + 1
    return end, last, count


def _records(path: Path) -> Iterator[tuple[InputRecord, int]]:
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: not a recording of this version (no line {MAGIC.decode().strip()!r})")
        end = len(MAGIC)
        while len(head := stream.read(_HEAD.size)) == _HEAD.size:
            length, checksum = _HEAD.unpack(head)
            if length > _LARGEST_RECORD:
                return
            body = stream.read(length)
            if len(body) < length or zlib.crc32(body) != checksum:
                return
            end += _HEAD.size + length
            try:
                record = _decoder.decode(body)
            except msgspec.ValidationError as error:
                raise RecordingError(f"{path}: a record that this version does not understand: {error}") from error
            yield record, end
