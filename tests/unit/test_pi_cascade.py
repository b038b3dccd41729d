"""Kernels of the cascade against readable numpy twins, mixer limits, anti-windup, yaw, and the PID law."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers import cascade, loops
from controllers.cascade import CascadeLimits, Command, seed, step
from controllers.flight_controller import prepare
from controllers.gains import load_gain_set
from controllers.loops import acceleration_of, tilt_of, turned
from controllers.mixer import THRUST_CUT, TILT_TORQUE_CUT, YAW_TORQUE_CUT, achievable, mixer_limits
from models.estimate import Estimate, Reference
from models.frames import STANDARD_GRAVITY_M_S2, quaternion_from_euler
from models.parameters import load_quadrotor
from tests.unit import cascade_twin

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


def packed(state: cascade_twin.TwinState) -> np.ndarray:
    """The twin's memory in the order of the kernels, up to the command."""
    return np.array(
        [
            *(state.time_s, *state.anchor, *state.anchor_velocity, *state.anchor_acceleration),
            *(state.anchor_yaw, state.anchor_yaw_rate, state.yaw, state.outer_active),
            *(*state.horizontal_z, state.height_z, *state.attitude_z),
            *(*state.horizontal_rate, state.height_rate, *state.attitude_rate),
            *(*state.tilt, state.thrust, *state.torque),
        ]
    )


def random_inputs(rng: np.random.Generator, time_s: float, scale: float) -> tuple[Estimate, Reference]:
    def triple(size: float) -> tuple[float, ...]:
        return tuple(rng.uniform(-size, size, 3).tolist())

    roll, pitch, _ = triple(0.6 * scale)
    estimate = estimate_at(
        time_s, triple(5.0 * scale), triple(3.0 * scale), (roll, pitch, rng.uniform(-3.1, 3.1)), triple(2.0 * scale)
    )
    reference = Reference(
        *(triple(5.0 * scale), triple(3.0 * scale), triple(2.0 * scale), triple(2.0 * scale)),
        yaw_rad=rng.uniform(-7.0, 7.0),
        yaw_rate_rad_s=rng.uniform(-0.5, 0.5),
    )
    return estimate, reference


@pytest.mark.parametrize("feed_forward", [True, False])
@pytest.mark.parametrize("kind", ["lqr", "pid"])
def test_seed_and_step_equal_their_numpy_twin(kind: str, feed_forward: bool) -> None:
    """Random flights of 8 steps with and without saturation, some of them with a given tilt; to 1e-12."""
    law = replace(prepare(load_gain_set(kind, "default"), PARAMETERS), feed_forward=feed_forward)
    rng, close = np.random.default_rng(1), {"rtol": 1e-12, "atol": 1e-12}
    saturated = set()
    for flight in range(60):
        scale = 10.0 ** rng.uniform(-3.0, 0.0)
        last = Command(tuple(rng.uniform(-0.2, 0.2, 2).tolist()), rng.uniform(5.0, 25.0), (0.1, -0.2, 0.05))
        estimate, reference = random_inputs(rng, 1.0, scale)
        outer = flight % 3 > 0
        state = seed(law, estimate, reference, last, outer_active=outer)
        twin = cascade_twin.seed(law, estimate, reference, last, outer_active=outer)
        np.testing.assert_allclose(state.memory[: loops.NED_FROM_BODY], packed(twin), **close)
        for index in range(8):
            estimate, reference = random_inputs(rng, 1.0 + 0.03 * index * (index % 4), scale)
            limits = CascadeLimits(rng.uniform(0.1, 0.5))
            tilt = (0.05, -0.1) if rng.random() < 0.3 else None
            state, ladder = step(state, estimate, reference, law=law, limits=limits, tilt_reference_rad=tilt)
            twin, expected = cascade_twin.step(
                twin, estimate, reference, law=law, limits=limits, tilt_reference_rad=tilt
            )
            np.testing.assert_allclose(state.memory[: loops.NED_FROM_BODY], packed(twin), **close)
            np.testing.assert_allclose(ladder.ned_from_body, expected.ned_from_body, **close)
            np.testing.assert_allclose(ladder.rates_body_rad_s, expected.rates, **close)
            np.testing.assert_allclose([ladder.thrust_n, *ladder.torque_body_n_m], packed(twin)[-4:], **close)
            assert ladder.saturated == expected.saturated
            saturated.add(ladder.saturated)
    assert saturated == {True, False}


def test_turns_are_inverse_to_each_other() -> None:
    rng = np.random.default_rng(1)
    for yaw, north, east in rng.uniform(-7, 7, (20, 3)):
        np.testing.assert_allclose(turned(yaw, north, east), cascade_twin.rotation(yaw) @ [north, east])
        np.testing.assert_allclose(acceleration_of(yaw, *tilt_of(yaw, north, east)), (north, east))


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
