"""What the vehicle says about itself, folded sample by sample: mode, armed, landed, battery, its own estimate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import msgspec
from msgspec.structs import replace

from models.frames import Geodetic, Quaternion, Vec3
from models.samples import (
    ActuatorSample,
    AnySample,
    AutopilotAttitudeSample,
    AutopilotPositionSample,
    BatterySample,
    HeartbeatSample,
    HomeSample,
    ImuSample,
    LandedSample,
    OriginSample,
)

_NAN3 = (math.nan, math.nan, math.nan)
LANDED_WORDS = {0: "unknown", 1: "on ground", 2: "in air", 3: "taking off", 4: "landing"}


class VehicleView(msgspec.Struct, frozen=True):
    """Latest of each kind; NaN or None where nothing came yet. ``armed_since_s`` is vehicle time."""

    heartbeat: HeartbeatSample | None = None
    imu: ImuSample | None = None
    landed_state: int = 0
    battery_v: float = math.nan
    battery_remaining: float = math.nan
    actuator_outputs: tuple[float, ...] = ()
    autopilot_ned_from_body: Quaternion | None = None
    autopilot_position_ned_m: Vec3 = _NAN3
    autopilot_velocity_ned_m_s: Vec3 = _NAN3
    origin: Geodetic | None = None
    armed_since_s: float = math.nan

    @property
    def armed(self) -> bool:
        return self.heartbeat is not None and self.heartbeat.armed

    @property
    def mode(self) -> str:
        return "" if self.heartbeat is None else self.heartbeat.mode

    @property
    def in_air(self) -> bool:
        """Airborne as far as the vehicle says; an armed vehicle that reports no landed state counts as airborne."""
        return self.armed and self.landed_state != 1

    @property
    def landed(self) -> str:
        return LANDED_WORDS.get(self.landed_state, "unknown")


def fold(view: VehicleView, samples: Iterable[AnySample]) -> VehicleView:
    """The view after these samples, in arrival order. Samples only an estimator cares about leave it as it is."""
    changes: dict[str, Any] = {}
    for sample in samples:
        match sample:
            case ImuSample():
                changes["imu"] = sample
            case AutopilotAttitudeSample():
                changes["autopilot_ned_from_body"] = sample.ned_from_body
            case AutopilotPositionSample():
                changes["autopilot_position_ned_m"] = sample.position_ned_m
                changes["autopilot_velocity_ned_m_s"] = sample.velocity_ned_m_s
            case ActuatorSample():
                changes["actuator_outputs"] = sample.outputs
            case HeartbeatSample():
                changes["heartbeat"] = sample
                if sample.armed != view.armed:
                    changes["armed_since_s"] = sample.arrival_s if sample.armed else math.nan
            case LandedSample():
                changes["landed_state"] = sample.landed_state
            case BatterySample():
                changes["battery_v"] = sample.voltage_v
                changes["battery_remaining"] = sample.remaining
            case OriginSample():
                changes["origin"] = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
            case HomeSample() if view.origin is None and "origin" not in changes:
                changes["origin"] = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
            case _:
                pass
    return replace(view, **changes) if changes else view
