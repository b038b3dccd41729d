"""Rigid body and standard atmosphere against textbook values and a readable twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from models import atmosphere
from models.frames import STANDARD_GRAVITY_M_S2, quaternion_multiply, rotation_from_quaternion
from models.rigid_body import rigid_body_derivative


def twin(state, force, torque, mass, inertia):
    q, omega = state[6:10], state[10:13]
    acceleration = rotation_from_quaternion(q) @ force / mass + [0, 0, STANDARD_GRAVITY_M_S2]
    q_dot = 0.5 * quaternion_multiply(q, np.concatenate([[0.0], omega]))
    omega_dot = np.linalg.solve(inertia, torque - np.cross(omega, inertia @ omega))
    return np.concatenate([state[3:6], acceleration, q_dot, omega_dot])


def test_rigid_body_equals_readable_twin():
    generator = np.random.default_rng(1)
    inertia = np.array([[0.82, 0.0, -0.12], [0.0, 1.1, 0.0], [-0.12, 0.0, 1.7]])
    for _ in range(20):
        state = generator.normal(size=13)
        state[6:10] /= np.linalg.norm(state[6:10])
        force, torque = generator.normal(size=3), generator.normal(size=3)
        out = np.empty(13)
        rigid_body_derivative(state, force, torque, 2.5, inertia, np.linalg.inv(inertia), out)
        assert_allclose(out, twin(state, force, torque, 2.5, inertia), atol=1e-12)


@pytest.mark.parametrize(
    ("height", "pressure", "temperature"),
    [(0.0, 101325.0, 288.15), (1000.0, 89874.6, 281.65), (5000.0, 54019.9, 255.65), (11000.0, 22632.1, 216.65)],
)
def test_standard_atmosphere_table(height, pressure, temperature):
    assert atmosphere.pressure_pa(height) == pytest.approx(pressure, rel=2e-4)
    assert atmosphere.temperature_k(height) == pytest.approx(temperature, abs=1e-6)
    assert atmosphere.height_m(atmosphere.pressure_pa(height)) == pytest.approx(height, abs=1e-6)


def test_density_at_sea_level_and_bad_pressure():
    assert atmosphere.density_kg_m3(101325.0, 288.15) == pytest.approx(1.225, rel=1e-4)
    with pytest.raises(ValueError, match="positive"):
        atmosphere.height_m(0.0)
