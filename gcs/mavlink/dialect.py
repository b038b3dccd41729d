"""What the codec needs of the dialect (ardupilotmega, MAVLink 2), built once at import: checksums, names, layouts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.messages import MESSAGE_TYPES, Message


class DialectError(ImportError):
    """The installed dialect and our message types disagree; the message names the first difference."""


CRC_EXTRA = {message_id: bytes((cls.crc_extra,)) for message_id, cls in dialect.mavlink_map.items()}
MESSAGE_NAMES: dict[int, str] = {message_id: str(cls.msgname) for message_id, cls in dialect.mavlink_map.items()}
MESSAGE_IDS: dict[str, int] = {name: message_id for message_id, name in MESSAGE_NAMES.items()}


def message_name(message_id: int) -> str:
    """Name of a message, or ``UNKNOWN_<id>`` where the dialect has none."""
    return MESSAGE_NAMES.get(message_id) or f"UNKNOWN_{message_id}"


class Layout(NamedTuple):
    """How one hot-path message lies in its payload.

    ``padding`` fills up a truncated payload; ``groups`` gathers array fields and is empty if there are none.
    """

    message_type: Callable[..., Message]
    unpack: Callable[[bytes], tuple[Any, ...]]
    padding: bytes
    groups: tuple[slice | int, ...]


def _layout(message_id: int, message_type: type[Message]) -> Layout:
    """Layout of one message; raises DialectError where our fields are not those of the dialect, in its wire order."""
    cls = dialect.mavlink_map[message_id]
    if tuple(cls.ordered_fieldnames) != message_type.__struct_fields__:
        raise DialectError(
            f"{cls.msgname}: dialect fields are {', '.join(cls.ordered_fieldnames)}, "
            f"ours are {', '.join(message_type.__struct_fields__)}; install pymavlink 2.4.50 or correct ours"
        )
    groups: list[slice | int] = []
    start = 0
    for length in cls.lengths:
        groups.append(start if length == 1 else slice(start, start + length))
        start += length
    has_arrays = any(isinstance(group, slice) for group in groups)
    padding = bytes(cls.unpacker.size)
    return Layout(message_type, cls.unpacker.unpack_from, padding, tuple(groups) if has_arrays else ())


LAYOUTS: dict[int, Layout] = {
    message_id: _layout(message_id, message_type) for message_id, message_type in MESSAGE_TYPES.items()
}
