"""Offboard setpoints from their MAVLink messages: type masks and frames as PX4 reads them."""

from __future__ import annotations

import math
from typing import Any

from models.frames import Geodetic, Vec3, ned_from_geodetic
from sitl.modes import ActuatorTarget, AttitudeTarget, BodyVelocityTarget, OffboardTarget, RatesTarget
from sitl.position_control import NAN3, Target

_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_ACCELERATION = (1, 2, 4), (8, 16, 32), (64, 128, 256)
_FORCE, _IGNORE_YAW, _IGNORE_YAW_RATE = 512, 1024, 2048
_IGNORE_ATTITUDE, _IGNORE_THRUST = 128, 64
_LOCAL_NED, _BODY_NED, _BODY_FRD = 1, 8, 12
_GLOBAL_AMSL_FRAMES, _GLOBAL_RELATIVE_FRAMES = (0, 5), (3, 6)


def decode_setpoint(kind: str, message: Any, origin: Geodetic) -> OffboardTarget | None:
    """The setpoint in a message, or None if its mask, frame or numbers ask for something this vehicle does not do."""
    match kind:
        case "SET_ATTITUDE_TARGET":
            return _attitude(message)
        case "SET_POSITION_TARGET_LOCAL_NED":
            if message.coordinate_frame in (_BODY_NED, _BODY_FRD):
                return _body_velocity(message)
            if message.coordinate_frame != _LOCAL_NED:
                return None
            return _target(message, (message.x, message.y, message.z))
        case "SET_POSITION_TARGET_GLOBAL_INT":
            if message.coordinate_frame in _GLOBAL_AMSL_FRAMES:
                height = message.alt
            elif message.coordinate_frame in _GLOBAL_RELATIVE_FRAMES:
                height = message.alt + origin.height_m
            else:
                return None
            latitude, longitude = math.radians(message.lat_int * 1e-7), math.radians(message.lon_int * 1e-7)
            return _target(message, ned_from_geodetic(Geodetic(latitude, longitude, height), origin))
        case "SET_ACTUATOR_CONTROL_TARGET":
            if message.group_mlx != 0:
                return None
            # Clients send NaN for controls they leave alone.
            roll, pitch, yaw, thrust = (c if math.isfinite(c) else 0.0 for c in message.controls[:4])
            clipped = (max(-1.0, min(1.0, c)) for c in (roll, pitch, yaw))
            r, p, y = clipped
            return ActuatorTarget((r, p, y, max(0.0, min(1.0, thrust))))
    return None


def _attitude(message: Any) -> AttitudeTarget | RatesTarget | None:
    if message.type_mask & _IGNORE_THRUST or not math.isfinite(message.thrust):
        return None
    thrust = max(0.0, min(1.0, message.thrust))
    if message.type_mask & _IGNORE_ATTITUDE:
        rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
        p, q, r = (0.0 if message.type_mask & 1 << i else rate for i, rate in enumerate(rates))
        return RatesTarget((p, q, r), thrust) if math.isfinite(p + q + r) else None
    norm = math.sqrt(sum(c * c for c in message.q))
    if not math.isfinite(norm) or norm < 1e-3:
        return None
    w, x, y, z = (c / norm for c in message.q)
    return AttitudeTarget((w, x, y, z), thrust)


def _masked(mask: int, bits: tuple[int, int, int], values: Vec3) -> Vec3:
    x, y, z = (math.nan if mask & bit else value for bit, value in zip(bits, values, strict=True))
    return (x, y, z)


def _yaw(message: Any) -> tuple[float, float]:
    yaw = math.nan if message.type_mask & _IGNORE_YAW else message.yaw
    rate = math.nan if message.type_mask & _IGNORE_YAW_RATE else message.yaw_rate
    return yaw, rate


def _target(message: Any, position: Vec3) -> Target | None:
    mask = message.type_mask
    target = Target(
        _masked(mask, _IGNORE_POSITION, position),
        _masked(mask, _IGNORE_VELOCITY, (message.vx, message.vy, message.vz)),
        NAN3 if mask & _FORCE else _masked(mask, _IGNORE_ACCELERATION, (message.afx, message.afy, message.afz)),
        *_yaw(message),
    )
    given = (*target.position_ned_m, *target.velocity_ned_m_s, *target.acceleration_ned_m_s2)
    return target if any(math.isfinite(value) for value in given) else None


def _body_velocity(message: Any) -> BodyVelocityTarget | None:
    velocity = _masked(message.type_mask, _IGNORE_VELOCITY, (message.vx, message.vy, message.vz))
    return BodyVelocityTarget(velocity, *_yaw(message)) if all(map(math.isfinite, velocity)) else None
