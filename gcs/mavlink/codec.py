"""MAVLink 1 and 2 framing without input or output: bytes in, frames and typed messages out, and the way back.

The checksum is CRC-16/MCRF4XX over everything behind the magic byte, with one extra byte per message. Bytes that
belong to no valid frame are counted and skipped, never raised; the decoder finds the next frame by itself.
"""

from __future__ import annotations

import struct
from typing import Any

import msgspec
from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.dialect import CRC_EXTRA, LAYOUTS
from gcs.mavlink.messages import Message

# CRC-16/MCRF4XX; the caller appends the extra byte of the message.
checksum = crc16.mcrf4xx

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
FLAG_SIGNED = 0x01
OVERHEAD_V1 = 8
OVERHEAD_V2 = 12
SIGNATURE_SIZE = 13
MAX_FRAME_SIZE = OVERHEAD_V2 + 255 + SIGNATURE_SIZE

# One layout per payload length gives all of a frame behind its flags in a single unpacking: sequence, source (system in
# the low byte, component in the high one), message id, payload, checksum.
_UNPACK_V2 = tuple(struct.Struct(f"<4xBHHB{length}sH").unpack_from for length in range(256))
_UNPACK_V1 = tuple(struct.Struct(f"<2xBHB{length}sH").unpack_from for length in range(256))
_LATE_SEQUENCE = 250


class Frame(msgspec.Struct, frozen=True, gc=False):
    """One frame off the wire. ``payload`` is as sent (trailing zeros cut); ``raw`` is the whole packet, signature too.

    ``source`` holds the system in its low byte and the component in its high one. The signature of a signed frame is
    carried in ``raw`` and not verified here.
    """

    message_id: int
    sequence: int
    source: int
    payload: bytes
    raw: bytes

    @property
    def system(self) -> int:
        """System id of the sender."""
        return self.source & 0xFF

    @property
    def component(self) -> int:
        """Component id of the sender."""
        return self.source >> 8

    @property
    def version(self) -> int:
        """MAVLink version of the framing, 1 or 2."""
        return 2 if self.raw[0] == MAGIC_V2 else 1

    @property
    def signed(self) -> bool:
        """True if a signature follows the checksum."""
        return self.raw[0] == MAGIC_V2 and bool(self.raw[2] & FLAG_SIGNED)


class SourceCount:
    """Packets received and lost of one (system, component), from the sequence numbers."""

    __slots__ = ("expected", "late", "lost", "received")

    def __init__(self, sequence: int) -> None:
        self.expected = (sequence + 1) & 0xFF
        self.received = 1
        self.lost = 0
        self.late = 0

    def count(self, sequence: int) -> None:
        """Account for one more packet; one that comes late or twice is not taken for a gap of 250."""
        gap = (sequence - self.expected) & 0xFF
        self.received += 1
        if gap < _LATE_SEQUENCE:
            self.lost += gap
            self.expected = (sequence + 1) & 0xFF
        else:
            self.late += 1


class Decoder:
    """Cuts a stream of bytes into frames. Damage is data: counted, skipped, never raised.

    ``bad_crc``        frames in step with the stream whose checksum fails
    ``bad_bytes``      bytes that belong to no valid frame
    ``unknown``        well-formed frames of messages outside the dialect: handed out, their checksum cannot be verified
    ``sources``        received and lost packets per (system, component)
    """

    __slots__ = ("_in_step", "_rest", "_sources", "bad_bytes", "bad_crc", "unknown")

    def __init__(self) -> None:
        self._rest = b""
        self._in_step = True
        self.bad_bytes = 0
        self.bad_crc = 0
        self.unknown = 0
        self._sources: dict[int, SourceCount] = {}

    @property
    def sources(self) -> dict[tuple[int, int], SourceCount]:
        """Received and lost packets of each sender."""
        return {(source & 0xFF, source >> 8): count for source, count in self._sources.items()}

    def source(self, system: int, component: int) -> SourceCount | None:
        """Received and lost packets of one sender, None if it has not been heard."""
        return self._sources.get(system | component << 8)

    def feed(self, data: bytes) -> list[Frame]:
        """Frames completed by ``data``, in order; an unfinished frame at the end waits for more."""
        if self._rest:
            data = self._rest + data
            self._rest = b""
        elif len(data) >= OVERHEAD_V2 and data[0] == MAGIC_V2 and not data[2] and data[1] == len(data) - OVERHEAD_V2:
            # One whole unsigned MAVLink 2 frame: what nearly every datagram and log record is. The rest of this method
            # would do the same, at twice the time.
            sequence, source, message_id, high, payload, crc = _UNPACK_V2[data[1]](data)
            if high:
                message_id |= high << 16
            extra = CRC_EXTRA.get(message_id)
            if extra is not None and checksum(data[1:-2] + extra) == crc:
                count = self._sources.get(source)
                if count is not None and count.expected == sequence:
                    count.expected = (sequence + 1) & 0xFF
                    count.received += 1
                else:
                    self._count(source, sequence)
                self._in_step = True
                return [Frame(message_id, sequence, source, payload, data)]
        frames: list[Frame] = []
        start, size = 0, len(data)
        while start < size:
            taken = self._take(data, start, frames)
            if taken == 0:
                self._rest = data[start:]
                break
            start += taken
        return frames

    def flush(self) -> None:
        """Give up an unfinished frame: its bytes are bad. For the end of a file or of a connection."""
        self.bad_bytes += len(self._rest)
        self._rest = b""
        self._in_step = True

    def _take(self, data: bytes, start: int, frames: list[Frame]) -> int:
        """Take the frame at ``start`` or skip what is none; returns the bytes used up, 0 if more are needed to tell."""
        frame_size = frame_size_at(data, start)
        if frame_size is None:
            return self._skip(data, start, in_step=False)
        end = start + frame_size
        if frame_size == 0 or end > len(data):
            return 0
        frame = parse_frame(data[start:end])
        if checksum_holds(frame):
            self._count(frame.source, frame.sequence)
        elif frame.message_id in CRC_EXTRA:
            return self._skip(data, start, in_step=self._in_step)
        elif end < len(data) and data[end] not in (MAGIC_V1, MAGIC_V2):
            return self._skip(data, start, in_step=False)
        else:
            self.unknown += 1
            if frame.source in self._sources:
                self._count(frame.source, frame.sequence)
        frames.append(frame)
        self._in_step = True
        return frame_size

    def _count(self, source: int, sequence: int) -> None:
        count = self._sources.get(source)
        if count is None:
            self._sources[source] = SourceCount(sequence)
        else:
            count.count(sequence)

    def _skip(self, data: bytes, start: int, *, in_step: bool) -> int:
        """Count bytes up to the next possible magic byte; a frame found broken in step counts as one bad checksum."""
        self.bad_crc += in_step
        self._in_step = False
        candidates = [at for magic in (b"\xfd", b"\xfe") if (at := data.find(magic, start + 1)) >= 0]
        skipped = min(candidates, default=len(data)) - start
        self.bad_bytes += skipped
        return skipped


