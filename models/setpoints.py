"""The ladder of commands a controller hands down, and the setpoint that is sent of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import msgspec

from models.arrays import Quaternion, Vec3


class Authority(StrEnum):
    """The rung of the ladder at which a vehicle takes commands; a property of its vehicle file."""

    POSITION = "position"
    VELOCITY = "velocity"
    ATTITUDE = "attitude"
    RATES = "rates"
    ACTUATOR = "actuator"


@dataclass(frozen=True, slots=True)
class Ladder:
    """One controller output on every rung at once.

    ``thrust_n`` is along body -z and positive up [N]; ``torque_body_n_m`` is what the controller asks of the mixer;
    ``saturated`` says that the mixer or an angle limit cut the command (integrators were frozen).
    """

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    acceleration_ned_m_s2: Vec3
    yaw_rad: float
    ned_from_body: Quaternion
    rates_body_rad_s: Vec3
    torque_body_n_m: Vec3
    thrust_n: float
    saturated: bool


class PositionSetpoint(msgspec.Struct, frozen=True, gc=False, array_like=True, tag="position"):
    """SET_POSITION_TARGET_LOCAL_NED: position with velocity and acceleration feed-forward, yaw."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    acceleration_ned_m_s2: Vec3
    yaw_rad: float


class VelocitySetpoint(msgspec.Struct, frozen=True, gc=False, array_like=True, tag="velocity"):
    """SET_POSITION_TARGET_LOCAL_NED: velocity and yaw."""

    velocity_ned_m_s: Vec3
    yaw_rad: float


class AttitudeSetpoint(msgspec.Struct, frozen=True, gc=False, array_like=True, tag="attitude"):
    """SET_ATTITUDE_TARGET with attitude and normalised thrust 0..1."""

    ned_from_body: Quaternion
    thrust: float


class RatesSetpoint(msgspec.Struct, frozen=True, gc=False, array_like=True, tag="rates"):
    """SET_ATTITUDE_TARGET with body rates [rad/s] and normalised thrust 0..1."""

    rates_body_rad_s: Vec3
    thrust: float


class ActuatorSetpoint(msgspec.Struct, frozen=True, gc=False, array_like=True, tag="actuator"):
    """SET_ACTUATOR_CONTROL_TARGET group 0: roll, pitch, yaw in -1..1, thrust in 0..1."""

    controls: tuple[float, float, float, float]


Setpoint = PositionSetpoint | VelocitySetpoint | AttitudeSetpoint | RatesSetpoint | ActuatorSetpoint
