"""MAVLink 2 frames from the dialect's own tables: payload by precompiled struct, CRC in C, one frame per call.

pymavlink's own packing builds an object per message and costs several times as much; its tables are used.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

_HEADER = struct.Struct("<BBBBBBHB")
_TRAILER = struct.Struct("<H")
_MIRROR_BYTE = bytes(int(f"{i:08b}"[::-1], 2) for i in range(256))
_MIRROR_WORD = tuple(int(f"{i:016b}"[::-1], 2) for i in range(65536))


def x25_crc(data: bytes) -> int:
    """CRC-16/MCRF4XX of MAVLink: the mirror image of the CRC-CCITT that the standard library has in C."""
    return _MIRROR_WORD[binascii.crc_hqx(data.translate(_MIRROR_BYTE), 0xFFFF)]


class Layout:
    """Wire layout of one message: ``pack`` takes the values in wire order, arrays flattened."""

    def __init__(self, message_class: Any) -> None:
        self.name: str = message_class.msgname
        self.message_id: int = message_class.id
        self.crc_extra = bytes([message_class.crc_extra])
        self.pack: Callable[..., bytes] = message_class.unpacker.pack
        self._fields = list(
            zip(
                message_class.ordered_fieldnames,
                (message_class.array_lengths[i] for i in range(len(message_class.ordered_fieldnames))),
                (message_class.fieldtypes[message_class.fieldnames.index(n)] for n in message_class.ordered_fieldnames),
                strict=True,
            )
        )

    def payload(self, **values: Any) -> bytes:
        """Payload from values by field name; a field left out is zero. Raises KeyError for a name the message lacks."""
        flat: list[Any] = []
        for name, length, kind in self._fields:
            if kind == "char":
                flat.append(values.pop(name, "").encode("ascii", "replace"))
            elif length:
                given = list(values.pop(name, ()))
                flat.extend(given + [0] * (length - len(given)))
            else:
                flat.append(values.pop(name, 0))
        if values:
            raise KeyError(f"{self.name} has no field {sorted(values)[0]!r}")
        return self.pack(*flat)


@cache
def layout(name: str) -> Layout:
    """Layout of a message of the dialect by its name; raises KeyError if there is none."""
    for message_class in dialect.mavlink_map.values():
        if message_class.msgname == name:
            return Layout(message_class)
    raise KeyError(f"no message {name!r} in the ardupilotmega dialect")


class Sender:
    """Frames of one component on one link, numbered in sequence."""

    def __init__(self, system: int, component: int) -> None:
        self.system = system
        self.component = component
        self.sequence = 0

    def frame(self, message: Layout, payload: bytes) -> bytes:
        """A MAVLink 2 frame around a payload, trailing zeros cut as the protocol wants."""
        payload = payload.rstrip(b"\0") or b"\0"
        message_id = message.message_id
        body = (
            _HEADER.pack(
                len(payload), 0, 0, self.sequence, self.system, self.component, message_id & 0xFFFF, message_id >> 16
            )
            + payload
        )
        self.sequence = (self.sequence + 1) & 0xFF
        return b"\xfd" + body + _TRAILER.pack(x25_crc(body + message.crc_extra))
