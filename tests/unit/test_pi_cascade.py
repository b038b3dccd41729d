"""Kernels of the cascade against readable numpy twins, mixer limits, anti-windup, yaw, and the PID law."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import cascade
from controllers.cascade import CascadeLimits, Command, seed, step
from controllers.flight_controller import prepare
from controllers.gains import load_gain_set
from controllers.loops import acceleration_of, attitude_direct, feed_forward_torque, horizontal_direct, tilt_of, turned
from controllers.mixer import THRUST_CUT, TILT_TORQUE_CUT, YAW_TORQUE_CUT, achievable, mixer_limits
from models.estimate import Estimate, Reference
from models.frames import STANDARD_GRAVITY_M_S2, quaternion_from_euler
from models.parameters import load_quadrotor

PARAMETERS = load_quadrotor()
LIMITS = mixer_limits(PARAMETERS)
LAW = prepare(load_gain_set("pid", "default"), PARAMETERS)
HOVER_N = PARAMETERS.mass_kg * STANDARD_GRAVITY_M_S2


def estimate_at(
    time_s=0.0, position=(0.0, 0.0, -2.0), velocity=(0.0, 0.0, 0.0), euler=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)
) -> Estimate:
    return Estimate(
        time_s=time_s,
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        ned_from_body=tuple(quaternion_from_euler(*euler)),
        euler_rad=euler,
        rates_body_rad_s=rates,
        gyro_bias_rad_s=(0.0, 0.0, 0.0),
        accel_bias_m_s2=(0.0, 0.0, 0.0),
        covariance=np.zeros((15, 15)),
        position_valid=True,
        attitude_valid=True,
    )


def rotation(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s], [-s, c]])


def test_loop_kernels_equal_their_twins() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        yaw, model_yaw = rng.uniform(-7, 7), rng.uniform(-0.1, 0.1)
        offset, velocity, ref, acc = rng.standard_normal((4, 2))
        k, k_r = rng.standard_normal((2, 4)), rng.standard_normal((2, 2))
        np.testing.assert_allclose(turned(yaw, offset), rotation(yaw) @ offset)
        tilt = np.array([[0, 1], [-1, 0]]) @ rotation(yaw) @ acc / STANDARD_GRAVITY_M_S2
        np.testing.assert_allclose(tilt_of(yaw, acc), tilt)
        np.testing.assert_allclose(acceleration_of(yaw, tilt), acc)
        frame = rotation(yaw - model_yaw)
        twin = tilt - k @ np.concatenate((frame @ offset, frame @ velocity)) + k_r @ frame @ ref
        np.testing.assert_allclose(horizontal_direct(yaw, model_yaw, offset, velocity, ref, acc, k, k_r), twin)
        state, reference, torque = rng.standard_normal(8), rng.standard_normal(3), rng.standard_normal(3)
        ka, kra = rng.standard_normal((3, 8)), rng.standard_normal((3, 3))
        np.testing.assert_allclose(
            attitude_direct(state, reference, torque, ka, kra), torque - ka @ state + kra @ reference
        )
        v, rates = rng.standard_normal(3), rng.standard_normal(3)
        inertia, moments = np.array(PARAMETERS.inertia_kg_m2), PARAMETERS.aerodynamic_moments
        motion = np.concatenate((rotation(yaw) @ v[:2], [v[2]], rates))
        np.testing.assert_allclose(feed_forward_torque(yaw, v, rates, inertia, moments), -inertia * (moments @ motion))


def rotor_forces(thrust_and_torques: np.ndarray) -> np.ndarray:
    """(2.15)-(2.16) inverted: the four rotor forces."""
    lever, yaw_lever = LIMITS[0], LIMITS[1]
    mixing = np.array(
        [
            [1, 1, 1, 1],
            [lever, -lever, -lever, lever],
            [lever, lever, -lever, -lever],
            [yaw_lever, -yaw_lever, yaw_lever, -yaw_lever],
        ]
    )
    return np.linalg.solve(mixing, thrust_and_torques)


def test_mixer_gives_what_the_rotors_can_and_no_more() -> None:
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(3000):
        wanted = np.array([rng.uniform(-5, 35), *rng.uniform(-4, 4, 2), rng.uniform(-0.6, 0.6)])
        wanted *= rng.uniform(0, 1)
        given = np.empty(4)
        cut = achievable(wanted, LIMITS, given)
        forces = rotor_forces(given)
        assert forces.min() >= LIMITS[2] - 1e-9
        assert forces.max() <= LIMITS[3] + 1e-9
        free = rotor_forces(wanted)
        fits = free.min() >= LIMITS[2] - 1e-12 and free.max() <= LIMITS[3] + 1e-12
        assert (cut == 0) == fits
        if cut == 0:
            np.testing.assert_array_equal(given, wanted)
        if not cut & TILT_TORQUE_CUT:
            np.testing.assert_array_equal(given[1:3], wanted[1:3])  # roll and pitch are kept above all
        assert abs(given[3]) <= abs(wanted[3]) + 1e-12
        seen |= {flag for flag in (THRUST_CUT, TILT_TORQUE_CUT, YAW_TORQUE_CUT) if cut & flag}
    assert seen == {THRUST_CUT, TILT_TORQUE_CUT, YAW_TORQUE_CUT}


def test_largest_yaw_torque_at_hover() -> None:
    given = np.empty(4)
    assert achievable(np.array([HOVER_N, 0.0, 0.0, 1.0]), LIMITS, given) == YAW_TORQUE_CUT
    assert given[3] == pytest.approx(0.19, abs=0.01)


def test_pid_gains_per_unit_inertia_and_mass() -> None:
    """A pure roll error of .01 rad asks for 120 * .01 * I_x, a height error of .1 m below for 12 * .1 * m more."""
    here = Reference((0.0, 0.0, -2.0))
    state = seed(LAW, estimate_at(), here, cascade.hover_command(LAW.vehicle))
    tilted = estimate_at(euler=(0.01, 0.0, 0.0), rates=(0.1, 0.0, 0.0))
    _, ladder = step(state, tilted, here, law=LAW, limits=CascadeLimits())
    assert ladder.torque_body_n_m[0] == pytest.approx(-(120 * 0.01 + 15 * 0.1) * PARAMETERS.inertia_kg_m2[0])
    _, ladder = step(state, estimate_at(position=(0.0, 0.0, -1.9)), here, law=LAW, limits=CascadeLimits())
    assert ladder.thrust_n == pytest.approx(HOVER_N + 12 * 0.1 * PARAMETERS.mass_kg)


@pytest.mark.parametrize("kind", ["lqr", "pid"])
def test_yaw_does_not_jump_through_pi(kind: str) -> None:
    law = prepare(load_gain_set(kind, "default"), PARAMETERS)
    reference = Reference((0.0, 0.0, -2.0), yaw_rad=math.pi - 0.001)
    state = seed(law, estimate_at(euler=(0, 0, math.pi - 0.001)), reference, cascade.hover_command(law.vehicle))
    torques = []
    for index, yaw in enumerate((math.pi - 0.001, -math.pi + 0.001, math.pi - 0.001)):
        state, ladder = step(
            state, estimate_at(0.01 * index, euler=(0, 0, yaw)), reference, law=law, limits=CascadeLimits()
        )
        torques.append(ladder.torque_body_n_m[2])
    assert max(torques) - min(torques) < 0.01


@pytest.mark.parametrize("kind", ["lqr", "pid"])
def test_integrals_freeze_while_tilt_is_limited_and_resume_inwards(kind: str) -> None:
    law = prepare(load_gain_set(kind, "default"), PARAMETERS)
    far = Reference((40.0, 0.0, -2.0))
    state = seed(law, estimate_at(), Reference((0.0, 0.0, -2.0)), Command((0.0, -0.34), HOVER_N, (0.0, 0.0, 0.0)))
    integrals = []
    for index in range(60):
        state, ladder = step(state, estimate_at(0.01 * index), far, law=law, limits=CascadeLimits())
        integrals.append(float(state.horizontal_integral_ned_m_s2[0]))
    assert ladder.saturated
    assert integrals[-1] == integrals[-2]  # frozen
    assert integrals[-1] < STANDARD_GRAVITY_M_S2 * 0.5
    back = Reference((-0.5, 0.0, -2.0))
    for index in range(60, 70):
        state, _ = step(state, estimate_at(0.01 * index), back, law=law, limits=CascadeLimits())
    assert state.horizontal_integral_ned_m_s2[0] < integrals[-1]


def test_height_integral_freezes_at_full_thrust() -> None:
    law = prepare(load_gain_set("lqr", "default"), PARAMETERS)
    state = seed(law, estimate_at(), Reference((0.0, 0.0, -2.0)), cascade.hover_command(law.vehicle))
    for index in range(200):
        high = Reference((0.0, 0.0, -30.0))
        state, ladder = step(state, estimate_at(0.1 * index), high, law=law, limits=CascadeLimits())
    assert ladder.saturated
    # One step of .1 s at most beyond the limit: 28 m * 5 N/(m s) * .1 s.
    assert ladder.thrust_n < PARAMETERS.max_thrust_n + 15.0


def test_tilt_limit_keeps_the_direction() -> None:
    state = seed(LAW, estimate_at(), Reference((0.0, 0.0, -2.0)), cascade.hover_command(LAW.vehicle))
    _, ladder = step(state, estimate_at(), Reference((30.0, 30.0, -2.0)), law=LAW, limits=CascadeLimits(tilt_rad=0.2))
    _, x, y, _ = ladder.ned_from_body
    thrust_axis_tilt = math.acos(1.0 - 2.0 * (x * x + y * y))
    assert thrust_axis_tilt == pytest.approx(0.2, abs=2e-3)
    assert x == pytest.approx(-y, rel=0.02)  # east needs +roll, north needs -pitch, equally


def test_same_estimate_twice_integrates_nothing() -> None:
    reference = Reference((1.0, 0.0, -2.0))
    state = seed(LAW, estimate_at(), reference, cascade.hover_command(LAW.vehicle))
    state, _ = step(state, estimate_at(0.01), reference, law=LAW, limits=CascadeLimits())
    first, one = step(state, estimate_at(0.02), reference, law=LAW, limits=CascadeLimits())
    _, two = step(first, estimate_at(0.02), reference, law=LAW, limits=CascadeLimits())
    assert one == two


def test_given_tilt_bypasses_the_horizontal_loop_and_is_left_without_a_jump() -> None:
    reference = Reference((5.0, 0.0, -2.0))
    state = seed(LAW, estimate_at(), reference, cascade.hover_command(LAW.vehicle))
    state, ladder = step(
        state, estimate_at(0.0), reference, law=LAW, limits=CascadeLimits(), tilt_reference_rad=(0.05, -0.1)
    )
    np.testing.assert_allclose(ladder.ned_from_body, quaternion_from_euler(0.05, -0.1, 0.0))
    before = state.command
    state, _ = step(state, estimate_at(0.0), reference, law=LAW, limits=CascadeLimits())
    np.testing.assert_allclose(state.command.tilt_rad, before.tilt_rad, atol=1e-12)
    np.testing.assert_allclose(state.command.torque_n_m, before.torque_n_m, atol=1e-12)
