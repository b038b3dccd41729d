"""Truth plant of the quadrotor against a readable numpy twin, the published linearisation and plain physics."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from models.frames import STANDARD_GRAVITY_M_S2, euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from models.parameters import load_quadrotor
from models.rigid_body import rigid_body_derivative
from sitl.plants import quadrotor

PARAMETERS = load_quadrotor()
CONSTANTS = quadrotor.constants_of(PARAMETERS)
DT = 0.002
CALM = np.zeros(3)
NONE = np.zeros(6)
HOVER = math.sqrt(PARAMETERS.mass_kg * STANDARD_GRAVITY_M_S2 / 4.0 / PARAMETERS.rotor_force_coefficient_n_s2)


def mapping():
    """Rotor speeds squared to thrust and torques, Raja (2.16)."""
    kf, kt = PARAMETERS.rotor_force_coefficient_n_s2, PARAMETERS.rotor_torque_coefficient_n_m_s2
    k = kf * PARAMETERS.arm_m / math.sqrt(2.0)
    return np.array([[kf, kf, kf, kf], [k, -k, -k, k], [k, k, -k, -k], [kt, -kt, kt, -kt]])


def twin_derivative(state, command, wind, disturbance):
    rotation = rotation_from_quaternion(state[6:10])
    thrust, *torque = mapping() @ state[13:] ** 2
    air_body = rotation.T @ (state[3:6] - wind)
    mass, inertia = PARAMETERS.mass_kg, np.diag(PARAMETERS.inertia_kg_m2)
    force = -mass * PARAMETERS.linear_drag_1_s * air_body + [0, 0, -thrust] + rotation.T @ disturbance[:3]
    torque = np.array(torque) + disturbance[3:]
    torque = torque + inertia @ PARAMETERS.aerodynamic_moments @ np.concatenate([air_body, state[10:13]])
    out = np.empty(17)
    rigid = np.empty(13)
    rigid_body_derivative(state[:13].copy(), force, torque, mass, inertia, np.linalg.inv(inertia), rigid)
    out[:13] = rigid
    out[13:] = (command - state[13:]) / PARAMETERS.rotor_lag_s
    return out


def derivative(state, command, wind=CALM, disturbance=NONE):
    out = np.empty(17)
    quadrotor.derivative(state, command, wind, disturbance, *CONSTANTS, np.empty(6), out)
    return out


def step(state, command, wind=CALM, disturbance=NONE, count=1):
    work = np.empty(quadrotor.WORK_SIZE)
    grounded = 0.0
    for _ in range(count):
        grounded = quadrotor.step(state, DT, command, wind, disturbance, *CONSTANTS, work)
    return grounded


def airborne(height_m=10.0, rotor=HOVER):
    state = quadrotor.initial_state()
    state[2] = -height_m
    state[13:] = rotor
    return state


def test_derivative_equals_twin():
    generator = np.random.default_rng(2)
    for _ in range(20):
        state = generator.normal(size=17)
        state[6:10] /= np.linalg.norm(state[6:10])
        state[13:] = generator.uniform(100, 680, 4)
        command, wind, disturbance = generator.uniform(100, 680, 4), generator.normal(size=3), generator.normal(size=6)
        expected = twin_derivative(state, command, wind, disturbance)
        assert_allclose(derivative(state, command, wind, disturbance), expected, rtol=1e-10, atol=1e-9)


def test_step_is_fourth_order():
    """Halving the step cuts the error of one second of tumbling flight about sixteen-fold."""
    work = np.empty(quadrotor.WORK_SIZE)
    start = airborne(100.0)
    start[10:13] = [1.0, -2.0, 0.7]
    command = np.array([500.0, 430.0, 460.0, 410.0])
    ends = []
    for count in (50, 100, 800):
        state = start.copy()
        for _ in range(count):
            quadrotor.step(state, 1.0 / count, command, CALM, NONE, *CONSTANTS, work)
        ends.append(state)
    coarse, fine = np.abs(ends[0] - ends[2]).max(), np.abs(ends[1] - ends[2]).max()
    assert 10.0 < coarse / fine < 25.0


def test_hover_speed_and_balance():
    assert pytest.approx(456.7, abs=0.2) == HOVER
    assert_allclose(derivative(airborne(), np.full(4, HOVER)), 0.0, atol=1e-9)


def published_a():
    """Raja (4.9) with the corrections of the page: 12 states, column 13 dropped, the 1 of row 9 in column 12."""
    a = np.zeros((12, 12))
    a[0:3, 3:6] = np.eye(3)
    a[3:6, 3:6] = -0.235 * np.eye(3)
    a[3, 6:8] = [0.1827, -9.81]
    a[4, 6:8] = [9.808, 0.1827]
    a[6:9, 9:12] = np.eye(3)
    a[9, [3, 4, 5, 9, 10]] = [-0.111, -5.98, -0.432, -3.71, -0.569]
    a[10, [3, 4, 5, 9, 10]] = [4.453, -0.083, -1.032, -0.149, -3.842]
    a[11, [5, 9, 10, 11]] = [0.454, 0.052, -0.18, -0.614]
    return a


def test_finite_differences_give_the_published_matrices():
    """(4.9) holds at yaw -.01863 rad; its velocity-to-moment columns are body velocities, equal to NED there to 2 %."""

    def euler_form(x):
        state = np.concatenate([x[:6], quaternion_from_euler(*x[6:9]), x[9:12], np.full(4, HOVER)])
        d = derivative(state, np.full(4, HOVER))
        eps = 1e-6
        ahead = state[6:10] + eps * d[6:10]
        behind = state[6:10] - eps * d[6:10]
        euler_rate = (euler_from_quaternion(ahead) - euler_from_quaternion(behind)) / (2 * eps)
        return np.concatenate([d[:6], euler_rate, d[10:13]])

    yaw = PARAMETERS.linearisation_yaw_rad
    trim = np.zeros(12)
    trim[8] = yaw
    a = np.column_stack(
        [(euler_form(trim + h) - euler_form(trim - h)) / 2e-5 for h in 1e-5 * np.eye(12)],
    )
    # Body axes at that yaw: turn the two horizontal velocities of the moment rows back.
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    a[9:12, 3:5] = a[9:12, 3:5] @ turn.T
    assert_allclose(a, published_a(), atol=6e-3)


def test_finite_differences_give_the_published_inputs():
    """(4.10): torque and thrust through the rotors at hover."""
    inverse = np.linalg.inv(mapping())

    def accelerations(inputs):
        state = airborne()
        state[13:] = np.sqrt(inverse @ inputs)
        d = derivative(state, state[13:])
        return np.concatenate([d[5:6], d[10:13]])

    trim = np.array([PARAMETERS.mass_kg * STANDARD_GRAVITY_M_S2, 0.0, 0.0, 0.0])
    b = np.column_stack([(accelerations(trim + h) - accelerations(trim - h)) / 2e-4 for h in 1e-4 * np.eye(4)])
    assert_allclose(b, np.diag([-0.784, 45.872, 45.045, 32.68]), atol=2e-3)


def test_free_fall_with_linear_drag_has_its_closed_form():
    state = airborne(500.0, rotor=0.0)
    step(state, np.zeros(4), count=1000)
    k, t, g = PARAMETERS.linear_drag_1_s, 2.0, STANDARD_GRAVITY_M_S2
    assert state[5] == pytest.approx(g / k * (1.0 - math.exp(-k * t)), rel=1e-9)
    assert state[2] + 500.0 == pytest.approx(g / k * (t - (1.0 - math.exp(-k * t)) / k), rel=1e-9)


def test_drag_only_takes_energy_away():
    """Rotors still, calm air: kinetic plus potential energy never grows (rotation damped by (4.9) apart)."""
    state = airborne(500.0, rotor=0.0)
    state[3:6] = [6.0, -4.0, -8.0]
    energies = []
    for _ in range(500):
        energies.append(0.5 * state[3:6] @ state[3:6] - STANDARD_GRAVITY_M_S2 * state[2])
        step(state, np.zeros(4))
    assert (np.diff(energies) < 0.0).all()


def test_wind_pushes_like_motion_against_calm_air():
    moving, blown = airborne(), airborne()
    moving[3:6] = [-3.0, 2.0, 0.5]
    a = derivative(moving, np.full(4, HOVER))
    b = derivative(blown, np.full(4, HOVER), wind=np.array([3.0, -2.0, -0.5]))
    assert_allclose(a[3:6], b[3:6], atol=1e-12)
    assert_allclose(a[10:13], b[10:13], atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(
    thrust=st.floats(-5, 40),
    roll=st.floats(-4, 4),
    pitch=st.floats(-4, 4),
    yaw=st.floats(-1, 1),
)
def test_mixer_stays_in_limits_and_sheds_yaw_first(thrust, roll, pitch, yaw):
    forces = np.empty(4)
    shed = quadrotor.mix(thrust, np.array([roll, pitch, yaw]), CONSTANTS.scalars, forces)
    low, high = CONSTANTS.scalars[quadrotor.FORCE_MIN], CONSTANTS.scalars[quadrotor.FORCE_MAX]
    assert (forces >= low - 1e-9).all()
    assert (forces <= high + 1e-9).all()
    got = mapping() @ (forces / PARAMETERS.rotor_force_coefficient_n_s2)
    wanted = np.array([thrust, roll, pitch, yaw])
    if not shed:
        assert_allclose(got, wanted, atol=1e-9)
    span = (abs(roll) + abs(pitch)) / (PARAMETERS.arm_m / math.sqrt(2.0)) / 2.0
    if span < high - low:
        assert_allclose(got[1:3], wanted[1:3], atol=1e-9)
    else:
        assert_allclose(got[1] * pitch, got[2] * roll, atol=1e-9)
    assert abs(got[3]) <= abs(yaw) + 1e-12


def test_largest_yaw_torque_at_hover():
    forces = np.empty(4)
    quadrotor.mix(PARAMETERS.mass_kg * STANDARD_GRAVITY_M_S2, np.array([0, 0, 9.0]), CONSTANTS.scalars, forces)
    yaw = (mapping() @ (forces / PARAMETERS.rotor_force_coefficient_n_s2))[3]
    assert yaw == pytest.approx(0.20, abs=0.012)


def test_stands_on_the_ground_in_wind_without_moving():
    state = quadrotor.initial_state(yaw_rad=0.7)
    start = state.copy()
    assert step(state, np.full(4, 300.0), wind=np.array([8.0, -6.0, -2.0]), count=5000) == 1.0
    assert_allclose(state[:13], start[:13], atol=1e-12)


def test_takes_off_lands_and_comes_to_rest():
    state = quadrotor.initial_state()
    step(state, np.full(4, 1.1 * HOVER), count=750)
    assert state[2] < -1.0
    state[3:5] = [0.4, -0.3]
    step(state, np.full(4, 0.9 * HOVER), count=3000)
    assert state[2] == 0.0
    assert_allclose(state[3:6], 0.0)
    rest = state.copy()
    assert step(state, np.full(4, 100.0), count=500) == 1.0
    assert_allclose(state[:2], rest[:2], atol=1e-12)
    roll, pitch, _ = euler_from_quaternion(state[6:10])
    assert abs(roll) < 1e-3
    assert abs(pitch) < 1e-3
