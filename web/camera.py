"""Where the scene's cameras stand: behind the vehicle, or so that everything of interest fits the picture.

All points are in viser's world, x east, y north, z up [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.arrays import Array

FOV_RAD = math.radians(42.0)
"""Vertical field of view of every camera."""

# From where the named views look; overhead is a hair south of it, so that north stays at the top of the picture.
_DIRECTIONS: dict[str, Array] = {
    "free": np.array([-0.36, -0.79, 0.50]),
    "top": np.array([0.0, -0.002, 1.0]),
    "north": np.array([0.0, -0.99, 0.1]),
}
OVERVIEWS = tuple(_DIRECTIONS)

# Home with its letters: what is seen of an empty scene, and the least of any.
_HOME_ENU_M = np.array([[-0.5, -0.7, 0.0], [1.5, -0.7, 0.0], [-0.5, 1.5, 0.0], [1.5, 1.5, 0.0], [0.0, 0.0, 0.8]])

# Share of the picture the points fill when framed anew; they may grow to the edge and shrink to a part of it before
# the camera moves again, so that it stands still most of the time.
_FILL = 0.78
_FILL_AT_EDGE = 0.93
_SHRUNK = 0.6
_EASE = 0.15
_ARRIVED_M = 1e-3


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where a camera stands and what it looks at [m]."""

    position_enu_m: Array
    look_at_enu_m: Array


def chase_pose(vehicle_enu_m: Array, heading_rad: float) -> CameraPose:
    """Behind and above the vehicle, looking where it points."""
    forward = np.array([math.sin(heading_rad), math.cos(heading_rad), 0.0])
    return CameraPose(vehicle_enu_m - 2.4 * forward + [0.0, 0.0, 0.9], vehicle_enu_m + 0.6 * forward)


def image_coordinates(pose: CameraPose, points_enu_m: Array, aspect: float) -> Array:
    """Where points (N, 3) in front of a camera are in its picture (N, 2): right, up; the edges are at -1 and 1."""
    backward, right, up = _axes(pose.position_enu_m - pose.look_at_enu_m)
    away = points_enu_m - pose.position_enu_m
    half = math.tan(0.5 * FOV_RAD)
    across: Array = np.stack([away @ right / (aspect * half), away @ up / half], axis=1)
    seen: Array = across / -(away @ backward)[:, None]
    return seen


def overview_pose(view: str, points_enu_m: Array, aspect: float) -> CameraPose:
    """A camera that sees home and all of ``points_enu_m`` (N, 3): ``free``, ``top`` or ``north``.

    ``aspect`` is width over height of the picture. Points that are not numbers are left out.
    """
    points = with_home(points_enu_m)
    direction = _DIRECTIONS[view] / np.linalg.norm(_DIRECTIONS[view])
    backward, right, up = _axes(direction)
    half = math.tan(0.5 * FOV_RAD)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    pose = CameraPose(centre + direction, centre)
    for _ in range(4):  # What is near is drawn larger, so the middle of the picture is found by going there.
        away = points - centre
        across = np.maximum(np.abs(away @ right) / aspect, np.abs(away @ up)) / (half * _FILL)
        distance_m = float((away @ backward + across).max())
        pose = CameraPose(centre + distance_m * direction, centre)
        seen = image_coordinates(pose, points, aspect)
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance_m * half
        centre = centre + middle[0] * aspect * right + middle[1] * up
    return pose


def with_home(points_enu_m: Array) -> Array:
    """The finite ones of points (N, 3), and home's own."""
    known = points_enu_m[np.isfinite(points_enu_m).all(axis=1)]
    joined: Array = np.concatenate([known, _HOME_ENU_M])
    return joined


def _axes(backward: Array) -> tuple[Array, Array, Array]:
    """Unit vectors of a camera's picture: towards the viewer, right, up."""
    backward = backward / np.linalg.norm(backward)
    right = np.array([-backward[1], backward[0], 0.0])
    right = right / np.linalg.norm(right)
    return backward, right, np.cross(backward, right)


class Framing:
    """One browser's camera: which view it follows, and how far it is on the way there.

    ``view`` is one of the overviews, ``chase``, or ``own``: the user's hands are on it and it is left alone.
    """

    def __init__(self, view: str) -> None:
        self.view = view
        self._goal: CameraPose | None = None
        self._shown: CameraPose | None = None

    def follow(self, points_enu_m: Array, aspect: float) -> CameraPose | None:
        """The next pose of an overview towards one that frames the points; None to stay."""
        if self._goal is None or not _fits(self._goal, self.view, points_enu_m, aspect):
            self._goal = overview_pose(self.view, points_enu_m, aspect)
        goal, shown = self._goal, self._shown
        if shown is not None:
            to_go_m = np.linalg.norm(goal.position_enu_m - shown.position_enu_m)
            if to_go_m + np.linalg.norm(goal.look_at_enu_m - shown.look_at_enu_m) < _ARRIVED_M:
                return None
            goal = CameraPose(
                shown.position_enu_m + _EASE * (goal.position_enu_m - shown.position_enu_m),
                shown.look_at_enu_m + _EASE * (goal.look_at_enu_m - shown.look_at_enu_m),
            )
        self._shown = goal
        return goal


def _fits(pose: CameraPose, view: str, points_enu_m: Array, aspect: float) -> bool:
    """Whether the points are inside the picture and do not get lost in it."""
    if np.abs(image_coordinates(pose, with_home(points_enu_m), aspect)).max() > _FILL_AT_EDGE:
        return False
    tight = overview_pose(view, points_enu_m, aspect)
    distances_m = [np.linalg.norm(p.position_enu_m - p.look_at_enu_m) for p in (tight, pose)]
    return bool(distances_m[0] > _SHRUNK * distances_m[1])
