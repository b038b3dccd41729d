"""Kernels of the full-state filter: each beside a readable numpy twin, each Jacobian against finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from estimators import ekf_measurements as rows
from estimators import ekf_model as model
from estimators.kalman import (
    cholesky_in_place,
    gate_thresholds,
    innovation_covariance,
    joseph_update,
    normalised_square,
    reset_block,
    solve_rows,
)
from models.frames import Array, euler_from_quaternion, quaternion_from_rotation_vector, rotation_from_quaternion
from tests.unit.ekf_rig import product

GRAVITY = np.array([0.0, 0.0, 9.80665])
IMU = np.array([0.4, -0.7, 0.9, 1.2, -2.1, -10.3])


def skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def a_state(seed: int = 0) -> Array:
    """A nominal state with nothing at zero."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(model.NOMINAL_SIZE)
    x[model.QUATERNION] /= np.linalg.norm(x[model.QUATERNION])
    x[model.GYRO_BIAS] *= 0.05
    x[model.ACCEL_BIAS] *= 0.2
    x[model.GNSS_DELAY] *= 0.05
    x[model.EARTH_FIELD] *= 3e-5
    x[model.MAGNETIC_BIAS] *= 2e-6
    return x


def a_covariance(size: int = model.ERROR_SIZE) -> Array:
    root = np.random.default_rng(1).standard_normal((size, size))
    return root @ root.T + 0.1 * np.eye(size)


def moved(x: Array, error: Array) -> Array:
    """Nominal state moved by an error state, written from the definition q (x) exp(error)."""
    y = x.copy()
    y[0:6] += error[0:6]
    y[6:10] = product(x[6:10], quaternion_from_rotation_vector(np.ascontiguousarray(error[6:9])))
    y[10:24] += error[9:23]
    return y


def difference(x: Array, y: Array) -> Array:
    """Error state that takes x to y."""
    q = product(x[6:10] * np.array([1.0, -1.0, -1.0, -1.0]), y[6:10])
    return np.concatenate([y[0:6] - x[0:6], 2.0 * q[1:] * np.sign(q[0]), y[10:24] - x[10:24]])


def numeric_jacobian(function: Callable[[Array], Array], x: Array, size: int) -> Array:
    """Central differences of function(nominal) over the error state, shape (size, 23)."""
    jacobian = np.zeros((size, model.ERROR_SIZE))
    for k in range(model.ERROR_SIZE):
        h = 1e-10 if k >= 17 else 1e-5
        e = np.zeros(model.ERROR_SIZE)
        e[k] = h
        jacobian[:, k] = (function(moved(x, e)) - function(moved(x, -e))) / (2.0 * h)
    return jacobian


def propagated(x: Array, dt_s: float) -> Array:
    y = x.copy()
    model.propagate_nominal(y, IMU, dt_s)
    return y


def test_nominal_propagation_matches_its_twin() -> None:
    x = a_state()
    dt_s = 0.01
    w, a = IMU[:3] - x[10:13], IMU[3:] - x[13:16]
    half = quaternion_from_rotation_vector(0.5 * dt_s * w)
    middle = product(x[6:10], half)
    acceleration = rotation_from_quaternion(middle) @ a + GRAVITY
    twin = x.copy()
    twin[0:3] += dt_s * x[3:6] + 0.5 * dt_s**2 * acceleration
    twin[3:6] += dt_s * acceleration
    twin[6:10] = product(middle, half)
    assert propagated(x, dt_s) == pytest.approx(twin, abs=1e-13)
    assert np.linalg.norm(propagated(x, dt_s)[6:10]) == pytest.approx(1.0, abs=1e-15)


def test_propagation_there_and_back_is_nearly_nothing() -> None:
    x = a_state()
    y = propagated(x, 0.02)
    model.propagate_nominal(y, IMU, -0.02)
    assert y == pytest.approx(x, abs=2e-4)


