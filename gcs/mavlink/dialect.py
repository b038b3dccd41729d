"""What the codec needs of the dialect (ardupilotmega, MAVLink 2), built once at import: checksums, names, layouts."""

from __future__ import annotations

import binascii
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.messages import MESSAGE_TYPES, Message


class DialectError(ImportError):
    """The installed dialect and our message types disagree; the message names the first difference."""


def _reflect(value: int, bits: int) -> int:
    return int(f"{value:0{bits}b}"[::-1], 2)


BYTE_REFLECTED = bytes(_reflect(byte, 8) for byte in range(256))
WORD_REFLECTED = tuple(_reflect(word, 16) for word in range(65536))
CRC_EXTRA = {message_id: cls.crc_extra for message_id, cls in dialect.mavlink_map.items()}
CRC_EXTRA_REFLECTED = {message_id: BYTE_REFLECTED[extra : extra + 1] for message_id, extra in CRC_EXTRA.items()}
MESSAGE_NAMES: dict[int, str] = {message_id: str(cls.msgname) for message_id, cls in dialect.mavlink_map.items()}
MESSAGE_IDS: dict[str, int] = {name: message_id for message_id, name in MESSAGE_NAMES.items()}


def checksum(data: bytes, initial: int = 0xFFFF) -> int:
    """CRC-16/MCRF4XX of ``data``, the MAVLink checksum (the caller appends the message's extra byte).

    It is the mirror image of the CCITT checksum of the standard library: mirror the bits of each byte going in and
    of the word coming out. That runs in C at a byte per nanosecond, which no table walk in Python can.
    """
    return WORD_REFLECTED[binascii.crc_hqx(data.translate(BYTE_REFLECTED), WORD_REFLECTED[initial])]


def message_name(message_id: int) -> str:
    """Name of a message, or ``UNKNOWN_<id>`` where the dialect has none."""
    return MESSAGE_NAMES.get(message_id) or f"UNKNOWN_{message_id}"


@dataclass(frozen=True, slots=True)
class Layout:
    """How one hot-path message lies in its payload; ``groups`` gathers array fields, and is empty if there are none."""

    message_type: type[Message]
    size: int
    unpack: Callable[[bytes], tuple[Any, ...]]
    groups: tuple[slice | int, ...]


def _layout(message_id: int, message_type: type[Message]) -> Layout:
    """Layout of one message; raises DialectError where our fields are not those of the dialect, in its wire order."""
    cls = dialect.mavlink_map[message_id]
    if tuple(cls.ordered_fieldnames) != message_type._fields:
        raise DialectError(
            f"{cls.msgname}: dialect fields are {', '.join(cls.ordered_fieldnames)}, "
            f"ours are {', '.join(message_type._fields)}; install pymavlink 2.4.50 or correct the message type"
        )
    groups: list[slice | int] = []
    start = 0
    for length in cls.lengths:
        groups.append(start if length == 1 else slice(start, start + length))
        start += length
    has_arrays = any(isinstance(group, slice) for group in groups)
    return Layout(message_type, cls.unpacker.size, cls.unpacker.unpack, tuple(groups) if has_arrays else ())


LAYOUTS: dict[int, Layout] = {
    message_id: _layout(message_id, message_type) for message_id, message_type in MESSAGE_TYPES.items()
}
