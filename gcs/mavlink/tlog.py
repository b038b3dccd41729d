"""Telemetry logs (.tlog): per packet a big-endian microsecond UTC stamp of 8 bytes, then the raw packet.

The reader gets out of a damaged or cut file all that is whole: where a record does not end where the next one begins
and its checksum fails, it searches for the next packet with a valid checksum.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from gcs.mavlink.codec import MAX_FRAME_SIZE, checksum_holds, frame_size_at, parse_frame, without_signature

_STAMP = struct.Struct(">Q")
_CHUNK_SIZE = 1 << 20
# A record is judged by itself and by the first bytes of the one behind it.
_LOOKAHEAD = 2 * (_STAMP.size + MAX_FRAME_SIZE)


class TlogReader:
    """Iterates over ``(utc_us, packet)`` of a log, in file order; packets of both directions are in it.

    After the iteration ``records`` counts packets, ``bad_bytes`` the bytes that belong to none, and ``damaged`` the
    places where the reader had to search. A packet in its place with a wrong checksum is handed out: the decoder
    that is fed with it counts it. Raises OSError if the file cannot be opened or read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.records = 0
        self.bad_bytes = 0
        self.damaged = 0

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        self.records = self.bad_bytes = self.damaged = 0
        in_step = True
        with self.path.open("rb") as stream:
            data, at, ended = b"", 0, False
            while True:
                while len(data) - at < _LOOKAHEAD and not ended:
                    chunk = stream.read(_CHUNK_SIZE)
                    ended = not chunk
                    data, at = data[at:] + chunk, 0
                if at >= len(data):
                    return
                end = _record_end(data, at)
                if end:
                    in_step = True
                    self.records += 1
                    yield _STAMP.unpack_from(data, at)[0], data[at + _STAMP.size : end]
                    at = end
                else:
                    self.damaged += in_step
                    in_step = False
                    self.bad_bytes += 1
                    at += 1


def _record_end(data: bytes, at: int) -> int:
    """Where the record at ``at`` ends, 0 if there is none: another begins behind it, or its own checksum holds."""
    start = at + _STAMP.size
    if start >= len(data):
        return 0
    size = frame_size_at(data, start)
    if not size or start + size > len(data):
        return 0
    end = start + size
    following = end + _STAMP.size
    # Two stamps that share their upper 3 bytes are less than 13 days apart: chance bytes do not line up like that.
    near = data[end : end + 3] == data[at : at + 3]
    if near and following < len(data) and frame_size_at(data, following) is not None:
        return end
    return end if checksum_holds(parse_frame(data[start:end])) else 0


class TlogWriter:
    """Appends packets to a log. It never flushes by itself: when to, is the caller's choice (:meth:`flush`)."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.records = 0

    def append(self, utc_us: int, packet: bytes) -> None:
        """Write one packet with its UTC stamp [us], without its signature. Raises OSError as the stream does."""
        self._stream.write(_STAMP.pack(utc_us) + without_signature(packet))
        self.records += 1

    def flush(self) -> None:
        """Hand everything written to the operating system."""
        self._stream.flush()
