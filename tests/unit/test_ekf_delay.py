"""Late and out-of-order measurements: compensated, they give what they would have given on time."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from estimators.full_state_ekf import EkfParameters, initial, step
from models.samples import AnySample, GnssSample, ImuSample
from tests.unit.ekf_rig import Path, Rig

# A fast vehicle: 35 m/s and banked turns, so that .2 s are 7 m.
FAST = Path(
    amplitude_m=(60.0, 60.0, 5.0),
    frequency_rad_s=(0.3, 0.25, 0.2),
    amplitude_rad=(0.5, 0.1, 0.6),
    drift_m_s=(25.0, 15.0, 0.0),
)
DELAY_S = 0.2
ON_TIME = EkfParameters(gnss_speed_std_m_s=0.1, horizon_s=0.0)
LATE = EkfParameters(gnss_speed_std_m_s=0.1, gnss_delay_s=DELAY_S, horizon_s=DELAY_S)


def ticks(duration_s: float) -> list[list[AnySample]]:
    rig = Rig(FAST, seed=11, pose_every=0, gnss_every=10, gnss_std_m=0.1, magnetometer_every=5, barometer_every=4)
    first = rig.origin()
    batches = [samples for _, samples in rig.run(duration_s)]
    batches[0].append(first)
    # No fix while the filter aligns: which is the first it takes shall not depend on when it is handed over.
    for batch in batches[:50]:
        batch[:] = [sample for sample in batch if not isinstance(sample, GnssSample)]
    return batches


def handed_over_late(batches: list[list[AnySample]], delay_ticks: int) -> list[list[AnySample]]:
    """The same flight with every fix stamped and delivered so many IMU intervals later."""
    late: list[list[AnySample]] = [[] for _ in range(len(batches) + delay_ticks)]
    for k, batch in enumerate(batches):
        for sample in batch:
            if isinstance(sample, GnssSample):
                stamp_s = sample.time_s + DELAY_S
                late[k + delay_ticks].append(msgspec.structs.replace(sample, time_s=stamp_s, arrival_s=stamp_s))
            else:
                late[k].append(sample)
    return late[: len(batches)]


def horizon_states(batches: list[list[AnySample]], params: EkfParameters) -> dict[int, np.ndarray]:
    """Nominal state at the fusion horizon, by time in milliseconds."""
    state = initial(params)
    states = {}
    for batch in batches:
        state, _ = step(state, batch, params=params)
        if state.running:
            states[round(1e3 * state.time_s)] = state.nominal.copy()
    return states


def test_delayed_and_compensated_equals_undelayed() -> None:
    batches = ticks(20.0)
    on_time = horizon_states(batches, ON_TIME)
    late = horizon_states(handed_over_late(batches, 20), LATE)
    shared = sorted(set(on_time) & set(late))
    assert len(shared) > 1800
    worst = max(float(np.max(np.abs(on_time[k] - late[k]))) for k in shared)
    assert worst < 1e-6


def test_the_delay_matters_and_is_undone_at_the_output() -> None:
    batches = ticks(20.0)
    rig_path = FAST
    handed = handed_over_late(batches, 20)
    errors = {}
    for name, params in {"compensated": LATE, "ignored": EkfParameters(gnss_speed_std_m_s=0.1)}.items():
        state = initial(params)
        squared = []
        for batch in handed:
            state, output = step(state, batch, params=params)
            if output.estimate is not None and output.estimate.time_s > 10.0:
                truth = rig_path.position(output.estimate.time_s)
                squared.append(float(np.sum((truth - np.array(output.estimate.position_ned_m)) ** 2)))
        errors[name] = float(np.sqrt(np.mean(squared)))
    assert errors["compensated"] < 0.3
    assert errors["ignored"] > 3.0


def test_the_horizon_grows_by_itself_to_the_age_of_what_arrives() -> None:
    params = EkfParameters(gnss_speed_std_m_s=0.1, gnss_delay_s=DELAY_S)
    state = initial(params)
    for batch in handed_over_late(ticks(12.0), 20):
        state, output = step(state, batch, params=params)
    # A fix is handed over before the IMU sample of its own tick, so it is seen one interval younger.
    assert DELAY_S - 0.011 <= state.horizon_s < DELAY_S + 0.01
    assert output.estimate is not None
    assert output.estimate.time_s - state.time_s == pytest.approx(state.horizon_s, abs=0.011)
    truth = FAST.position(output.estimate.time_s)
    assert np.linalg.norm(truth - np.array(output.estimate.position_ned_m)) < 0.5


def test_order_of_arrival_within_the_horizon_does_not_matter() -> None:
    batches = ticks(10.0)
    params = EkfParameters(gnss_speed_std_m_s=0.1, horizon_s=0.1)
    rng = np.random.default_rng(0)
    shuffled: list[list[AnySample]] = [[] for _ in range(len(batches) + 10)]
    for k, batch in enumerate(batches):
        for sample in batch:
            late = 0 if isinstance(sample, ImuSample) or k < 50 else int(rng.integers(0, 9))
            shuffled[k + late].append(sample)
    straight = horizon_states(batches, params)
    mixed = horizon_states(shuffled[: len(batches)], params)
    shared = sorted(set(straight) & set(mixed))
    assert len(shared) > 900
    assert max(float(np.max(np.abs(straight[k] - mixed[k]))) for k in shared) < 1e-9


def test_the_rest_of_an_unknown_delay_is_learnt_from_manoeuvres() -> None:
    path = Path(amplitude_m=(40.0, 40.0, 2.0), frequency_rad_s=(0.5, 0.5, 0.3), amplitude_rad=(0.3, 0.2, 1.0))
    rig = Rig(path, seed=3, pose_every=0, gnss_every=10, gnss_std_m=0.3, gnss_delay_s=0.14, magnetometer_every=5)
    params = EkfParameters(gnss_delay_s=0.1, gnss_delay_std_s=0.05)
    state = initial(params)
    for _, samples in rig.run(60.0):
        state, _ = step(state, samples, params=params)
    assert params.gnss_delay_s + state.nominal[17] == pytest.approx(0.14, abs=0.012)