def frame_size_at(data: bytes, start: int) -> int | None:
    """Size of the frame beginning at ``start``: 0 if too few bytes are there to tell, None if no frame begins there."""
    magic = data[start]
    if magic == MAGIC_V2:
        if len(data) - start < 3:
            return 0
        flags = data[start + 2]
        if flags & ~FLAG_SIGNED:
            return None
        return OVERHEAD_V2 + data[start + 1] + (SIGNATURE_SIZE if flags else 0)
    if magic == MAGIC_V1:
        return OVERHEAD_V1 + data[start + 1] if len(data) - start >= 2 else 0
    return None


def parse_frame(raw: bytes) -> Frame:
    """Header and payload of one whole frame (see :func:`frame_size_at`); its checksum is not looked at."""
    length = raw[1]
    if raw[0] == MAGIC_V1:
        sequence, source, message_id, payload, _ = _UNPACK_V1[length](raw)
    else:
        sequence, source, low, high, payload, _ = _UNPACK_V2[length](raw)
        message_id = low | high << 16
    return Frame(message_id, sequence, source, payload, raw)


def checksum_holds(frame: Frame) -> bool:
    """True if the checksum of a frame is right; False for a message outside the dialect: nothing to compare with."""
    extra = CRC_EXTRA.get(frame.message_id)
    if extra is None:
        return False
    end = len(frame.raw) - (SIGNATURE_SIZE if frame.signed else 0) - 2
    return checksum(frame.raw[1:end] + extra) == int.from_bytes(frame.raw[end : end + 2], "little")


def without_signature(raw: bytes) -> bytes:
    """The same packet unsigned, as a log or an unsigned peer takes it; packets without a signature are returned as is.

    The checksum covers the flag that is cleared. It is linear, so the new one follows from the old without knowing the
    message's extra byte: unknown messages can be stripped too, and a wrong checksum stays wrong.
    """
    if raw[0] != MAGIC_V2 or not raw[2] & FLAG_SIGNED:
        return raw
    end = len(raw) - SIGNATURE_SIZE - 2
    flipped = bytes((0, FLAG_SIGNED)) + bytes(end - 2)
    crc = int.from_bytes(raw[end : end + 2], "little") ^ checksum(flipped, 0)
    return raw[:2] + bytes((raw[2] & ~FLAG_SIGNED,)) + raw[3:end] + crc.to_bytes(2, "little")


def decode(frame: Frame) -> Message | None:
    """Typed values of a hot-path message, in the wire's units; None for every other message (:func:`decode_any`)."""
    layout = LAYOUTS.get(frame.message_id)
    if layout is None:
        return None
    message_type, unpack, padding, groups = layout
    values = unpack(frame.payload + padding)
    if groups:
        return message_type(*[values[group] for group in groups])
    return message_type(*values)


_PYMAVLINK = dialect.MAVLink(None)


def decode_any(frame: Frame) -> Any | None:
    """The pymavlink message of a frame, for what is not on the hot path; None where the dialect has no such message."""
    if frame.message_id not in CRC_EXTRA:
        return None
    return _PYMAVLINK.decode(bytearray(frame.raw))
