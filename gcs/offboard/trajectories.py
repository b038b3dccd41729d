"""Trajectories: what the vehicle should do as a pure function of time since the start.

Every trajectory begins at the reference that was being flown when it was chosen (``start``), with that reference's
velocity and acceleration, so that no choice of the operator makes a step except :class:`StepResponse`, whose purpose
is one. The way in is a fifth-order polynomial per axis whose duration is the shortest that respects the speed and
acceleration limits; the time law of the straight line to rest is the minimum-jerk one. All angles are radians, all
positions local NED [m]; heights are positive up above the local origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias, TypeVar

import msgspec
import numpy as np

from models.arrays import Array, Vec3
from models.estimate import Reference

ENTRY_SAMPLES = 24
SHORTEST_ENTRY_S = 0.5
ENTRY_GROWTH = 1.15
MOST_ENTRY_TRIALS = 40
LIMIT_TOLERANCE = 1.001
NO_LAP = 0
Number = TypeVar("Number", float, Array)


class TrajectoryError(ValueError):
    """A trajectory that must not be flown; the message names kind, field, value and range."""


class _Kind(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    pass


class Hover(_Kind, frozen=True, kw_only=True, tag="hover"):
    """Come to rest with ``acceleration_m_s2`` and hold the point and the heading."""

    acceleration_m_s2: float = 2.0


class GoTo(_Kind, frozen=True, kw_only=True, tag="go_to"):
    """Fly to a point and rest there, within speed and acceleration; ``yaw_rad`` None keeps the heading."""

    north_m: float
    east_m: float
    height_m: float
    yaw_rad: float | None = None
    speed_m_s: float = 1.5
    acceleration_m_s2: float = 1.0


class Circle(_Kind, frozen=True, kw_only=True, tag="circle"):
    """Raja (4.26)-(4.28): north r sin(w t), east r cos(w t) about the centre, at one height, heading kept."""

    radius_m: float = 0.8
    rate_rad_s: float = 0.5
    height_m: float = 1.0
    centre_north_m: float = 0.0
    centre_east_m: float = 0.0
    speed_m_s: float = 1.5
    acceleration_m_s2: float = 1.0


class FigureEight(_Kind, frozen=True, kw_only=True, tag="figure_eight"):
    """Lemniscate of Gerono: north a sin(w t), east a/2 sin(2 w t) about the centre, at one height, heading kept."""

    radius_m: float = 1.5
    rate_rad_s: float = 0.5
    height_m: float = 1.0
    centre_north_m: float = 0.0
    centre_east_m: float = 0.0
    speed_m_s: float = 1.5
    acceleration_m_s2: float = 1.0


class StepResponse(_Kind, frozen=True, kw_only=True, tag="step"):
    """A step of the reference without feed-forward: north, east and height in metres, yaw in radians; then hold."""

    axis: Literal["north", "east", "height", "yaw"] = "north"
    size: float = 0.5
    hold_s: float = 8.0


Trajectory: TypeAlias = Hover | GoTo | Circle | FigureEight | StepResponse
Path: TypeAlias = Circle | FigureEight


@dataclass(frozen=True, slots=True)
class Field:
    """One number of a trajectory an operator may set: label, unit and range, for validation and for the page."""

    name: str
    label: str
    unit: str
    minimum: float
    maximum: float


_PLACE = (
    Field("centre_north_m", "centre north", "m", -500.0, 500.0),
    Field("centre_east_m", "centre east", "m", -500.0, 500.0),
)
_HEIGHT = Field("height_m", "height", "m", 0.3, 100.0)
_SPEED = Field("speed_m_s", "speed on the way in", "m/s", 0.1, 10.0)
_ACCELERATION = Field("acceleration_m_s2", "acceleration on the way in", "m/s^2", 0.1, 3.0)
_RATE = Field("rate_rad_s", "rate", "rad/s", -2.0, 2.0)

FIELDS: dict[type[Trajectory], tuple[Field, ...]] = {
    Hover: (Field("acceleration_m_s2", "deceleration", "m/s^2", 0.1, 3.0),),
    GoTo: (
        Field("north_m", "north", "m", -500.0, 500.0),
        Field("east_m", "east", "m", -500.0, 500.0),
        _HEIGHT,
        Field("yaw_rad", "heading", "rad", -math.pi, math.pi),
        Field("speed_m_s", "speed", "m/s", 0.1, 10.0),
        Field("acceleration_m_s2", "acceleration", "m/s^2", 0.1, 3.0),
    ),
    Circle: (Field("radius_m", "radius", "m", 0.1, 50.0), _RATE, _HEIGHT, *_PLACE, _SPEED, _ACCELERATION),
    FigureEight: (Field("radius_m", "half length", "m", 0.1, 50.0), _RATE, _HEIGHT, *_PLACE, _SPEED, _ACCELERATION),
    StepResponse: (Field("size", "size", "m or rad", -5.0, 5.0), Field("hold_s", "duration", "s", 1.0, 60.0)),
}
"""Every number of every trajectory, in the order a page shows them."""

LARGEST_PATH_SPEED_M_S = 8.0
LARGEST_PATH_ACCELERATION_M_S2 = 3.0
LARGEST_YAW_STEP_RAD = 1.0
LARGEST_STEP_M = 5.0
SMALLEST_RATE_RAD_S = 0.01


class Progress(NamedTuple):
    """Where a trajectory is: reference, progress 0..1 (None if endless), lap (0 while on the way in)."""

    reference: Reference
    progress: float | None
    lap: int


def validate(trajectory: Trajectory) -> None:
    """Check every number against :data:`FIELDS` and the path against the speed and acceleration it would need.

    Raises TrajectoryError naming the kind, the field, the value and its range.
    """
    kind = trajectory.__struct_config__.tag
    for field in FIELDS[type(trajectory)]:
        value = getattr(trajectory, field.name)
        if value is not None and not (math.isfinite(value) and field.minimum <= value <= field.maximum):
            raise TrajectoryError(
                f"{kind}: {field.name} = {value:g} {field.unit} is outside {field.minimum:g} to {field.maximum:g}"
            )
    if isinstance(trajectory, StepResponse):
        limit = LARGEST_YAW_STEP_RAD if trajectory.axis == "yaw" else LARGEST_STEP_M
        if abs(trajectory.size) > limit:
            raise TrajectoryError(f"{kind}: size = {trajectory.size:g} on {trajectory.axis} is outside ±{limit:g}")
    if isinstance(trajectory, Circle | FigureEight):
        rate = abs(trajectory.rate_rad_s)
        if rate < SMALLEST_RATE_RAD_S:
            raise TrajectoryError(f"{kind}: rate_rad_s = {trajectory.rate_rad_s:g} is too slow to be a path; least .01")
        shape = 1.0 if isinstance(trajectory, Circle) else math.sqrt(2.0)
        speed = shape * trajectory.radius_m * rate
        if speed > LARGEST_PATH_SPEED_M_S:
            raise TrajectoryError(f"{kind}: radius and rate need {speed:.1f} m/s, at most {LARGEST_PATH_SPEED_M_S:g}")
        sharpest = 1.0 if isinstance(trajectory, Circle) else math.sqrt(5.0)
        acceleration = sharpest * trajectory.radius_m * rate * rate
        if acceleration > LARGEST_PATH_ACCELERATION_M_S2:
            raise TrajectoryError(
                f"{kind}: radius and rate need {acceleration:.1f} m/s^2, at most {LARGEST_PATH_ACCELERATION_M_S2:g}"
            )


def describe(trajectory: Trajectory) -> str:
    """One line for an operator."""
    match trajectory:
        case Hover():
            return "Hover"
        case GoTo():
            return f"Go to {trajectory.north_m:.1f} N, {trajectory.east_m:.1f} E, {trajectory.height_m:.1f} m"
        case Circle():
            return (
                f"Circle {trajectory.radius_m:.2f} m, {trajectory.rate_rad_s:.2f} rad/s at {trajectory.height_m:.1f} m"
            )
        case FigureEight():
            return f"Figure-eight {trajectory.radius_m:.2f} m, {trajectory.rate_rad_s:.2f} rad/s"
        case StepResponse():
            return f"Step {trajectory.axis} {trajectory.size:+.2f} {'rad' if trajectory.axis == 'yaw' else 'm'}"


def evaluate(trajectory: Trajectory, since_start_s: float, start: Reference) -> Progress:
    """Reference of a trajectory ``since_start_s`` seconds after it began at ``start``.

    Pure: the same arguments give the same answer (the duration of the way in is remembered, being costly to find).
    Circle and figure-eight report laps from 1 once the way in is flown; hover is endless; a go-to and a step report
    progress and hold their end point after it. Raises nothing for a validated trajectory and ``since_start_s`` >= 0.
    """
    match trajectory:
        case Hover():
            return _evaluate_hover(trajectory, since_start_s, start)
        case GoTo():
            return _evaluate_go_to(trajectory, since_start_s, start)
        case Circle() | FigureEight():
            return _evaluate_path(trajectory, since_start_s, start)
        case StepResponse():
            return _evaluate_step(trajectory, since_start_s, start)


class Motion(NamedTuple):
    """Position, velocity, acceleration and jerk of one instant, NED."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    acceleration_ned_m_s2: Vec3
    jerk_ned_m_s3: Vec3


