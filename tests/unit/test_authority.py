"""Projection of the ladder to each rung."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers.authority import VehicleScales, project, scales_of
from models.frames import quaternion_from_euler, rotation_from_quaternion
from models.parameters import load_quadrotor
from models.setpoints import (
    ActuatorSetpoint,
    AttitudeSetpoint,
    Authority,
    Ladder,
    PositionSetpoint,
    RatesSetpoint,
    VelocitySetpoint,
)
from tests.unit.test_pi_cascade import estimate_at

PARAMETERS = load_quadrotor()
SCALES = scales_of(PARAMETERS)


def ladder(**changes) -> Ladder:
    values = {
        "position_ned_m": (1.0, 2.0, -3.0),
        "velocity_ned_m_s": (0.1, 0.2, 0.0),
        "acceleration_ned_m_s2": (0.0, 0.1, 0.0),
        "yaw_rad": 0.4,
        "ned_from_body": tuple(quaternion_from_euler(0.1, -0.05, 0.4)),
        "rates_body_rad_s": (0.0, 0.0, 0.0),
        "torque_body_n_m": (0.5, -0.2, 0.1),
        "thrust_n": 14.0,
        "saturated": False,
    }
    return Ladder(**{**values, **changes})


def test_actuator_controls_are_scaled_and_clipped() -> None:
    setpoint = project(ladder(), estimate_at(), Authority.ACTUATOR, SCALES)
    assert isinstance(setpoint, ActuatorSetpoint)
    assert setpoint.controls == pytest.approx((0.25, -0.1, 0.25, 0.5))
    wild = ladder(torque_body_n_m=(9.0, -9.0, 9.0), thrust_n=-4.0)
    assert project(wild, estimate_at(), Authority.ACTUATOR, SCALES) == ActuatorSetpoint((1.0, -1.0, 1.0, 0.0))
    assert project(ladder(thrust_n=99.0), estimate_at(), Authority.ACTUATOR, SCALES).controls[3] == 1.0


def test_position_and_attitude_pass_through() -> None:
    position = project(ladder(), estimate_at(), Authority.POSITION, SCALES)
    assert position == PositionSetpoint((1.0, 2.0, -3.0), (0.1, 0.2, 0.0), (0.0, 0.1, 0.0), 0.4)
    attitude = project(ladder(), estimate_at(), Authority.ATTITUDE, SCALES)
    assert attitude == AttitudeSetpoint(ladder().ned_from_body, 0.5)


def test_velocity_closes_position_and_keeps_the_speed_limit() -> None:
    near = project(ladder(), estimate_at(position=(0.5, 2.0, -3.0)), Authority.VELOCITY, SCALES)
    assert isinstance(near, VelocitySetpoint)
    assert near.velocity_ned_m_s == pytest.approx((0.6, 0.2, 0.0))
    far = project(ladder(), estimate_at(position=(-100.0, 50.0, 0.0)), Authority.VELOCITY, SCALES)
    assert math.hypot(*far.velocity_ned_m_s) == pytest.approx(SCALES.max_speed_m_s)


def test_rates_invert_the_rate_loop() -> None:
    """A first-order rate loop told this rate accelerates as torque and aerodynamics would make the bare vehicle."""
    scales = VehicleScales(
        max_thrust_n=28.0,
        torque_scale_n_m=(2.0, 2.0, 0.4),
        inertia_kg_m2=PARAMETERS.inertia_kg_m2,
        rate_loop_lag_s=(0.05, 0.04, 0.1),
        aerodynamic_moments=SCALES.aerodynamic_moments,
    )
    estimate = estimate_at(velocity=(0.3, -0.2, 0.1), euler=(0.1, 0.05, 1.0), rates=(0.1, -0.2, 0.05))
    small = ladder(torque_body_n_m=(0.05, -0.02, 0.01))
    setpoint = project(small, estimate, Authority.RATES, scales)
    assert isinstance(setpoint, RatesSetpoint)
    rates = np.array(estimate.rates_body_rad_s)
    acceleration = (np.array(setpoint.rates_body_rad_s) - rates) / scales.rate_loop_lag_s
    velocity_body = rotation_from_quaternion(np.array(estimate.ned_from_body)).T @ estimate.velocity_ned_m_s
    expected = np.array([0.05, -0.02, 0.01]) / PARAMETERS.inertia_kg_m2
    expected += PARAMETERS.aerodynamic_moments @ np.concatenate((velocity_body, rates))
    np.testing.assert_allclose(acceleration, expected, rtol=1e-9)
    wild = project(ladder(torque_body_n_m=(5.0, -5.0, 5.0)), estimate, Authority.RATES, scales)
    assert wild.rates_body_rad_s == (3.0, -3.0, 1.5)
