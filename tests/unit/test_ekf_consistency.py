"""Does the filter know how wrong it is? NEES and NIS by Monte Carlo, figures of the reference quadrotor, one hour."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from estimators.full_state_ekf import EkfParameters, initial, step
from tests.unit.ekf_rig import Path, QuadrotorPath, Rig

DURATION_S = 15.0
CIRCLE = QuadrotorPath(amplitude_m=(0.8, 0.8, 0.3), frequency_rad_s=(0.5, 0.5, 0.4))


def _monte_carlo(path: Path, params: EkfParameters, runs: int) -> tuple[np.ndarray, np.ndarray, list[float], int]:
    """NEES (runs, steps), errors (runs, steps, 15), all pose NIS, bias openings; biases start at random."""
    steps = round(DURATION_S * 100)
    nees, errors = np.full((runs, steps), np.nan), np.full((runs, steps, 15), np.nan)
    nis: list[float] = []
    opened = 0
    for run in range(runs):
        rig = Rig(path, seed=run)
        start = np.random.default_rng(1000 + run)
        rig.gyro_bias = params.initial_gyro_bias_std_rad_s * start.standard_normal(3)
        rig.accel_bias = params.initial_accel_bias_std_m_s2 * start.standard_normal(3)
        state = initial(params)
        for k, (_, samples) in enumerate(rig.run(DURATION_S)):
            state, output = step(state, samples, params=params)
            opened += sum("opened" in reset.reason for reset in output.resets)
            nis += [update.nis for update in output.innovations if update.source == "pose"]
            if output.estimate is not None:
                nees[run, k] = rig.nees(output.estimate)
                errors[run, k] = rig.error(output.estimate)
    return nees, errors, nis, opened


def test_nees_and_nis_with_mocap_in_fifteen_dimensions() -> None:
    runs = 10
    nees, _, nis, opened = _monte_carlo(Path(), EkfParameters(), runs)
    mean = np.mean(nees[:, 100:], axis=0)
    low, high = chi2.ppf([0.025, 0.975], 15 * runs) / runs
    inside = np.mean((mean > low) & (mean < high))
    assert 13.0 < np.mean(mean) < 16.5
    assert inside > 0.85
    assert np.mean(nis) == pytest.approx(4.0, abs=0.15)
    assert opened == 0


def test_figures_of_the_reference_quadrotor_with_drag_rows() -> None:
    params = EkfParameters(drag_1_s=0.235, wind_std_m_s=0.0)
    nees, errors, _, opened = _monte_carlo(CIRCLE, params, 4)
    rms = np.sqrt(np.mean(errors[:, 500:] ** 2, axis=(0, 1)))
    assert np.all(rms[0:3] < 1.3 * 0.64e-3)
    assert np.all(rms[3:6] < 1.3 * 5e-3)
    assert np.all(np.degrees(rms[6:9]) < 1.3 * 0.07)
    assert 13.0 < np.nanmean(nees[:, 100:]) < 16.5
    assert opened == 0


def test_one_simulated_hour_stays_consistent() -> None:
    # At a tenth of the IMU rate the hour costs seconds; the state must neither drift nor lose its positive covariance.
    rig = Rig(
        Path(amplitude_rad=(0.1, 0.08, 2.0), angular_frequency_rad_s=(0.3, 0.2, 0.05), frequency_rad_s=(0.2, 0.3, 0.1)),
        seed=5,
        imu_hz=10.0,
        pose_every=20,
    )
    params = EkfParameters()
    state = initial(params)
    nees = []
    for k, (t, samples) in enumerate(rig.run(3600.0)):
        state, output = step(state, samples, params=params)
        if t > 60.0 and k % 20 == 0:
            assert output.estimate is not None
            nees.append(rig.nees(output.estimate))
    assert 12.0 < np.mean(nees) < 18.0
    # The last ten minutes are no worse than the first.
    assert np.mean(nees[-300:]) < 1.25 * np.mean(nees[:300]) + 2.0
    assert np.linalg.eigvalsh(state.covariance[:15, :15]).min() > 0.0
    assert np.linalg.norm(state.nominal[6:10]) == pytest.approx(1.0, abs=1e-12)


def test_gnss_figure_of_the_reference_quadrotor() -> None:
    squared = []
    for seed in range(2):
        rig = Rig(CIRCLE, seed=seed, pose_every=0, gnss_every=10, magnetometer_every=2, barometer_every=4)
        params = EkfParameters()
        state = initial(params)
        origin_known = False
        for t, samples in rig.run(35.0):
            if not origin_known:
                samples = [*samples, rig.origin()]
                origin_known = True
            state, output = step(state, samples, params=params)
            if t > 15.0:
                assert output.estimate is not None
                squared.append(np.sum(rig.error(output.estimate)[:3] ** 2))
    assert np.sqrt(np.mean(squared)) < 0.35