def quintic(begin: Motion, end: Motion, duration_s: float, t_s: float) -> Motion:
    """Fifth-order polynomial from one motion to another, evaluated ``t_s`` after the beginning.

    With rest at both ends it is the minimum-jerk path: greatest speed 1.875 d/T, acceleration 5.774 d/T^2.
    """
    s = t_s / duration_s
    position, velocity, acceleration, jerk = [0.0] * 3, [0.0] * 3, [0.0] * 3, [0.0] * 3
    for axis in range(3):
        p0, v0 = begin.position_ned_m[axis], begin.velocity_ned_m_s[axis] * duration_s
        a0 = begin.acceleration_ned_m_s2[axis] * duration_s * duration_s
        v1 = end.velocity_ned_m_s[axis] * duration_s
        a1 = end.acceleration_ned_m_s2[axis] * duration_s * duration_s
        gap = end.position_ned_m[axis] - p0
        c3, c4, c5 = _upper(gap, v0, v1, a0, a1)
        position[axis] = p0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        velocity[axis] = (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / duration_s
        acceleration[axis] = (a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / duration_s**2
        jerk[axis] = (6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) / duration_s**3
    return Motion(
        (position[0], position[1], position[2]),
        (velocity[0], velocity[1], velocity[2]),
        (acceleration[0], acceleration[1], acceleration[2]),
        (jerk[0], jerk[1], jerk[2]),
    )


def _upper(gap: Number, v0: Number, v1: Number, a0: Number, a1: Number) -> tuple[Number, Number, Number]:
    """Coefficients of s^3, s^4, s^5 of the polynomial in s = t / T, from its ends scaled by T and T^2."""
    c3 = 10.0 * gap - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * gap + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * gap - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    return c3, c4, c5


def entry_duration_s(begin: Motion, end: Motion, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Shortest duration (on a geometric grid) whose polynomial keeps both limits, as far as the ends themselves do.

    Where no duration keeps both, which takes an initial acceleration near the limit, the one that comes nearest.
    """
    speed_limit = max(speed_m_s, _norm(begin.velocity_ned_m_s), _norm(end.velocity_ned_m_s))
    acceleration_limit = max(acceleration_m_s2, _norm(begin.acceleration_ned_m_s2), _norm(end.acceleration_ned_m_s2))
    shortest_s = max(SHORTEST_ENTRY_S, math.dist(begin.position_ned_m, end.position_ned_m) / speed_limit)
    durations_s: Array = shortest_s * np.power(ENTRY_GROWTH, np.arange(MOST_ENTRY_TRIALS))
    speed, acceleration = _greatest(begin, end, durations_s)
    excess = np.maximum(speed / speed_limit, acceleration / acceleration_limit)
    within = excess <= LIMIT_TOLERANCE
    return float(durations_s[within.argmax() if within.any() else excess.argmin()])


def _greatest(begin: Motion, end: Motion, durations_s: Array) -> tuple[Array, Array]:
    """Greatest speed and acceleration on the way for each duration (n,), sampled at ENTRY_SAMPLES instants."""
    duration = durations_s[:, np.newaxis, np.newaxis]
    s = (np.arange(1, ENTRY_SAMPLES) / ENTRY_SAMPLES)[:, np.newaxis]
    v0, v1 = np.array(begin.velocity_ned_m_s) * duration, np.array(end.velocity_ned_m_s) * duration
    a0 = np.array(begin.acceleration_ned_m_s2) * duration**2
    a1 = np.array(end.acceleration_ned_m_s2) * duration**2
    c3, c4, c5 = _upper(np.subtract(end.position_ned_m, begin.position_ned_m), v0, v1, a0, a1)
    velocity = (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / duration
    acceleration = (a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / duration**2
    return np.linalg.norm(velocity, axis=2).max(axis=1), np.linalg.norm(acceleration, axis=2).max(axis=1)


def _norm(vector: Vec3) -> float:
    return math.hypot(*vector)


def _motion(reference: Reference) -> Motion:
    return Motion(
        reference.position_ned_m, reference.velocity_ned_m_s, reference.acceleration_ned_m_s2, reference.jerk_ned_m_s3
    )


def _rest(position_ned_m: Vec3) -> Motion:
    return Motion(position_ned_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _reference(motion: Motion, yaw_rad: float, yaw_rate_rad_s: float = 0.0) -> Reference:
    return Reference(
        position_ned_m=motion.position_ned_m,
        velocity_ned_m_s=motion.velocity_ned_m_s,
        acceleration_ned_m_s2=motion.acceleration_ned_m_s2,
        jerk_ned_m_s3=motion.jerk_ned_m_s3,
        yaw_rad=yaw_rad,
        yaw_rate_rad_s=yaw_rate_rad_s,
    )


def _evaluate_hover(trajectory: Hover, t_s: float, start: Reference) -> Progress:
    duration_s, end = _stop(trajectory, start)
    if t_s >= duration_s:
        return Progress(_reference(end, start.yaw_rad), None, NO_LAP)
    return Progress(_reference(quintic(_motion(start), end, duration_s, t_s), start.yaw_rad), None, NO_LAP)


@lru_cache(maxsize=64)
def _stop(trajectory: Hover, start: Reference) -> tuple[float, Motion]:
    """Duration and end of coming to rest: half the present speed over the duration of the stop."""
    speed = _norm(start.velocity_ned_m_s)
    if speed < 1e-9 and _norm(start.acceleration_ned_m_s2) < 1e-9:
        return 0.0, _rest(start.position_ned_m)
    duration_s = max(SHORTEST_ENTRY_S, 2.0 * speed / trajectory.acceleration_m_s2)
    (pn, pe, pd), (vn, ve, vd) = start.position_ned_m, start.velocity_ned_m_s
    reach_s = 0.5 * duration_s
    return duration_s, _rest((pn + vn * reach_s, pe + ve * reach_s, pd + vd * reach_s))


@lru_cache(maxsize=64)
def _entry(trajectory: GoTo | Path, start: Reference) -> tuple[Motion, Motion, float]:
    """The way in: where it begins, where it ends, and its duration [s]."""
    begin = _motion(start)
    if isinstance(trajectory, GoTo):
        end = _rest((trajectory.north_m, trajectory.east_m, -trajectory.height_m))
    else:
        end = _on_path(trajectory, 0.0)
    return begin, end, entry_duration_s(begin, end, trajectory.speed_m_s, trajectory.acceleration_m_s2)


YAW_RATE_RAD_S = 0.5


def _evaluate_go_to(trajectory: GoTo, t_s: float, start: Reference) -> Progress:
    begin, end, duration_s = _entry(trajectory, start)
    turn_rad = 0.0 if trajectory.yaw_rad is None else math.remainder(trajectory.yaw_rad - start.yaw_rad, math.tau)
    turn_s = 1.875 * abs(turn_rad) / YAW_RATE_RAD_S
    yaw_rad, yaw_rate_rad_s = start.yaw_rad + turn_rad, 0.0
    if t_s < turn_s:
        s = t_s / turn_s
        yaw_rad = start.yaw_rad + turn_rad * s * s * s * (10.0 + s * (-15.0 + 6.0 * s))
        yaw_rate_rad_s = turn_rad * s * s * (30.0 + s * (-60.0 + 30.0 * s)) / turn_s
    motion = end if t_s >= duration_s else quintic(begin, end, duration_s, t_s)
    return Progress(_reference(motion, yaw_rad, yaw_rate_rad_s), min(1.0, t_s / max(duration_s, turn_s)), NO_LAP)


def _on_path(path: Path, t_s: float) -> Motion:
    w, r = path.rate_rad_s, path.radius_m
    sine, cosine = math.sin(w * t_s), math.cos(w * t_s)
    if isinstance(path, Circle):
        east = (r * cosine, -r * w * sine, -r * w * w * cosine, r * w**3 * sine)
    else:
        sine_2, cosine_2 = math.sin(2.0 * w * t_s), math.cos(2.0 * w * t_s)
        east = (0.5 * r * sine_2, r * w * cosine_2, -2.0 * r * w * w * sine_2, -4.0 * r * w**3 * cosine_2)
    return Motion(
        (path.centre_north_m + r * sine, path.centre_east_m + east[0], -path.height_m),
        (r * w * cosine, east[1], 0.0),
        (-r * w * w * sine, east[2], 0.0),
        (-r * w**3 * cosine, east[3], 0.0),
    )


def _evaluate_path(path: Path, t_s: float, start: Reference) -> Progress:
    begin, join, entry_s = _entry(path, start)
    if t_s < entry_s:
        return Progress(_reference(quintic(begin, join, entry_s, t_s), start.yaw_rad), None, NO_LAP)
    on_path_s = t_s - entry_s
    lap = 1 + int(on_path_s * abs(path.rate_rad_s) / (2.0 * math.pi))
    return Progress(_reference(_on_path(path, on_path_s), start.yaw_rad), None, lap)


def _evaluate_step(trajectory: StepResponse, t_s: float, start: Reference) -> Progress:
    north, east, down = start.position_ned_m
    yaw_rad = start.yaw_rad
    match trajectory.axis:
        case "north":
            north += trajectory.size
        case "east":
            east += trajectory.size
        case "height":
            down -= trajectory.size
        case "yaw":
            yaw_rad += trajectory.size
    return Progress(_reference(_rest((north, east, down)), yaw_rad), min(1.0, t_s / trajectory.hold_s), NO_LAP)
