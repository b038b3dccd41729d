"""LQR design against the printed gains and poles of Raja chapter 4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from controllers.gains import LqrWeights, load_gain_set
from controllers.lqr import augmented, design_loop, design_lqr, lqr_law
from models.linearise import linearise
from models.parameters import load_quadrotor
from models.quadrotor import (
    RATES,
    VELOCITY,
    attitude_model,
    derivative,
    height_model,
    horizontal_model,
    hover_inputs,
    linear_model,
    tilt_from_acceleration,
)

PARAMETERS = load_quadrotor()
# (4.15); the entries 0 of the last row are printed without decimals.
PRINTED_ATTITUDE_K = [
    ["2.58", "0.03", "0.008", "0.38", "-0.007", "0.001", "-0.002", "-0.1"],
    ["-0.03", "2.59", "-0.03", "-0.006", "0.38", "-0.004", "0.073", "-0.002"],
    ["-0.007", "0.02", "2.33", "0.001", "-0.002", "0.43", "0", "0"],
]


@pytest.fixture(scope="module")
def published() -> LqrWeights:
    gain_set = load_gain_set("lqr", "published")
    assert isinstance(gain_set, LqrWeights)
    return gain_set


def test_attitude_gains_are_the_24_printed_ones_to_their_rounding(published: LqrWeights) -> None:
    gains = design_lqr(published, PARAMETERS)
    for row, printed_row in zip(gains.attitude_k, PRINTED_ATTITUDE_K, strict=True):
        for value, printed in zip(row, printed_row, strict=True):
            decimals = len(printed.partition(".")[2])
            # Half a unit of the last printed digit, and one part in a hundred of it for a value on the edge.
            assert value == pytest.approx(float(printed), abs=0.505 * 10.0**-decimals), (value, printed)
    np.testing.assert_allclose(np.diag(gains.attitude_ki), [-7.07, -7.07, -6.0], atol=0.005)


def test_height_and_horizontal_gains(published: LqrWeights) -> None:
    gains = design_lqr(published, PARAMETERS)
    np.testing.assert_allclose(gains.height_k[0], [-5.5435, -3.5384], atol=1e-4)
    assert gains.height_ki[0, 0] == pytest.approx(3.873, abs=1e-3)
    np.testing.assert_allclose(gains.horizontal_k[0], [0.0065, 0.3487, 0.0046, 0.2445], atol=1e-4)
    np.testing.assert_allclose(gains.horizontal_k[1], [-0.3487, 0.0065, -0.2445, 0.0046], atol=1e-4)
    assert gains.horizontal_ki[1, 0] == pytest.approx(0.2191, abs=1e-4)
    assert gains.horizontal_ki[0, 1] == pytest.approx(-0.2191, abs=1e-4)


def _augmented_poles(model, k, ki):
    a, b = augmented(model)
    return np.sort_complex(np.linalg.eigvals(a - b @ np.hstack((k, ki))))


def test_true_augmented_poles(published: LqrWeights) -> None:
    gains = design_lqr(published, PARAMETERS)
    attitude = _augmented_poles(attitude_model(PARAMETERS), gains.attitude_k, gains.attitude_ki)
    expected = [-14.56 - 0.14j, -14.56 + 0.14j, -8.45, -3.26 - 3.54j, -3.26 + 3.54j, -3.23 - 3.52j, -3.23 + 3.52j]
    expected += [-3.14 - 3.65j, -3.14 + 3.65j, -0.226, -0.225]
    np.testing.assert_allclose(attitude, np.array(expected), atol=0.012)
    height = _augmented_poles(height_model(PARAMETERS), gains.height_k, gains.height_ki)
    np.testing.assert_allclose(height, [-1.457, -0.776 - 1.217j, -0.776 + 1.217j], atol=1e-3)


def test_design_loop_solves_the_riccati_equation() -> None:
    """(4.2): no other gain is cheaper; the cost of a gain comes from a Lyapunov equation, not from (4.5)."""
    model = height_model(PARAMETERS)
    q, r = np.array([0.2, 0.1, 3.0]), np.array([0.2])
    k, ki = design_loop(model, q, r)
    a, b = augmented(model)
    gain = np.hstack((k, ki))
    closed = a - b @ gain
    cost = solve_continuous_lyapunov(closed.T, -(np.diag(q) + gain.T @ np.diag(r) @ gain))
    rng = np.random.default_rng(5)
    for _ in range(20):
        other = gain + 0.05 * rng.standard_normal(gain.shape)
        worse = solve_continuous_lyapunov((a - b @ other).T, -(np.diag(q) + other.T @ np.diag(r) @ other))
        assert np.trace(worse) >= np.trace(cost)


def test_reference_model_is_the_printed_one() -> None:
    """Entries of (4.9) and (4.10) to the digits printed."""
    model = linear_model(PARAMETERS)
    np.testing.assert_allclose(model.a[3, 3:8], [-0.235, 0, 0, 0.1827, -9.81], atol=6e-3)
    np.testing.assert_allclose(model.a[4, 3:8], [0, -0.235, 0, 9.808, 0.1827], atol=6e-3)
    np.testing.assert_array_equal(model.a[9, 3:], [-0.111, -5.98, -0.432, 0, 0, 0, -3.71, -0.569, 0])
    np.testing.assert_array_equal(model.a[10, 3:], [4.453, -0.083, -1.032, 0, 0, 0, -0.149, -3.842, 0])
    np.testing.assert_array_equal(model.a[11, 3:], [0, 0, 0.454, 0, 0, 0, 0.052, -0.18, -0.614])
    np.testing.assert_allclose(np.abs(model.b).max(axis=0), [0.784, 45.872, 45.045, 32.68], rtol=1e-4)


def test_reference_model_is_the_linearisation_of_the_nonlinear_model() -> None:
    """(4.8) by finite differences; the moments per velocity are printed in body axes, so they turn by the heading."""
    trim = np.zeros(12)
    trim[8] = PARAMETERS.linearisation_yaw_rad
    a, b = linearise(lambda x, u: derivative(x, u, PARAMETERS, np.zeros(3)), trim, hover_inputs(PARAMETERS))
    model = linear_model(PARAMETERS)
    np.testing.assert_allclose(b, model.b, atol=1e-7)
    c, s = np.cos(trim[8]), np.sin(trim[8])
    turned = model.a.copy()
    turned[RATES, VELOCITY] = model.a[RATES, VELOCITY] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(a, turned, atol=1e-7)


def test_tilt_inverts_the_horizontal_model() -> None:
    model = horizontal_model(PARAMETERS)
    tilt = tilt_from_acceleration(PARAMETERS.linearisation_yaw_rad)
    np.testing.assert_allclose(model.b[2:4] @ tilt, np.eye(2), atol=1e-12)


def test_law_carries_the_integral_as_its_contribution(published: LqrWeights) -> None:
    gains, law = design_lqr(published, PARAMETERS), lqr_law(published, PARAMETERS)
    np.testing.assert_array_equal(law.gains.attitude_ki, -gains.attitude_ki)
    assert law.gains.height_ki == -gains.height_ki[0, 0]
    assert not law.feed_forward
    assert not law.gains.attitude_kr.any()


def test_a_heavier_vehicle_needs_proportional_torque(published: LqrWeights) -> None:
    """The gains follow the parameters they are designed on, not a constant of the code."""
    light = design_lqr(published, PARAMETERS)
    heavy = design_lqr(published, replace(PARAMETERS, mass_kg=2.0 * PARAMETERS.mass_kg))
    assert abs(heavy.height_k[0, 0]) > 1.1 * abs(light.height_k[0, 0])
