"""Parameters of the simulated firmware: PX4 names, and the bytewise encoding in which PX4 sends integers."""

from __future__ import annotations

import struct
from collections.abc import Iterator

REAL32 = 9
INT32 = 6
UINT32 = 5

# Name -> (value, lowest, highest). A float value makes a REAL32 parameter, an int an INT32.
DEFAULTS: dict[str, tuple[float, float, float]] = {
    "BAT1_CAPACITY": (5000.0, 0.0, 1e6),
    "BAT1_N_CELLS": (4, 1, 20),
    "BAT_CRIT_THR": (0.07, 0.0, 1.0),
    "BAT_LOW_THR": (0.2, 0.0, 1.0),
    "COM_ARM_WO_GPS": (1, 0, 1),
    "COM_DISARM_LAND": (2.0, -1.0, 20.0),
    "COM_DISARM_PRFLT": (10.0, -1.0, 60.0),
    "COM_OBL_RC_ACT": (4, 4, 5),  # after the hold: 4 land, 5 keep holding
    "COM_OF_LOSS_T": (0.5, 0.0, 60.0),
    "COM_RC_OVERRIDE": (3, 0, 3),  # bit 0: sticks take over from auto modes, bit 1: from OFFBOARD
    "COM_RC_STICK_OV": (30.0, 5.0, 80.0),
    "GF_ACTION": (0, 0, 5),
    "GF_MAX_HOR_DIST": (0.0, 0.0, 10000.0),
    "GF_MAX_VER_DIST": (0.0, 0.0, 10000.0),
    "MAV_COMP_ID": (1, 1, 250),
    "MAV_SYS_ID": (1, 1, 250),
    "MAV_TYPE": (2, 0, 30),
    "MIS_TAKEOFF_ALT": (2.5, 0.0, 80.0),
    "MPC_LAND_SPEED": (0.5, 0.2, 2.0),
    "MPC_MANTHR_MIN": (0.08, 0.0, 1.0),
    "MPC_TILTMAX_AIR": (35.0, 10.0, 60.0),
    "MPC_TKO_SPEED": (1.0, 0.5, 5.0),
    "MPC_XY_CRUISE": (3.0, 0.5, 8.0),
    "MPC_XY_P": (1.0, 0.1, 3.0),
    "MPC_XY_VEL_I": (0.4, 0.0, 5.0),
    "MPC_XY_VEL_MAX": (6.0, 0.5, 10.0),
    "MPC_XY_VEL_P": (1.8, 0.1, 6.0),
    "MPC_Z_P": (1.0, 0.1, 3.0),
    "MPC_Z_VEL_I": (1.5, 0.0, 5.0),
    "MPC_Z_VEL_MAX_DN": (1.5, 0.5, 4.0),
    "MPC_Z_VEL_MAX_UP": (3.0, 0.5, 8.0),
    "MPC_Z_VEL_P": (4.0, 0.5, 15.0),
    "NAV_DLL_ACT": (0, 0, 6),
    "NAV_RCL_ACT": (0, 0, 6),
    "RTL_RETURN_ALT": (10.0, 2.0, 150.0),
    "SIM_OBL_HOLD_T": (3.0, 0.0, 600.0),  # vehicle time the hold lasts after OFFBOARD is lost
    "SYS_AUTOSTART": (4001, 0, 1 << 30),
    "SYS_HITL": (0, 0, 2),
}


class VehicleParameters:
    """Parameter store with types and ranges, in the order a list request sends them."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {name: row[0] for name, row in DEFAULTS.items()}
        self.names: tuple[str, ...] = tuple(self._values)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def kind(self, name: str) -> int:
        """MAV_PARAM_TYPE of a parameter."""
        return INT32 if isinstance(DEFAULTS[name][0], int) else REAL32

    def set(self, name: str, value: float) -> bool:
        """Store a value; False, and nothing stored, if it is outside the parameter's range (or not a number)."""
        _, low, high = DEFAULTS[name]
        if not low <= value <= high:
            return False
        self._values[name] = int(value) if self.kind(name) == INT32 else float(value)
        return True

    def wire_value(self, name: str) -> float:
        """The float that carries the value on the wire; integers bytewise, as PX4 does."""
        if self.kind(name) == REAL32:
            return self._values[name]
        carried: float = struct.unpack("<f", struct.pack("<i", int(self._values[name])))[0]
        return carried

    @staticmethod
    def value_from_wire(carried: float, kind: int) -> float:
        """The value in a PARAM_SET of this MAV_PARAM_TYPE; raises ValueError for a type no parameter has."""
        if kind == REAL32:
            return carried
        if kind == INT32:
            return float(struct.unpack("<i", struct.pack("<f", carried))[0])
        if kind == UINT32:
            return float(struct.unpack("<I", struct.pack("<f", carried))[0])
        raise ValueError(f"parameter type {kind} is not one of {REAL32} (float), {INT32}, {UINT32} (integer)")
