"""What the filter does when things go wrong: jumped biases, gaps, outliers, a moved source, a reboot, late samples."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from estimators.full_state_ekf import EkfOutput, EkfParameters, EkfState, initial, step
from models.samples import AnySample, BatterySample, GnssSample, ImuSample
from tests.unit.ekf_rig import HOME, Path, QuadrotorPath, Rig

CIRCLE = QuadrotorPath(amplitude_m=(0.8, 0.8, 0.3), frequency_rad_s=(0.5, 0.5, 0.4))
MOCAP = EkfParameters()
GNSS = EkfParameters(origin=HOME)


def gnss_rig(seed: int = 3, gnss_every: int = 20) -> Rig:
    return Rig(Path(), seed=seed, pose_every=0, gnss_every=gnss_every, magnetometer_every=2, gnss_std_m=0.2)


def fly(rig: Rig, state: EkfState, params: EkfParameters, duration_s: float) -> tuple[EkfState, list[EkfOutput]]:
    outputs = []
    for _, samples in rig.run(duration_s):
        state, output = step(state, samples, params=params)
        outputs.append(output)
    return state, outputs


def without_fixes(samples: list[AnySample]) -> list[AnySample]:
    return [sample for sample in samples if not isinstance(sample, GnssSample)]


@pytest.mark.parametrize("seed", [0, 1])
def test_jumped_imu_biases_are_relearnt(seed: int) -> None:
    rig = Rig(CIRCLE, seed=seed)
    params = EkfParameters(drag_1_s=0.235, wind_std_m_s=0.0)
    state, _ = fly(rig, initial(params), params, 10.0)
    rig.gyro_bias = rig.gyro_bias + np.array([-0.08, 0.12, -0.18])
    relearnt, peak, opened = 0.0, 0.0, 0
    for t, samples in rig.run(8.0):
        state, output = step(state, samples, params=params)
        assert output.estimate is not None
        error = rig.error(output.estimate)
        opened += sum("opened" in reset.reason for reset in output.resets)
        peak = max(peak, math.degrees(float(np.linalg.norm(error[6:9]))))
        if np.linalg.norm(error[9:12]) > 0.03:
            relearnt = t - 11.0
    assert opened >= 1
    assert relearnt <= 2.0
    assert peak <= 4.0
    rig.accel_bias = rig.accel_bias + np.array([0.5, -0.3, -0.6])
    for t, samples in rig.run(8.0):
        state, output = step(state, samples, params=params)
        assert output.estimate is not None
        if np.linalg.norm(rig.error(output.estimate)[12:15]) > 0.15:
            relearnt = t - 19.0
    assert relearnt <= 1.5
    assert rig.nees(output.estimate) < 45.0


def test_position_is_declared_lost_after_three_silent_intervals_and_comes_back() -> None:
    rig = gnss_rig()
    state, outputs = fly(rig, initial(GNSS), GNSS, 20.0)
    assert outputs[-1].estimate is not None
    assert outputs[-1].estimate.position_valid
    assert state.health["gnss_position"].interval_s == pytest.approx(0.2, abs=1e-6)
    last_fix_s = state.health["gnss_position"].heard_arrival_s
    lost_s = None
    for t, samples in rig.run(3.0):
        state, output = step(state, without_fixes(samples), params=GNSS)
        assert output.estimate is not None
        assert output.estimate.attitude_valid
        if not output.estimate.position_valid and lost_s is None:
            lost_s = t
    assert lost_s is not None
    assert 0.6 < lost_s - last_fix_s < 0.6 + 0.1
    state, outputs = fly(rig, state, GNSS, 1.0)
    assert outputs[-1].estimate is not None
    assert outputs[-1].estimate.position_valid
    assert np.linalg.norm(rig.error(outputs[-1].estimate)[:3]) < 1.5


def test_one_outlier_is_rejected_reported_and_harmless() -> None:
    rig = gnss_rig()
    state, outputs = fly(rig, initial(GNSS), GNSS, 20.0)
    assert outputs[-1].estimate is not None
    before = rig.error(outputs[-1].estimate)
    t, samples = rig.step()
    state, output = step(state, [*without_fixes(samples), rig.gnss(t, (30.0, 0.0, 0.0))], params=GNSS)
    rejected = [update for update in output.innovations if update.source == "gnss_position"]
    assert len(rejected) == 1
    assert not rejected[0].accepted
    assert rejected[0].gate_ratio > 1.0
    assert rejected[0].innovation[0] == pytest.approx(30.0, abs=1.5)
    assert output.estimate is not None
    assert rig.error(output.estimate)[:3] == pytest.approx(before[:3], abs=0.1)
    assert not output.resets


def test_a_source_that_stays_elsewhere_is_believed_after_a_while_and_the_reset_reported() -> None:
    rig = gnss_rig()
    state, _ = fly(rig, initial(GNSS), GNSS, 20.0)
    resets = []
    for t, samples in rig.run(2.0):
        fixes = [sample for sample in samples if isinstance(sample, GnssSample)]
        moved = [rig.gnss(t, (30.0, 0.0, 0.0))] if fixes else []
        state, output = step(state, [*without_fixes(samples), *moved], params=GNSS)
        resets += output.resets
    assert [reset.source for reset in resets] == ["gnss_position"]
    assert resets[0].position_delta_ned_m[0] == pytest.approx(30.0, abs=2.0)
    assert resets[0].time_s == pytest.approx(21.0 + GNSS.reset_after_s, abs=0.5)
    assert output.estimate is not None
    assert rig.error(output.estimate)[0] == pytest.approx(-30.0, abs=2.0)


def test_mocap_that_moved_is_believed_with_its_heading() -> None:
    rig = Rig(CIRCLE, seed=2)
    state, _ = fly(rig, initial(MOCAP), MOCAP, 5.0)
    resets = []
    for t, samples in rig.run(3.0):
        pose = rig.pose(t)
        north, east, down = pose.position_ned_m
        moved = msgspec.structs.replace(pose, position_ned_m=(north + 5.0, east, down))
        state, output = step(state, [samples[0], moved], params=MOCAP)
        resets += [reset for reset in output.resets if "rejected" in reset.reason]
    assert {reset.source for reset in resets} == {"pose"}
    assert output.estimate is not None
    assert rig.error(output.estimate)[0] == pytest.approx(-5.0, abs=0.05)


def test_an_imu_gap_starts_the_alignment_anew_and_says_so() -> None:
    rig = Rig(CIRCLE, seed=4)
    state, _ = fly(rig, initial(MOCAP), MOCAP, 5.0)
    for _ in rig.run(2.0):
        pass
    state, outputs = fly(rig, state, MOCAP, 3.0)
    assert "aligned anew" in outputs[0].resets[0].reason
    assert outputs[0].estimate is None
    assert outputs[-1].estimate is not None
    assert np.linalg.norm(rig.error(outputs[-1].estimate)[:3]) < 0.01


def test_a_reboot_of_the_vehicle_starts_a_new_filter() -> None:
    state, _ = fly(Rig(CIRCLE, seed=5), initial(MOCAP), MOCAP, 5.0)
    again = Rig(CIRCLE, seed=6)
    state, outputs = fly(again, state, MOCAP, 5.0)
    assert "jumped back" in outputs[0].resets[0].reason
    assert outputs[-1].estimate is not None
    assert np.linalg.norm(again.error(outputs[-1].estimate)[:3]) < 0.01


def test_repeated_and_hopelessly_late_samples_are_dropped_and_counted() -> None:
    rig = Rig(CIRCLE, seed=7)
    state, _ = fly(rig, initial(MOCAP), MOCAP, 2.0)
    t, samples = rig.step()
    imu = samples[0]
    assert isinstance(imu, ImuSample)
    old = rig.pose(t - 1.0)
    state, output = step(state, [imu, imu, old], params=MOCAP)
    assert output.dropped == 2
    assert output.estimate is not None
    assert output.estimate.time_s == t


def test_gnss_stands_back_while_mocap_is_alive_and_takes_over_when_it_dies() -> None:
    rig = Rig(CIRCLE, seed=8, gnss_every=10, magnetometer_every=2)
    params = replace(MOCAP, gnss_position_std_m=0.5)
    state, outputs = fly(rig, initial(params), params, 5.0)
    used = {update.source for output in outputs for update in output.innovations}
    assert "pose" in used
    assert "gnss_position" not in used
    rig.pose_every = 0
    state, outputs = fly(rig, state, params, 5.0)
    assert outputs[-1].estimate is not None
    assert outputs[-1].estimate.position_valid
    assert "gnss_position" in {update.source for output in outputs for update in output.innovations}


def test_kinds_of_samples_the_filter_has_no_use_for_change_nothing() -> None:
    rig = Rig(CIRCLE, seed=9)
    state, _ = fly(rig, initial(MOCAP), MOCAP, 1.0)
    before = state.nominal.copy()
    battery = BatterySample(time_s=2.0, arrival_s=2.0, voltage_v=16.0, current_a=1.0, remaining=0.5)
    state, output = step(state, [battery], params=MOCAP)
    assert np.array_equal(state.nominal, before)
    assert not output.innovations