def test_transition_matches_finite_differences_and_its_twin() -> None:
    x = a_state()
    dt_s = 2e-3
    phi = np.empty((9, 15))
    model.transition_rows(x, IMU, dt_s, phi)
    w, a = IMU[:3] - x[10:13], IMU[3:] - x[13:16]
    r = rotation_from_quaternion(product(x[6:10], quaternion_from_rotation_vector(0.5 * dt_s * w)))
    dynamics = np.zeros((15, 15))
    dynamics[0:3, 3:6] = np.eye(3)
    dynamics[3:6, 6:9] = -r @ skew(a)
    dynamics[3:6, 12:15] = -r
    dynamics[6:9, 6:9] = -skew(w)
    dynamics[6:9, 9:12] = -np.eye(3)
    step = dynamics * dt_s
    twin = np.eye(15) + step + 0.5 * step @ step
    assert phi == pytest.approx(twin[:9], abs=1e-15)
    numeric = numeric_jacobian(lambda y: difference(propagated(x, dt_s), propagated(y, dt_s)), x, model.ERROR_SIZE)
    full = np.eye(model.ERROR_SIZE)
    full[:9, :15] = phi
    # The second-order transition leaves out terms of the third order in the step.
    assert full == pytest.approx(numeric, abs=2e-7)


