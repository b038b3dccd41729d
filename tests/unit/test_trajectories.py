"""Trajectories: no steps but the step, derivatives that belong together, limits, ranges."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from gcs.offboard.trajectories import (
    FIELDS,
    Circle,
    FigureEight,
    GoTo,
    Hover,
    StepResponse,
    Trajectory,
    TrajectoryError,
    describe,
    evaluate,
    validate,
)
from models.estimate import Reference

REST = Reference((0.4, -0.7, -2.5), yaw_rad=0.3)
MOVING = Reference((3.0, 1.0, -2.0), (0.8, -0.5, 0.1), (0.2, 0.3, 0.0), yaw_rad=-2.0)
SMOOTH: list[Trajectory] = [
    Hover(),
    GoTo(north_m=5.0, east_m=-3.0, height_m=4.0, yaw_rad=2.8),
    GoTo(north_m=0.4, east_m=-0.7, height_m=2.5),
    Circle(),
    Circle(radius_m=6.0, rate_rad_s=-0.4, height_m=8.0, centre_north_m=10.0),
    FigureEight(),
]


@pytest.mark.parametrize("trajectory", SMOOTH, ids=describe)
@pytest.mark.parametrize("start", [REST, MOVING], ids=["rest", "moving"])
def test_begins_where_the_reference_was_and_never_steps(trajectory: Trajectory, start: Reference) -> None:
    begin = evaluate(trajectory, 0.0, start).reference
    np.testing.assert_allclose(begin.position_ned_m, start.position_ned_m, atol=1e-9)
    np.testing.assert_allclose(begin.velocity_ned_m_s, start.velocity_ned_m_s, atol=1e-9)
    assert begin.yaw_rad == pytest.approx(start.yaw_rad)
    times = np.arange(0.0, 40.0, 0.01)
    references = [evaluate(trajectory, float(t), start).reference for t in times]
    position = np.array([r.position_ned_m for r in references])
    velocity = np.array([r.velocity_ned_m_s for r in references])
    yaw = np.array([r.yaw_rad for r in references])
    assert np.abs(np.diff(position, axis=0)).max() < 0.05
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.06
    assert np.abs(np.diff(yaw)).max() < 0.006


@pytest.mark.parametrize("trajectory", SMOOTH, ids=describe)
@pytest.mark.parametrize("start", [REST, MOVING], ids=["rest", "moving"])
def test_velocity_and_acceleration_are_the_derivatives(trajectory: Trajectory, start: Reference) -> None:
    h = 1e-4
    for t in np.linspace(0.05, 30.0, 120):
        before, now, after = (evaluate(trajectory, float(t + d), start).reference for d in (-h, 0.0, h))
        slope = (np.array(after.position_ned_m) - before.position_ned_m) / (2 * h)
        np.testing.assert_allclose(now.velocity_ned_m_s, slope, atol=2e-4)
        bend = (np.array(after.velocity_ned_m_s) - before.velocity_ned_m_s) / (2 * h)
        np.testing.assert_allclose(now.acceleration_ned_m_s2, bend, atol=5e-3)
        jolt = (np.array(after.acceleration_ned_m_s2) - before.acceleration_ned_m_s2) / (2 * h)
        np.testing.assert_allclose(now.jerk_ned_m_s3, jolt, atol=5e-2)
        assert now.yaw_rate_rad_s == pytest.approx((after.yaw_rad - before.yaw_rad) / (2 * h), abs=1e-3)


def test_circle_is_the_one_of_the_paper() -> None:
    """(4.26)-(4.28) once the way in is flown: .8 sin(.5 t), .8 cos(.5 t) at 1 m; a lap lasts 4 pi seconds."""
    laps = [evaluate(Circle(), float(t), REST).lap for t in np.arange(0.0, 40.0, 0.01)]
    entry_s = laps.index(1) * 0.01
    for t in (0.0, 1.0, 7.3):
        reference = evaluate(Circle(), entry_s + t, REST).reference
        expected = (0.8 * math.sin(0.5 * t), 0.8 * math.cos(0.5 * t), -1.0)
        np.testing.assert_allclose(reference.position_ned_m, expected, atol=0.005)
    assert (laps.index(2) - laps.index(1)) * 0.01 == pytest.approx(4.0 * math.pi, abs=0.02)
    assert evaluate(Circle(), 20.0, REST).progress is None


def test_go_to_keeps_its_limits_and_rests_at_the_target() -> None:
    target = GoTo(north_m=12.0, east_m=-9.0, height_m=6.0, speed_m_s=1.2, acceleration_m_s2=0.8, yaw_rad=-2.9)
    progress, speeds, accelerations = [], [], []
    for t in np.arange(0.0, 60.0, 0.05):
        now = evaluate(target, float(t), REST)
        progress.append(now.progress)
        speeds.append(math.hypot(*now.reference.velocity_ned_m_s))
        accelerations.append(math.hypot(*now.reference.acceleration_ned_m_s2))
    assert max(speeds) <= 1.2 * 1.01
    assert max(speeds) > 0.9  # and no slower than it must
    assert max(accelerations) <= 0.8 * 1.01
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    end = evaluate(target, 60.0, REST).reference
    assert end.position_ned_m == (12.0, -9.0, -6.0)
    assert end.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert math.remainder(end.yaw_rad + 2.9, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    # The short way round: from .3 to -2.9 is 3.083 rad through pi, not 3.2 through zero.
    assert end.yaw_rad > REST.yaw_rad


def test_way_in_from_a_fast_start_keeps_near_its_limits() -> None:
    start = Reference((0.0, 0.0, -3.0), (1.2, 0.0, 0.0), (0.0, 0.9, 0.0))
    references = [evaluate(Circle(), float(t), start).reference for t in np.arange(0.0, 12.0, 0.02)]
    assert max(math.hypot(*r.velocity_ned_m_s) for r in references) <= 1.5 * 1.01
    assert max(math.hypot(*r.acceleration_ned_m_s2) for r in references) <= 1.0 * 1.05


def test_hover_stops_within_its_deceleration() -> None:
    peak = max(
        math.hypot(*evaluate(Hover(), float(t), MOVING).reference.acceleration_ned_m_s2)
        for t in np.arange(0.0, 3.0, 0.01)
    )
    assert peak <= 2.0 * 1.05
    assert evaluate(Hover(), 10.0, MOVING).reference.velocity_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("axis", "index", "sign"), [("north", 0, 1), ("east", 1, 1), ("height", 2, -1)])
def test_step_steps_its_axis_alone_and_without_feed_forward(axis: str, index: int, sign: int) -> None:
    now = evaluate(StepResponse(axis=axis, size=0.5), 0.0, REST).reference
    change = np.array(now.position_ned_m) - REST.position_ned_m
    expected = np.zeros(3)
    expected[index] = sign * 0.5
    np.testing.assert_allclose(change, expected, atol=1e-12)
    assert now.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert evaluate(StepResponse(axis="yaw", size=0.2), 1.0, REST).reference.yaw_rad == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("trajectory", "words"),
    [
        (Circle(radius_m=90.0), ("circle", "radius_m", "90", "0.1 to 50")),
        (Circle(rate_rad_s=0.0), ("circle", "rate_rad_s", "slow")),
        (Circle(radius_m=20.0, rate_rad_s=1.0), ("circle", "20.0 m/s", "8")),
        (Circle(radius_m=2.0, rate_rad_s=2.0), ("circle", "8.0 m/s^2", "3")),
        (FigureEight(radius_m=2.0, rate_rad_s=1.0), ("figure_eight", "m/s^2")),
        (GoTo(north_m=math.nan, east_m=0.0, height_m=2.0), ("go_to", "north_m", "nan")),
        (GoTo(north_m=0.0, east_m=0.0, height_m=-2.0), ("go_to", "height_m", "-2")),
        (StepResponse(axis="yaw", size=2.0), ("step", "yaw", "±1")),
    ],
)
def test_what_must_not_be_flown_is_refused_by_name_value_and_range(trajectory: Trajectory, words) -> None:
    with pytest.raises(TrajectoryError) as error:
        validate(trajectory)
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize("trajectory", [*SMOOTH, StepResponse()], ids=describe)
def test_good_ones_pass_and_survive_json(trajectory: Trajectory) -> None:
    validate(trajectory)
    assert msgspec.json.decode(msgspec.json.encode(trajectory), type=Trajectory) == trajectory


def test_table_covers_every_number() -> None:
    for kind, fields in FIELDS.items():
        numbers = {f.name for f in msgspec.structs.fields(kind) if f.name != "axis"}
        assert {field.name for field in fields} == numbers


@pytest.mark.parametrize("path", [Circle(radius_m=2.0, rate_rad_s=1.1), FigureEight(radius_m=2.0, rate_rad_s=0.8)])
def test_path_limits_are_its_true_extremes(path: Trajectory) -> None:
    """The closed forms behind the check: greatest speed and acceleration over a lap."""
    references = [evaluate(path, 30.0 + float(t), REST).reference for t in np.arange(0.0, 8.0, 0.002)]
    speed = max(math.hypot(*r.velocity_ned_m_s) for r in references)
    acceleration = max(math.hypot(*r.acceleration_ned_m_s2) for r in references)
    w, r = path.rate_rad_s, path.radius_m
    is_circle = isinstance(path, Circle)
    assert speed == pytest.approx((1.0 if is_circle else math.sqrt(2.0)) * r * w, rel=1e-4)
    assert acceleration <= (1.0 if is_circle else math.sqrt(5.0)) * r * w * w * 1.0001
