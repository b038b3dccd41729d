"""The vehicle's own position and velocity loops: a target in, an attitude and a thrust out. Runs at 50 Hz.

Position error to velocity (P), velocity error to acceleration (PI), acceleration to a thrust vector, tilt limited,
and with the heading to an attitude. Entries of a target that are NaN are not controlled, as in MAVLink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from models.frames import STANDARD_GRAVITY_M_S2, Quaternion, Vec3
from sitl.navigation import NavigationState
from sitl.vehicle_parameters import VehicleParameters

NAN3: Vec3 = (math.nan, math.nan, math.nan)
_INTEGRAL_LIMIT_M_S2 = 4.0
# A standing vehicle takes off when asked for this much height or climb; less is noise of its own estimate.
_TAKE_OFF_HEIGHT_M = 0.3
_TAKE_OFF_CLIMB_M_S = 0.05


class Target(NamedTuple):
    """Where to be: position, velocity and acceleration in ned, heading or its rate; NaN where free.

    ``speed_m_s`` bounds the horizontal speed and ``climb_m_s`` the upward speed of the position loop.
    """

    position_ned_m: Vec3 = NAN3
    velocity_ned_m_s: Vec3 = NAN3
    acceleration_ned_m_s2: Vec3 = NAN3
    yaw_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan
    speed_m_s: float = math.inf
    climb_m_s: float = math.inf


class AttitudeThrust(NamedTuple):
    """Attitude ned_from_body and thrust [N]; ``idle`` when standing and nothing asks to climb."""

    ned_from_body: Quaternion
    thrust_n: float
    idle: bool


@dataclass(slots=True)
class PositionControl:
    """Memory of the loops: velocity integral [m/s^2] and the heading that is held [rad]."""

    integral_m_s2: list[float]
    yaw_rad: float

    def reset(self, yaw_rad: float) -> None:
        """Start afresh with a heading."""
        self.integral_m_s2 = [0.0, 0.0, 0.0]
        self.yaw_rad = yaw_rad


def _velocity_target(target: Target, nav: NavigationState, parameters: VehicleParameters) -> list[float]:
    velocity = [math.nan, math.nan, math.nan]
    for i in range(3):
        given, position = target.velocity_ned_m_s[i], target.position_ned_m[i]
        if math.isfinite(position):
            gain = parameters["MPC_Z_P"] if i == 2 else parameters["MPC_XY_P"]
            error = gain * (position - nav.position_ned_m[i])
            velocity[i] = error + (given if math.isfinite(given) else 0.0)
        elif math.isfinite(given):
            velocity[i] = given
    limit = min(parameters["MPC_XY_VEL_MAX"], target.speed_m_s)
    if math.isfinite(velocity[0]) and math.isfinite(velocity[1]):
        speed = math.hypot(velocity[0], velocity[1])
        if speed > limit:
            velocity[0] *= limit / speed
            velocity[1] *= limit / speed
    up = min(parameters["MPC_Z_VEL_MAX_UP"], target.climb_m_s)
    velocity[2] = max(-up, min(parameters["MPC_Z_VEL_MAX_DN"], velocity[2])) if math.isfinite(velocity[2]) else math.nan
    return velocity


def _acceleration(
    memory: PositionControl,
    target: Target,
    velocity: list[float],
    nav: NavigationState,
    p: VehicleParameters,
    dt_s: float,
) -> list[float]:
    acceleration = [0.0, 0.0, 0.0]
    for i in range(3):
        forward = target.acceleration_ned_m_s2[i]
        acceleration[i] = forward if math.isfinite(forward) else 0.0
        if math.isfinite(velocity[i]):
            error = velocity[i] - nav.velocity_ned_m_s[i]
            grown = memory.integral_m_s2[i] + p["MPC_Z_VEL_I" if i == 2 else "MPC_XY_VEL_I"] * error * dt_s
            memory.integral_m_s2[i] = max(-_INTEGRAL_LIMIT_M_S2, min(_INTEGRAL_LIMIT_M_S2, grown))
            acceleration[i] += p["MPC_Z_VEL_P" if i == 2 else "MPC_XY_VEL_P"] * error + memory.integral_m_s2[i]
    return acceleration


def _asks_to_climb(target: Target, nav: NavigationState) -> bool:
    height, climb, lift = target.position_ned_m[2], target.velocity_ned_m_s[2], target.acceleration_ned_m_s2[2]
    if math.isfinite(height):
        return height < nav.position_ned_m[2] - _TAKE_OFF_HEIGHT_M
    return climb < -_TAKE_OFF_CLIMB_M_S if math.isfinite(climb) else lift < 0.0


def attitude_from_thrust(up_ned: Vec3, yaw_rad: float) -> Quaternion:
    """Attitude whose body -z is the unit vector ``up_ned`` and whose x axis heads ``yaw_rad``: tilt after heading."""
    # In the heading frame: smallest rotation from straight up to the wanted direction.
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    forward, right, lift = c * up_ned[0] + s * up_ned[1], -s * up_ned[0] + c * up_ned[1], -up_ned[2]
    pitch = math.atan2(-forward, lift)
    roll = math.asin(max(-1.0, min(1.0, right)))
    return quaternion(roll, pitch, yaw_rad)


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Quaternion w, x, y, z of 3-2-1 Euler angles as a plain tuple."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def step(
    memory: PositionControl,
    target: Target,
    nav: NavigationState,
    parameters: VehicleParameters,
    *,
    mass_kg: float,
    max_thrust_n: float,
    standing: bool,
    dt_s: float,
) -> AttitudeThrust:
    """One pass of the loops; ``memory`` is mutated. While standing, anything but a wish to climb idles the motors."""
    if standing and not _asks_to_climb(target, nav):
        memory.reset(nav.euler_rad[2])
        return AttitudeThrust(quaternion(0.0, 0.0, nav.euler_rad[2]), 0.0, True)
    if math.isfinite(target.yaw_rad):
        memory.yaw_rad = target.yaw_rad
    elif math.isfinite(target.yaw_rate_rad_s):
        memory.yaw_rad += target.yaw_rate_rad_s * dt_s
    velocity = _velocity_target(target, nav, parameters)
    ax, ay, az = _acceleration(memory, target, velocity, nav, parameters, dt_s)
    lift = max(0.2 * STANDARD_GRAVITY_M_S2, STANDARD_GRAVITY_M_S2 - az)
    side = math.hypot(ax, ay)
    steepest = lift * math.tan(math.radians(parameters["MPC_TILTMAX_AIR"]))
    if side > steepest:
        ax, ay = ax * steepest / side, ay * steepest / side
    size = math.sqrt(ax * ax + ay * ay + lift * lift)
    attitude = attitude_from_thrust((ax / size, ay / size, -lift / size), memory.yaw_rad)
    thrust = min(max(mass_kg * size, parameters["MPC_MANTHR_MIN"] * max_thrust_n), 0.95 * max_thrust_n)
    return AttitudeThrust(attitude, thrust, False)
