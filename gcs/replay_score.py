"""How far one record of motion is from another: time alignment, interpolation, root-mean-square errors; all pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from models.frames import Array

MAX_OFFSET_S = 0.15
COARSE_STEP_S = 0.005
MIN_RATE_RAD_S = 0.02
SMOOTHING_S = 0.05
MAX_HOLE_S = 0.25


@dataclass(frozen=True, slots=True)
class Track:
    """A record of motion: ``time_s`` (n,), ``euler_rad`` (n, 3), ``position_ned_m`` (n, 3); NaN where not known."""

    time_s: Array
    euler_rad: Array
    position_ned_m: Array


@dataclass(frozen=True, slots=True)
class Errors:
    """Root-mean-square errors of a track; None where there was nothing to compare."""

    roll_rms_deg: float | None
    pitch_rms_deg: float | None
    heading_rms_deg: float | None
    position_rms_m: float | None


def euler_of_quaternions(ned_from_body: Array) -> Array:
    """Roll, pitch, yaw [rad] (n, 3) of quaternions w, x, y, z (n, 4), normalised here."""
    w, x, y, z = (ned_from_body / np.linalg.norm(ned_from_body, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ],
        axis=1,
    )


def fit_time_offset(time_s: Array, rates_rad_s: Array, other_time_s: Array, other_rates_rad_s: Array) -> float:
    """Constant offset [s] to subtract from ``other_time_s`` (m,) so that both angular rates (., 3) agree best.

    Minimises the mean square difference less its mean (a gyro bias), on a grid of 5 ms refined to .1 ms. The rates are
    first averaged over 50 ms: interpolation between noisy samples would otherwise look best half-way between them.
    Returns 0 if the vehicle hardly turned: nothing then tells the offset.
    """
    turning = np.linalg.norm(other_rates_rad_s, axis=1) > MIN_RATE_RAD_S
    if np.count_nonzero(turning) < 50:
        return 0.0
    inside = (other_time_s > time_s[0] + MAX_OFFSET_S) & (other_time_s < time_s[-1] - MAX_OFFSET_S)
    stamps, rates = other_time_s[inside], other_rates_rad_s[inside]
    width = max(1, 2 * round(0.5 * SMOOTHING_S / float(np.median(np.diff(time_s)))) + 1)
    box = np.ones(width) / width
    smooth = [np.convolve(rates_rad_s[:, axis], box, mode="same") for axis in range(3)]

    def cost(offset_s: float) -> float:
        total = 0.0
        for axis in range(3):
            total += float(np.var(np.interp(stamps - offset_s, time_s, smooth[axis]) - rates[:, axis]))
        return total

    best = 0.0
    span, step = MAX_OFFSET_S, COARSE_STEP_S
    while step > 5e-5:
        candidates = best + np.arange(-span, span + 0.5 * step, step)
        best = float(min(candidates, key=cost))
        span, step = step, step / 5.0
    return best


def interpolate_angle(at_s: Array, time_s: Array, angle_rad: Array) -> Array:
    """Angle [rad] at other times, through the wrap; not wrapped itself."""
    return np.interp(at_s, time_s, np.unwrap(angle_rad))


def near(at_s: Array, time_s: Array) -> npt.NDArray[np.bool_]:
    """Which of ``at_s`` lie between two stamps of ``time_s`` that are at most .25 s apart: no score across a hole."""
    after = np.searchsorted(time_s, at_s)
    inside = (after > 0) & (after < time_s.size)
    after = np.clip(after, 1, time_s.size - 1)
    return inside & (time_s[after] - time_s[after - 1] <= MAX_HOLE_S)


def errors(track: Track, truth: Track, from_s: float, to_s: float) -> Errors:
    """Errors of ``track`` at the stamps of ``truth`` in [from_s, to_s]: roll, pitch, heading, and 3-D position."""
    window = (truth.time_s >= from_s) & (truth.time_s <= to_s)
    angles: list[float | None] = [None, None, None]
    known = np.isfinite(track.euler_rad[:, 0])
    time_s = track.time_s[known]
    if time_s.size > 1:
        use = window & near(truth.time_s, time_s) & np.isfinite(truth.euler_rad[:, 0])
        if np.any(use):
            for axis in range(3):
                ours = interpolate_angle(truth.time_s[use], time_s, track.euler_rad[known, axis])
                angles[axis] = math.degrees(_rms(_wrap(ours - truth.euler_rad[use, axis])))
    position: float | None = None
    known = np.isfinite(track.position_ned_m[:, 0])
    time_s = track.time_s[known]
    if time_s.size > 1:
        use = window & near(truth.time_s, time_s) & np.isfinite(truth.position_ned_m[:, 0])
        if np.any(use):
            squared = np.zeros(np.count_nonzero(use))
            for axis in range(3):
                ours = np.interp(truth.time_s[use], time_s, track.position_ned_m[known, axis])
                squared += (ours - truth.position_ned_m[use, axis]) ** 2
            position = math.sqrt(float(np.mean(squared)))
    return Errors(angles[0], angles[1], angles[2], position)


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values * values)))


def _wrap(angle_rad: Array) -> Array:
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
