"""Prediction: true poles of the whole cascade, margins, steps."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from controllers.closed_loop import LOOPS, closed_loop, frequency_response, step_responses
from controllers.design import ModelOptions, margins_of, poles_of, predict
from controllers.flight_controller import prepare
from controllers.gains import edited, load_gain_set
from models.parameters import load_quadrotor

PARAMETERS = load_quadrotor()
PUBLISHED = load_gain_set("lqr", "published")
NO_LAG_S = 1e-4


def test_slowest_pair_of_the_whole_cascade_without_lag() -> None:
    poles = poles_of(closed_loop(prepare(PUBLISHED, PARAMETERS), PARAMETERS, NO_LAG_S, NO_LAG_S))
    assert poles[0].real == pytest.approx(-0.315, abs=2e-3)
    assert poles[0].imag == pytest.approx(2.44, abs=5e-3)
    assert poles[0].damping == pytest.approx(0.13, abs=5e-3)
    assert poles[0].state in ("v_north", "v_east", "north", "east")


def test_motor_lag_is_in_the_poles() -> None:
    report = predict(PUBLISHED, PARAMETERS)
    fastest_pair = [pole for pole in report.poles if pole.state in ("p", "q")]
    assert fastest_pair
    # Without lag these are at -14.6 with damping 1; a lag of .05 s leaves about a third.
    assert all(0.25 < pole.damping < 0.45 for pole in fastest_pair)


def test_step_responses_equal_plain_integration() -> None:
    """Twin of the matrix exponential: small Euler steps."""
    law = prepare(load_gain_set("pid", "default"), PARAMETERS)
    loop = closed_loop(law, PARAMETERS, 0.05, 0.02)
    time_s, outputs, _ = step_responses(loop, 2.0, 41)
    state, dt = np.zeros((30, 6)), 2e-4
    sampled = [loop.c_output @ state]
    for k in range(1, round(2.0 / dt) + 1):
        state = state + dt * (loop.a @ state + loop.b_reference)
        if k % 250 == 0:
            sampled.append(loop.c_output @ state)
    assert len(sampled) == time_s.size
    np.testing.assert_allclose(np.array(sampled), outputs, atol=5e-3)


def test_frequency_response_equals_direct_solution() -> None:
    loop = closed_loop(prepare(PUBLISHED, PARAMETERS), PARAMETERS, 0.05, 0.015)
    omega = np.array([0.05, 1.0, 14.0, 120.0])
    fast = frequency_response(loop.a, loop.b_injection, loop.c_command, omega)
    for w, response in zip(omega, fast, strict=True):
        direct = loop.c_command @ np.linalg.solve(1j * w * np.eye(30) - loop.a, loop.b_injection)
        np.testing.assert_allclose(response, direct, rtol=1e-6, atol=1e-8)


def test_margins_of_known_loops() -> None:
    w = np.geomspace(0.01, 100.0, 600)
    s = 1j * w
    # 1 / (s (s + 1)^2): crossover .6823, phase margin 21.39 deg, gain margin 2 (6.02 dB) at w = 1.
    margins = margins_of(1.0 / (s * (s + 1.0) ** 2), w)
    assert margins.crossover_rad_s == pytest.approx(0.6823, abs=1e-3)
    assert margins.phase_deg == pytest.approx(21.39, abs=0.05)
    assert margins.gain_raise_db == pytest.approx(20.0 * math.log10(2.0), abs=0.01)
    assert margins.gain_lower_db is None
    assert margins.delay_s == pytest.approx(math.radians(21.39) / 0.6823, abs=2e-3)
    conditional = margins_of(20.0 * (s + 1.0) ** 2 / s**3, w)
    assert conditional.gain_raise_db is None
    # s^3 + K (s + 1)^2 is stable for K > 1/2 (Routh), so the gain may fall by a factor of 40.
    assert conditional.gain_lower_db == pytest.approx(-20.0 * math.log10(40.0), abs=0.02)


@pytest.mark.parametrize("loop_name", ["roll", "yaw", "height", "x"])
def test_gain_margin_is_where_the_loop_loses_stability(loop_name: str) -> None:
    """The gain of one loop raised by 98 % of its margin leaves the cascade stable, by 102 % does not."""
    report = predict(load_gain_set("lqr", "default"), PARAMETERS)
    loop = report.loops[LOOPS.index(loop_name)]
    assert loop.gain_raise_db is not None
    law = prepare(load_gain_set("lqr", "default"), PARAMETERS)
    whole = closed_loop(law, PARAMETERS, PARAMETERS.rotor_lag_s, report.delay_s)
    index = LOOPS.index(loop_name)
    for share, stable in ((0.98, True), (1.02, False)):
        factor = 10.0 ** (share * loop.gain_raise_db / 20.0)
        # Raising the gain of one loop: feed (factor - 1) times its command back in at the cut.
        raised = whole.a + (factor - 1.0) * np.outer(whole.b_injection[:, index], whole.c_command[index])
        assert (np.linalg.eigvals(raised).real.max() < 0.0) == stable


def test_default_set_meets_every_step_specification() -> None:
    for kind in ("lqr", "pid"):
        report = predict(load_gain_set(kind, "default"), PARAMETERS)
        for loop in report.loops:
            assert loop.step.overshoot_percent is not None
            assert loop.step.overshoot_percent <= loop.step.overshoot_limit_percent, (kind, loop.name)
            assert loop.step.rise_s is not None
            assert loop.step.rise_s <= loop.step.rise_limit_s, (kind, loop.name)
    missed = [w for w in predict(PUBLISHED, PARAMETERS).warnings if w.quantity in ("rise", "overshoot")]
    assert [(w.loop, w.quantity) for w in missed] == [("height", "rise")]


def test_damped_set_is_what_it_says() -> None:
    """The slowly ringing pair of the published weights (damping .13) is gone, and every margin is near its limit."""
    damped, default = (predict(load_gain_set("lqr", name), PARAMETERS) for name in ("damped", "default"))
    assert min(pole.damping for pole in default.poles) < 0.14
    assert min(pole.damping for pole in damped.poles) > 0.4
    for loop in damped.loops:
        assert loop.phase_margin_deg is not None
        assert loop.phase_margin_deg > 25.0
        assert loop.gain_margin_db is not None
        assert loop.gain_margin_db > 6.0
        assert loop.delay_margin_s is not None
        assert loop.delay_margin_s > 0.040


def test_warnings_are_worded_with_number_and_limit() -> None:
    texts = [warning.text for warning in predict(PUBLISHED, PARAMETERS).warnings]
    assert "Height rise 1.59 s, limit 1.5 s." in texts
    assert any(text.startswith("X phase margin") and text.endswith("limit 30°.") for text in texts)
    assert all(len(text) <= 60 for text in texts)


def test_unstable_set_is_flagged_and_not_raised() -> None:
    hot = edited(load_gain_set("pid", "default"), {"roll.d": 90.0, "position.p": 50.0, "position.d": 0.0})
    report = predict(hot, PARAMETERS)
    assert not report.stable
    assert not report.inner_stable
    assert report.poles[0].real > 0.0
    assert all(loop.phase_margin_deg is None for loop in report.loops)
    assert {w.quantity for w in report.warnings} >= {"stability"}
    assert b"nan" not in msgspec.json.encode(report).lower()


def test_more_delay_costs_margin() -> None:
    near = predict(PUBLISHED, PARAMETERS, ModelOptions(transport_delay_s=0.0))
    far = predict(PUBLISHED, PARAMETERS, ModelOptions(transport_delay_s=0.02))
    roll_near, roll_far = near.loops[0], far.loops[0]
    assert roll_near.delay_margin_s is not None
    assert roll_far.delay_margin_s is not None
    assert roll_near.delay_margin_s - roll_far.delay_margin_s == pytest.approx(0.02, abs=5e-4)
