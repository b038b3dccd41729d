"""Projection of the ladder to the rung a vehicle takes commands at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.estimate import Estimate
from models.frames import Vec3, rotation_from_quaternion
from models.parameters import QuadrotorParameters
from models.setpoints import (
    ActuatorSetpoint,
    AttitudeSetpoint,
    Authority,
    Ladder,
    PositionSetpoint,
    RatesSetpoint,
    Setpoint,
    VelocitySetpoint,
)

NO_AERODYNAMICS = ((0.0,) * 6, (0.0,) * 6, (0.0,) * 6)


@dataclass(frozen=True, slots=True)
class VehicleScales:
    """What turns newtons into a vehicle's own units; from its vehicle file.

    ``max_thrust_n`` is the thrust at normalised thrust 1, ``torque_scale_n_m`` the torques at control 1,
    ``rate_loop_lag_s`` the time constants of the autopilot's rate loop, ``aerodynamic_moments`` (3 rows of 6) the
    angular accelerations per body velocity and rate that its rate loop will suppress, ``position_gain_1_s`` the
    velocity commanded per metre of position error at ``velocity`` authority, up to ``max_speed_m_s``.
    """

    max_thrust_n: float
    torque_scale_n_m: Vec3
    inertia_kg_m2: Vec3
    rate_loop_lag_s: Vec3 = (0.05, 0.05, 0.1)
    max_rate_rad_s: Vec3 = (3.0, 3.0, 1.5)
    aerodynamic_moments: tuple[tuple[float, ...], ...] = NO_AERODYNAMICS
    position_gain_1_s: float = 1.0
    max_speed_m_s: float = 3.0


def scales_of(parameters: QuadrotorParameters) -> VehicleScales:
    """Scales of a vehicle whose parameters are known."""
    return VehicleScales(
        max_thrust_n=parameters.max_thrust_n,
        torque_scale_n_m=parameters.torque_scale_n_m,
        inertia_kg_m2=parameters.inertia_kg_m2,
        aerodynamic_moments=tuple(tuple(row) for row in parameters.aerodynamic_moments.tolist()),
    )


def project(ladder: Ladder, estimate: Estimate, authority: Authority, vehicle: VehicleScales) -> Setpoint:
    """The rung of ``ladder`` that ``authority`` sends, in the vehicle's own units; pure, raises nothing.

    ``rates`` inverts the autopilot's first-order rate loop: it is told the rate whose error, over the loop's lag, is
    the angular acceleration our torque and the vehicle's aerodynamics would give.
    """
    match authority:
        case Authority.POSITION:
            return PositionSetpoint(
                ladder.position_ned_m, ladder.velocity_ned_m_s, ladder.acceleration_ned_m_s2, ladder.yaw_rad
            )
        case Authority.VELOCITY:
            return VelocitySetpoint(_velocity(ladder, estimate, vehicle), ladder.yaw_rad)
        case Authority.ATTITUDE:
            return AttitudeSetpoint(ladder.ned_from_body, _thrust(ladder, vehicle))
        case Authority.RATES:
            return RatesSetpoint(_rates(ladder, estimate, vehicle), _thrust(ladder, vehicle))
        case Authority.ACTUATOR:
            roll, pitch, yaw = (
                _clip(torque / scale, 1.0)
                for torque, scale in zip(ladder.torque_body_n_m, vehicle.torque_scale_n_m, strict=True)
            )
            return ActuatorSetpoint((roll, pitch, yaw, _thrust(ladder, vehicle)))


def _clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _thrust(ladder: Ladder, vehicle: VehicleScales) -> float:
    return min(max(ladder.thrust_n / vehicle.max_thrust_n, 0.0), 1.0)


def _velocity(ladder: Ladder, estimate: Estimate, vehicle: VehicleScales) -> Vec3:
    """Reference velocity plus gain times position error, no faster than the vehicle may fly."""
    wanted = [
        velocity + vehicle.position_gain_1_s * (target - position)
        for velocity, target, position in zip(
            ladder.velocity_ned_m_s, ladder.position_ned_m, estimate.position_ned_m, strict=True
        )
    ]
    scale = min(1.0, vehicle.max_speed_m_s / max(float(np.linalg.norm(wanted)), 1e-9))
    return wanted[0] * scale, wanted[1] * scale, wanted[2] * scale


def _rates(ladder: Ladder, estimate: Estimate, vehicle: VehicleScales) -> Vec3:
    """omega + lag (I^-1 tau + aerodynamic angular acceleration), each axis clipped."""
    body_from_ned = rotation_from_quaternion(np.array(estimate.ned_from_body)).T
    motion = np.concatenate((body_from_ned @ np.array(estimate.velocity_ned_m_s), estimate.rates_body_rad_s))
    acceleration = np.array(ladder.torque_body_n_m) / vehicle.inertia_kg_m2
    acceleration += np.array(vehicle.aerodynamic_moments) @ motion
    wanted = np.array(estimate.rates_body_rad_s) + np.array(vehicle.rate_loop_lag_s) * acceleration
    limit = np.array(vehicle.max_rate_rad_s)
    p, q, r = np.clip(wanted, -limit, limit).tolist()
    return p, q, r
