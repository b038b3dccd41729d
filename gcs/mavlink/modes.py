"""Flight mode names and numbers in the autopilot's own words, and the armed flag of HEARTBEAT."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

# MAV_AUTOPILOT; 0 is also what we hold before the first heartbeat
AUTOPILOT_UNKNOWN = 0
AUTOPILOT_ARDUPILOT = 3
AUTOPILOT_INVALID = 8
AUTOPILOT_PX4 = 12
TYPE_GCS = 6
FLAG_CUSTOM_MODE = 1
FLAG_ARMED = 128

_PX4_NUMBERS: dict[str, tuple[int, int]] = {
    "MANUAL": (1, 0),
    "ALTCTL": (2, 0),
    "POSCTL": (3, 0),
    "READY": (4, 1),
    "TAKEOFF": (4, 2),
    "LOITER": (4, 3),
    "MISSION": (4, 4),
    "RTL": (4, 5),
    "LAND": (4, 6),
    "FOLLOWME": (4, 8),
    "PRECLAND": (4, 9),
    "ACRO": (5, 0),
    "OFFBOARD": (6, 0),
    "STABILIZED": (7, 0),
    "RATTITUDE": (8, 0),
}
_PX4_NAMES = {numbers: name for name, numbers in _PX4_NUMBERS.items()}

# MAV_TYPE -> the dialect's table of custom modes. Helicopters fly the copter firmware and its modes.
_COPTER_TYPES = (2, 3, 4, 13, 14, 15, 29, 35)
_PLANE_TYPES = (1, 7, 8, 16, 19, 20, 21, 22, 23, 24, 25, 28)
_ROVER_TYPES = (10, 11)
_SUBMARINE_TYPES = (12,)
_ARDUPILOT_TABLES = (
    (_COPTER_TYPES, "COPTER_MODE"),
    (_PLANE_TYPES, "PLANE_MODE"),
    (_ROVER_TYPES, "ROVER_MODE"),
    (_SUBMARINE_TYPES, "SUB_MODE"),
)


class ModeError(ValueError):
    """A mode this vehicle does not have; the message names the ones it has."""


@dataclass(frozen=True, slots=True)
class ModeCommand:
    """Parameters of MAV_CMD_DO_SET_MODE (176): base mode flags, custom main mode, custom sub mode."""

    base_mode: int
    main: int
    sub: int


def _ardupilot_names(table: str) -> dict[int, str]:
    entries = dialect.enums[table].items()
    return {
        number: str(entry.name).removeprefix(f"{table}_")
        for number, entry in entries
        if not str(entry.name).endswith("_ENUM_END")
    }


_ARDUPILOT_NAMES: dict[int, dict[int, str]] = {
    vehicle_type: names
    for types, table in _ARDUPILOT_TABLES
    for names in (_ardupilot_names(table),)
    for vehicle_type in types
}


def is_armed(base_mode: int) -> bool:
    """The armed flag of HEARTBEAT.base_mode."""
    return bool(base_mode & FLAG_ARMED)


def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """Name of HEARTBEAT.custom_mode (a PX4 word is main << 16 | sub << 24); ``MODE_<number>`` where none is known."""
    if autopilot == AUTOPILOT_PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24
        return _PX4_NAMES.get((main, sub)) or _PX4_NAMES.get((main, 0)) or f"MODE_{main}_{sub}"
    if autopilot == AUTOPILOT_ARDUPILOT:
        return _ARDUPILOT_NAMES.get(vehicle_type, {}).get(custom_mode) or f"MODE_{custom_mode}"
    return f"MODE_{custom_mode}"


def mode_names(autopilot: int, vehicle_type: int) -> tuple[str, ...]:
    """All modes that can be asked for by name, in the order of their numbers."""
    if autopilot == AUTOPILOT_PX4:
        return tuple(_PX4_NUMBERS)
    if autopilot == AUTOPILOT_ARDUPILOT:
        names = _ARDUPILOT_NAMES.get(vehicle_type, {})
        return tuple(names[number] for number in sorted(names))
    return ()


def mode_command(autopilot: int, vehicle_type: int, name: str, *, armed: bool) -> ModeCommand:
    """MAV_CMD_DO_SET_MODE parameters for a mode by name; ``armed`` repeats the vehicle's present state, as PX4 expects.

    Raises ModeError, naming the modes there are, for a name this vehicle does not know.
    """
    base_mode = FLAG_CUSTOM_MODE | (FLAG_ARMED if armed else 0)
    if autopilot == AUTOPILOT_PX4 and name in _PX4_NUMBERS:
        return ModeCommand(base_mode, *_PX4_NUMBERS[name])
    if autopilot == AUTOPILOT_ARDUPILOT:
        for number, known in _ARDUPILOT_NAMES.get(vehicle_type, {}).items():
            if known == name:
                return ModeCommand(base_mode, number, 0)
    choices = ", ".join(mode_names(autopilot, vehicle_type)) or "none by name"
    raise ModeError(f"mode '{name}' is not one of autopilot {autopilot}, vehicle type {vehicle_type}; modes: {choices}")
