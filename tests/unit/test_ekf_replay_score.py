"""Scoring of a replay: time offset, wrap, holes, errors; on records whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.replay_score import Track, errors, euler_of_quaternions, fit_time_offset, near
from models.frames import quaternion_from_euler


def _rates(time_s: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(2.0 * time_s), 0.5 * np.cos(3.1 * time_s), 0.3 * np.sin(0.7 * time_s)], axis=1)


@pytest.mark.parametrize("offset_s", [-0.04, 0.0, 0.0123, 0.11])
def test_a_known_offset_is_found_in_spite_of_noise_and_bias(offset_s: float) -> None:
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 60.0, 0.01)
    other_s = np.arange(0.5, 59.0, 0.04)
    measured = _rates(time_s) + 0.02 * rng.standard_normal((time_s.size, 3)) + np.array([0.01, -0.02, 0.005])
    assert fit_time_offset(time_s, measured, other_s + offset_s, _rates(other_s)) == pytest.approx(offset_s, abs=1.5e-3)


def test_a_vehicle_that_does_not_turn_tells_no_offset() -> None:
    time_s = np.arange(0.0, 10.0, 0.01)
    assert fit_time_offset(time_s, np.zeros((1000, 3)), time_s, np.zeros((1000, 3))) == 0.0


def test_errors_are_those_put_in_across_the_wrap() -> None:
    time_s = np.arange(0.0, 20.0, 0.02)
    yaw = (0.9 * time_s + math.pi) % (2.0 * math.pi) - math.pi
    zero = np.zeros_like(time_s)
    truth = Track(time_s, np.stack([zero, zero, yaw], axis=1), np.zeros((time_s.size, 3)))
    off = (yaw + math.radians(2.0) + math.pi) % (2.0 * math.pi) - math.pi
    ours = Track(time_s, np.stack([zero + 0.01, zero, off], axis=1), np.full((time_s.size, 3), [3.0, 0.0, 4.0]))
    result = errors(ours, truth, 1.0, 18.0)
    assert result.roll_rms_deg == pytest.approx(math.degrees(0.01))
    assert result.pitch_rms_deg == 0.0
    assert result.heading_rms_deg == pytest.approx(2.0, abs=1e-9)
    assert result.position_rms_m == pytest.approx(5.0)


def test_nothing_is_scored_across_a_hole() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 3.0, 3.1])
    assert near(np.array([-0.1, 0.05, 1.0, 3.05, 4.0]), stamps).tolist() == [False, True, False, True, False]


def test_a_track_that_was_never_there_scores_none() -> None:
    time_s = np.arange(0.0, 5.0, 0.1)
    truth = Track(time_s, np.zeros((50, 3)), np.zeros((50, 3)))
    nothing = Track(time_s, np.full((50, 3), np.nan), np.full((50, 3), np.nan))
    result = errors(nothing, truth, 0.0, 5.0)
    assert result.roll_rms_deg is None
    assert result.position_rms_m is None


def test_euler_angles_of_quaternions_of_any_length() -> None:
    q = np.array([3.0 * quaternion_from_euler(0.3, -0.4, 2.0)])
    assert euler_of_quaternions(q)[0] == pytest.approx([0.3, -0.4, 2.0])
