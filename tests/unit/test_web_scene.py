"""Geometry of the scene: NED to viser's world, attitude, ellipsoid, paths, cameras."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from models.frames import quaternion_from_euler, rotation_from_quaternion
from web.camera import OVERVIEWS, CameraPose, Framing, chase_pose, image_coordinates, overview_pose
from web.scene import (
    ENU_FROM_NED,
    ellipsoid,
    enu_from_frd_quaternion,
    enu_from_ned,
    letter_segments,
    path_segments,
    quaternion_from_rotation,
)


def test_north_east_up_go_where_viser_has_them() -> None:
    assert enu_from_ned(np.array([1.0, 2.0, -3.0])).tolist() == [2.0, 1.0, 3.0]
    assert np.allclose(ENU_FROM_NED @ [1.0, 2.0, -3.0], [2.0, 1.0, 3.0])


def test_nose_points_along_the_heading_and_a_right_roll_lowers_the_right_side() -> None:
    for heading, nose in ((0.0, [0.0, 1.0, 0.0]), (math.pi / 2, [1.0, 0.0, 0.0]), (math.pi, [0.0, -1.0, 0.0])):
        attitude = rotation_from_quaternion(enu_from_frd_quaternion(quaternion_from_euler(0.0, 0.0, heading)))
        assert np.allclose(attitude @ [1.0, 0.0, 0.0], nose)
    rolled = rotation_from_quaternion(enu_from_frd_quaternion(quaternion_from_euler(0.3, 0.0, 0.0)))
    right = rolled @ [0.0, 1.0, 0.0]
    assert right[0] > 0.0
    assert right[2] == pytest.approx(-math.sin(0.3))


def test_ellipsoid_reproduces_the_covariance() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        root = rng.normal(size=(3, 3))
        p = root @ root.T
        upper = np.array([p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]])
        semi_axes_m, rotation = ellipsoid(upper)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        drawn = rotation @ np.diag(semi_axes_m**2) @ rotation.T / 9.0
        assert np.allclose(drawn, ENU_FROM_NED @ p @ ENU_FROM_NED.T, atol=1e-5)


def test_quaternion_of_any_rotation_gives_it_back() -> None:
    rng = np.random.default_rng(6)
    turns = [rng.normal(size=3) for _ in range(100)] + [np.array([math.pi, 0.0, 0.0]), np.array([0.0, 0.0, math.pi])]
    for turn in turns:
        angle = np.linalg.norm(turn)
        x, y, z = turn / angle
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
        q = quaternion_from_rotation(rotation)
        assert np.linalg.norm(q) == pytest.approx(1.0)
        assert np.allclose(rotation_from_quaternion(q), rotation, atol=1e-12)


def test_a_path_is_not_joined_across_a_gap_and_is_never_empty() -> None:
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [np.nan, np.nan, np.nan], [5.0, 0, 0], [6.0, 0, 0]])
    assert path_segments(points)[:, :, 0].tolist() == [[0.0, 1.0], [5.0, 6.0]]
    assert path_segments(points[:1]).shape == (1, 2, 3)
    assert path_segments(np.full((4, 3), np.nan)).shape == (1, 2, 3)
    assert len(path_segments(np.zeros((11, 3)), dashed=True)) == 5


def test_letters_are_centred_and_as_high_as_asked() -> None:
    letters = letter_segments("5 m N", 0.2)
    assert letters[..., 1].min() == pytest.approx(-0.1)
    assert letters[..., 1].max() == pytest.approx(0.1)
    assert letters[..., 0].min() == pytest.approx(-letters[..., 0].max())


def test_cameras_see_the_vehicle() -> None:
    vehicle = np.array([3.0, 4.0, 2.0])
    chase = chase_pose(vehicle, math.pi / 2)
    assert chase.position_enu_m[0] < vehicle[0] < chase.look_at_enu_m[0]
    trail = np.array([[0.0, 4.0, 2.0], [np.nan] * 3, vehicle])
    for view in OVERVIEWS:
        for aspect in (0.6, 1.5, 2.9):
            pose = overview_pose(view, trail, aspect)
            seen = image_coordinates(pose, np.array([trail[0], vehicle, np.zeros(3)]), aspect)
            assert np.abs(seen).max() < 0.85
    assert overview_pose("top", trail, 1.5).position_enu_m[2] > 5.0


def test_image_coordinates_know_right_and_up() -> None:
    from_the_south = CameraPose(np.array([0.0, -10.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    (east, high) = image_coordinates(from_the_south, np.array([[2.0, 0.0, 1.0], [0.0, 0.0, 3.0]]), 2.0)
    half = 10.0 * math.tan(math.radians(21.0))
    assert east == pytest.approx([2.0 / (2.0 * half), 0.0])
    assert high == pytest.approx([0.0, 2.0 / half])


def _followed(framing: Framing, points: list[list[float]], steps: int) -> list[CameraPose]:
    poses = [framing.follow(np.array(points), 2.0) for _ in range(steps)]
    return [pose for pose in poses if pose is not None]


def test_an_overview_eases_to_what_leaves_it_and_then_stands_still() -> None:
    framing = Framing("free")
    (first,) = _followed(framing, [[0.0, 0.0, 0.0]], 20)
    assert _followed(framing, [[0.1, 0.0, 0.1]], 20) == []  # still inside
    on_the_way = _followed(framing, [[3.0, 3.0, 2.5]], 200)
    assert 20 < len(on_the_way) < 200
    steps_m = [np.linalg.norm(b.position_enu_m - a.position_enu_m) for a, b in pairwise(on_the_way)]
    assert max(steps_m) < 0.2 * np.linalg.norm(on_the_way[-1].position_enu_m - first.position_enu_m)
    assert np.abs(image_coordinates(on_the_way[-1], np.array([[3.0, 3.0, 2.5]]), 2.0)).max() < 0.85
    back = _followed(framing, [[0.0, 0.0, 0.0]], 200)
    assert np.allclose(back[-1].position_enu_m, first.position_enu_m, atol=0.01)
