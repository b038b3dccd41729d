"""Flight limits, checked each tick whatever controller flies: height, radius, tilt, speed, climb rate."""

from __future__ import annotations

import math
from typing import NamedTuple

from gcs.config import Limits
from models.estimate import Estimate

# A breach that still stands this long after HOLD was commanded makes the vehicle land.
LAND_AFTER_S = 3.0


class Breach(NamedTuple):
    """One limit exceeded: quantity in words, value and limit in ``unit``."""

    quantity: str
    value: float
    limit: float
    unit: str

    def text(self) -> str:
        return f"{self.quantity} {self.value:.1f} {self.unit}, limit {self.limit:.1f} {self.unit}."


def first_breach(estimate: Estimate, limits: Limits) -> Breach | None:
    """The first limit that the estimate exceeds, or None. Height and radius are above and about the local origin."""
    north, east, down = estimate.position_ned_m
    v_north, v_east, v_down = estimate.velocity_ned_m_s
    roll, pitch, _ = estimate.euler_rad
    tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, math.cos(roll) * math.cos(pitch)))))
    checks = (
        Breach("Tilt", tilt_deg, limits.tilt_max_deg, "°"),
        Breach("Height", -down, limits.height_max_m, "m"),
        Breach("Distance from home", math.hypot(north, east), limits.radius_max_m, "m"),
        Breach("Ground speed", math.hypot(v_north, v_east), limits.speed_max_m_s, "m/s"),
        Breach("Climb rate", abs(v_down), limits.climb_max_m_s, "m/s"),
    )
    usable = checks if estimate.position_valid else checks[:1]
    return next((breach for breach in usable if breach.value > breach.limit), None)
