"""Projection of the ladder to the rung a vehicle takes commands at."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from models.estimate import Estimate
from models.frames import Array, Vec3, rotation_from_quaternion
from models.kernel import kernel
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
    ``packed`` (27,) is inertia, lag, greatest rates and moments in a row, for the kernel.
    """

    max_thrust_n: float
    torque_scale_n_m: Vec3
    inertia_kg_m2: Vec3
    rate_loop_lag_s: Vec3 = (0.05, 0.05, 0.1)
    max_rate_rad_s: Vec3 = (3.0, 3.0, 1.5)
    aerodynamic_moments: tuple[tuple[float, ...], ...] = NO_AERODYNAMICS
    position_gain_1_s: float = 1.0
    max_speed_m_s: float = 3.0
    packed: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        moments = (moment for row in self.aerodynamic_moments for moment in row)
        packed = np.array(
            (*self.inertia_kg_m2, *self.rate_loop_lag_s, *self.max_rate_rad_s, *moments), dtype=np.float64
        )
        assert packed.shape == (27,), "a scale of the vehicle has an unexpected shape"
        object.__setattr__(self, "packed", packed)


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
    scale = min(1.0, vehicle.max_speed_m_s / max(math.hypot(*wanted), 1e-9))
    return wanted[0] * scale, wanted[1] * scale, wanted[2] * scale


def _rates(ladder: Ladder, estimate: Estimate, vehicle: VehicleScales) -> Vec3:
    motion = np.array(
        (
            *estimate.ned_from_body,
            *estimate.velocity_ned_m_s,
            *estimate.rates_body_rad_s,
            *ladder.torque_body_n_m,
        ),
        dtype=np.float64,
    )
    return rates_command(vehicle.packed, motion)


@kernel("UniTuple(f8, 3)(f8[::1], f8[::1])")
def rates_command(scales: Array, motion: Array) -> Vec3:
    """omega + lag (I^-1 tau + aerodynamic angular acceleration) [rad/s], each axis clipped.

    ``scales`` (27,) is ``VehicleScales.packed``; ``motion`` (13,): attitude, velocity NED, body rates, torque.
    """
    inertia, lag, limit = scales[0:3], scales[3:6], scales[6:9]
    body_rates, torque = motion[7:10], motion[10:13]
    ned_from_body = rotation_from_quaternion(motion[0:4])
    wanted = np.empty(3)
    for i in range(3):
        acceleration = torque[i] / inertia[i]
        for j in range(3):
            along = 0.0
            for n in range(3):
                along += ned_from_body[n, j] * motion[4 + n]
            acceleration += scales[9 + 6 * i + j] * along + scales[12 + 6 * i + j] * body_rates[j]
        wanted[i] = body_rates[i] + lag[i] * acceleration
        # Written so that what is not a number is never sent as a limit.
        if wanted[i] > limit[i]:
            wanted[i] = limit[i]
        elif wanted[i] < -limit[i]:
            wanted[i] = -limit[i]
    return wanted[0], wanted[1], wanted[2]