def test_covariance_propagation_matches_its_twin() -> None:
    x, p = a_state(), a_covariance()
    density = np.linspace(0.1, 1.0, model.ERROR_SIZE)
    dt_s = 0.01
    phi = np.eye(model.ERROR_SIZE)
    block = np.empty((9, 15))
    model.transition_rows(x, IMU, dt_s, block)
    phi[:9, :15] = block
    twin = phi @ p @ phi.T + np.diag(density) * dt_s
    model.propagate_covariance(x, p, IMU, dt_s, density)
    assert p == pytest.approx(twin, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("share_before", [0.0, 0.5])
def test_predict_weighs_two_samples(share_before: float) -> None:
    x, p = a_state(), a_covariance()
    later = IMU + 0.3
    density = np.ones(model.ERROR_SIZE)
    mean = share_before * IMU + (1.0 - share_before) * later
    y, q = x.copy(), p.copy()
    model.propagate_covariance(y, q, mean, 0.01, density)
    model.propagate_nominal(y, mean, 0.01)
    ring = np.zeros((3, 7))
    ring[2, 1:], ring[0, 1:] = IMU, later
    model.predict(x, p, ring, 5, share_before, 0.01, density)
    assert x == pytest.approx(y, abs=1e-15)
    assert p == pytest.approx(q, abs=1e-13)


def test_output_prediction_runs_through_the_ring_and_its_end() -> None:
    x = a_state()
    ring = np.zeros((4, 7))
    rng = np.random.default_rng(2)
    samples = [np.concatenate([[0.1 * k], rng.standard_normal(6)]) for k in range(6)]
    for k, sample in enumerate(samples):
        ring[k % 4] = sample
    output = np.empty(model.NOMINAL_SIZE)
    model.predict_output(x, ring, 2, 3, 0.5, 0.25, output)
    twin, now_s = x.copy(), 0.25
    for k in (3, 4, 5):
        model.propagate_nominal(twin, 0.5 * (samples[k - 1][1:] + samples[k][1:]), samples[k][0] - now_s)
        now_s = samples[k][0]
    assert output == pytest.approx(twin, abs=1e-14)
    p, euler, core = a_covariance(), np.empty(3), np.empty((15, 15))
    density = np.ones(model.ERROR_SIZE)
    tilt = model.carry_to_now(x, p, ring, 2, 3, 0.5, 0.25, density, output, euler, core)
    assert output == pytest.approx(twin, abs=1e-14)
    assert euler == pytest.approx(euler_from_quaternion(np.ascontiguousarray(twin[6:10])))
    assert tilt == max(p[6, 6], p[7, 7])
    model.propagate_covariance(x, p, samples[5][1:].copy(), 0.25, density)
    assert core == pytest.approx(p[:15, :15], abs=1e-12)


def test_injection_matches_the_definition_and_turns_the_covariance() -> None:
    x, p = a_state(), a_covariance()
    error = 0.05 * np.random.default_rng(3).standard_normal(model.ERROR_SIZE)
    y, q = x.copy(), p.copy()
    model.inject(y, q, error)
    assert y == pytest.approx(moved(x, error), abs=1e-14)
    turn = np.eye(model.ERROR_SIZE)
    turn[6:9, 6:9] -= 0.5 * skew(error[6:9])
    assert q == pytest.approx(turn @ p @ turn.T, abs=1e-12)


def test_joseph_update_matches_its_twin_and_rejects_without_touching_anything() -> None:
    n, m = model.ERROR_SIZE, 4
    rng = np.random.default_rng(4)
    p, h, e = a_covariance(), np.zeros((6, n)), np.zeros(6)
    h[:m] = rng.standard_normal((m, n))
    e[:m] = rng.standard_normal(m)
    variance = np.full(6, 0.5)
    correction, report = np.zeros(n), np.zeros(8)
    s = h[:m] @ p @ h[:m].T + 0.5 * np.eye(m)
    gain = p @ h[:m].T @ np.linalg.inv(s)
    left = np.eye(n) - gain @ h[:m]
    twin = left @ p @ left.T + 0.5 * gain @ gain.T
    nis = e[:m] @ np.linalg.solve(s, e[:m])
    before = p.copy()
    assert not joseph_update(p, e, h, variance, m, 0.5 * nis, correction, report)
    assert np.array_equal(p, before)
    assert not correction.any()
    assert report[1] == pytest.approx(2.0)
    assert joseph_update(p, e, h, variance, m, 2.0 * nis, correction, report)
    assert p == pytest.approx(twin, abs=1e-9)
    assert correction == pytest.approx(gain @ e[:m], abs=1e-10)
    assert report[0] == pytest.approx(nis, rel=1e-10)
    assert report[2 : 2 + m] == pytest.approx(np.diag(s), rel=1e-12)
    assert np.array_equal(p, p.T)


def test_cholesky_and_reset_block() -> None:
    p = a_covariance(5)
    factor = p.copy()
    assert cholesky_in_place(factor, 5)
    assert np.tril(factor) == pytest.approx(np.linalg.cholesky(p), abs=1e-12)
    assert not cholesky_in_place(-np.eye(3), 3)
    reset_block(p, 1, np.array([4.0, 9.0]))
    assert p[1, 1] == 4.0
    assert p[2, 2] == 9.0
    assert np.count_nonzero(p[1:3]) == 2
    assert np.count_nonzero(p[:, 1:3]) == 2


def test_parts_of_the_update_match_their_twins() -> None:
    p, h, variance = a_covariance(7), np.random.default_rng(6).standard_normal((6, 7)), np.linspace(0.1, 0.6, 6)
    hp, s = np.empty((3, 7)), np.empty((3, 3))
    innovation_covariance(p, h, variance, hp, s)
    assert hp == pytest.approx(h[:3] @ p)
    assert s == pytest.approx(h[:3] @ p @ h[:3].T + np.diag(variance[:3]))
    e = np.array([0.3, -0.2, 0.9])
    factor = np.ascontiguousarray(np.linalg.cholesky(s))
    assert normalised_square(factor, e) == pytest.approx(e @ np.linalg.solve(s, e))
    solved = hp.copy()
    solve_rows(factor, solved)
    assert solved == pytest.approx(np.linalg.solve(s, hp))


def test_a_covariance_that_is_none_is_refused() -> None:
    p = -np.eye(4)
    h, e, report = np.eye(6, 4), np.zeros(6), np.zeros(8)
    assert not joseph_update(p, e, h, np.full(6, 0.1), 2, 10.0, np.zeros(4), report)
    assert np.isinf(report[0])


def test_gate_thresholds_are_those_of_the_chi_square() -> None:
    # Tables: 1 row at .05 is 3.841, 3 rows at .01 is 11.345.
    assert gate_thresholds(0.05)[1] == pytest.approx(3.841, abs=1e-3)
    assert gate_thresholds(0.01)[3] == pytest.approx(11.345, abs=1e-3)


LEVER = np.array([0.3, -0.2, 0.5])
QUATERNION = quaternion_from_rotation_vector(np.array([0.5, -0.3, 1.1]))


def _call(name: str, x: Array, innovation: Array, jacobian: Array) -> int:
    """Run one row kernel on a state with a fixed measurement; returns its number of rows."""
    match name:
        case "position":
            rows.position_rows(x, np.array([1.0, 2.0, 3.0]), LEVER, 1.0, innovation, jacobian)
        case "velocity":
            rows.velocity_rows(x, np.array([1.0, 2.0, 3.0]), LEVER, IMU, innovation, jacobian)
        case "heading":
            rows.heading_row(x, 0.4, 0, innovation, jacobian)
        case "attitude":
            rows.attitude_rows(x, QUATERNION, 0, innovation, jacobian)
        case "magnetic":
            rows.magnetic_rows(x, np.array([2e-5, 1e-6, 4e-5]), innovation, jacobian)
        case "barometer":
            rows.barometer_row(x, 500.0, innovation, jacobian)
        case "range":
            rows.range_row(x, 3.0, 4.0, innovation, jacobian)
        case _:
            rows.drag_rows(x, IMU[3:], 0.235, innovation, jacobian)
    return {"heading": 1, "barometer": 1, "range": 1, "drag": 2}.get(name, 3)


NAMES = ["position", "velocity", "heading", "attitude", "magnetic", "barometer", "range", "drag"]


@pytest.mark.parametrize("name", NAMES)
def test_measurement_jacobian_against_finite_differences(name: str) -> None:
    x = a_state(7)
    if name == "range":
        x[6:10] = quaternion_from_rotation_vector(np.array([0.3, -0.2, 1.0]))
    if name == "attitude":
        # The rows are exact at the measured attitude, where a filter in lock works.
        x[6:10] = QUATERNION

    def predicted(y: Array) -> Array:
        innovation, scratch = np.zeros(6), np.zeros((6, model.ERROR_SIZE))
        count = _call(name, y, innovation, scratch)
        return -innovation[:count]

    innovation, jacobian = np.zeros(6), np.full((6, model.ERROR_SIZE), np.nan)
    count = _call(name, x, innovation, jacobian)
    numeric = numeric_jacobian(predicted, x, count)
    scale = 1e-5 if name == "magnetic" else 1.0
    assert jacobian[:count, :17] == pytest.approx(numeric[:, :17], abs=2e-8 * scale, rel=1e-6)
    assert jacobian[:count, 17:] == pytest.approx(numeric[:, 17:], abs=1e-6)


def test_measurement_predictions_match_their_twins() -> None:
    x = a_state(8)
    r = rotation_from_quaternion(x[6:10])
    w, f = IMU[:3] - x[10:13], IMU[3:] - x[13:16]
    delay = x[17]
    innovation, jacobian = np.zeros(6), np.zeros((6, model.ERROR_SIZE))
    measured = np.array([1.0, 2.0, 3.0])
    rows.position_rows(x, measured, LEVER, 1.0, innovation, jacobian)
    assert innovation[:3] == pytest.approx(measured - (x[:3] + r @ LEVER - x[3:6] * delay))
    rows.position_rows(x, measured, LEVER, 0.0, innovation, jacobian)
    assert innovation[:3] == pytest.approx(measured - (x[:3] + r @ LEVER))
    rows.velocity_rows(x, measured, LEVER, IMU, innovation, jacobian)
    assert innovation[:3] == pytest.approx(measured - (x[3:6] + r @ np.cross(w, LEVER) - delay * (r @ f + GRAVITY)))
    rows.magnetic_rows(x, measured, innovation, jacobian)
    assert innovation[:3] == pytest.approx(measured - r.T @ x[18:21] - x[21:24])
    rows.drag_rows(x, measured, 0.235, innovation, jacobian)
    assert innovation[:2] == pytest.approx((measured - x[13:16] + 0.235 * r.T @ x[3:6])[:2])
    rows.barometer_row(x, 500.0, innovation, jacobian)
    assert innovation[0] == pytest.approx(500.0 - (x[16] - x[2]))
    x[6:10] = quaternion_from_rotation_vector(np.array([0.3, -0.2, 1.0]))
    r = rotation_from_quaternion(x[6:10])
    rows.range_row(x, 3.0, 4.0, innovation, jacobian)
    assert innovation[0] == pytest.approx(3.0 - (4.0 - x[2]) / r[2, 2])


def test_heading_innovation_is_wrapped_before_any_gate() -> None:
    x = a_state()
    x[6:10] = quaternion_from_rotation_vector(np.array([0.0, 0.0, 3.1]))
    innovation, jacobian = np.zeros(6), np.zeros((6, model.ERROR_SIZE))
    rows.heading_row(x, -3.1, 0, innovation, jacobian)
    assert innovation[0] == pytest.approx(2.0 * np.pi - 6.2)


def test_attitude_innovation_takes_the_short_way_round() -> None:
    x = a_state()
    turn = np.array([0.02, -0.3, 0.5])
    target = -product(x[6:10], quaternion_from_rotation_vector(turn))
    innovation, jacobian = np.zeros(6), np.zeros((6, model.ERROR_SIZE))
    rows.attitude_rows(x, target, 0, innovation, jacobian)
    assert innovation[:3] == pytest.approx(turn, abs=1e-12)
