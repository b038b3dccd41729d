"""The three-dimensional scene: vehicle, trail, reference and position uncertainty, drawn with viser.

viser knows no sessions, so it listens on loopback only, draws, and takes no command; browsers reach it through
:mod:`web.proxy`.
viser's world is x east, y north, z up (``enu``); everything is turned into it here and nowhere else.
"""

from __future__ import annotations

import contextlib
import io
import math
import threading
from collections import deque
from typing import Any

import numpy as np
import viser
from viser.transforms import SO3

from gcs.signals import SLICES
from models.arrays import Array
from models.parameters import load_quadrotor
from web.camera import FOV_RAD, OVERVIEWS, CameraPose, Framing, chase_pose, overview_pose

VIEWS = (*OVERVIEWS, "chase", "own")

ENU_FROM_NED: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# The same rotation: half a turn about north-east.
_ENU_FROM_NED_R = SO3(np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0]))

TRAIL_S = 30.0
_TRAIL_STEP_S = 0.1
_TRAIL_GAP_S = 0.5
_VELOCITY_SHOWN_S = 0.5
_SIGMAS = 3.0
_LEAST_SEMI_AXIS_M = 0.002
_ASPECT_AT_FIRST = 2.0

_FLOWN = (118, 148, 255)
_REFERENCE = (169, 179, 187)
_LINE = (43, 52, 59)
_GRID = (36, 44, 50)
_LABEL = (132, 144, 154)
_TEXT = (230, 234, 237)

# viser's own labels are white boxes, so the few letters needed are strokes in a unit square.
_STROKES: dict[str, tuple[tuple[tuple[float, float], ...], ...]] = {
    "N": (((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)),),
    "E": (((1.0, 1.0), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0)), ((0.0, 0.5), (0.8, 0.5))),
    "5": (((1.0, 1.0), (0.0, 1.0), (0.0, 0.55), (0.8, 0.55), (1.0, 0.4), (1.0, 0.15), (0.8, 0.0), (0.0, 0.0)),),
    "m": (((0.0, 0.0), (0.0, 0.6), (0.5, 0.5), (0.5, 0.0)), ((0.5, 0.5), (1.0, 0.6), (1.0, 0.0))),
    "h": (((0.0, 0.0), (0.0, 1.0)), ((0.0, 0.6), (0.7, 0.6), (0.7, 0.0))),
    "o": (((0.0, 0.0), (0.0, 0.6), (0.7, 0.6), (0.7, 0.0), (0.0, 0.0)),),
    "e": (((0.7, 0.0), (0.0, 0.0), (0.0, 0.6), (0.7, 0.6), (0.7, 0.3), (0.0, 0.3)),),
    " ": (),
}
# Letters lean back by this much from the upright: readable from the south as well as from above.
_LEAN = SO3.from_x_radians(math.radians(50.0))


def enu_from_ned(vector_ned: Array) -> Array:
    """East, north, up of vectors (..., 3) given as north, east, down."""
    east_north_up: Array = vector_ned[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    return east_north_up


def enu_from_frd_quaternion(ned_from_body: Array) -> Array:
    """Attitude of the body (front, right, down) in viser's world, w, x, y, z."""
    return np.asarray((_ENU_FROM_NED_R @ SO3(np.asarray(ned_from_body))).wxyz)


def ellipsoid(covariance_ned: Array) -> tuple[Array, Array]:
    """Semi-axes [m] and enu rotation (3, 3) of the 3-sigma ellipsoid of ``nn, ne, nd, ee, ed, dd`` [m^2]."""
    nn, ne, nd, ee, ed, dd = covariance_ned
    variances, axes = np.linalg.eigh(np.array([[nn, ne, nd], [ne, ee, ed], [nd, ed, dd]]))
    semi_axes_m = np.maximum(_SIGMAS * np.sqrt(np.maximum(variances, 0.0)), _LEAST_SEMI_AXIS_M)
    rotation = ENU_FROM_NED @ axes
    if np.linalg.det(rotation) < 0.0:
        rotation[:, 0] = -rotation[:, 0]
    return semi_axes_m, rotation


def quaternion_from_rotation(rotation: Array) -> Array:
    """Unit quaternion w, x, y, z of a rotation matrix, by its largest component (Shepperd 1978)."""
    trace = np.trace(rotation)
    squares = np.array([trace, rotation[0, 0], rotation[1, 1], rotation[2, 2]])
    largest = int(np.argmax(squares))
    q = np.empty(4)
    q[largest] = 0.5 * math.sqrt(max(0.0, 1.0 + 2.0 * squares[largest] - trace))
    scale = 0.25 / q[largest]
    skew = (rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1])
    if largest == 0:
        q[1:] = np.array(skew) * scale
        return q
    i = largest - 1
    j, k = (i + 1) % 3, (i + 2) % 3
    q[0] = skew[i] * scale
    q[1 + j] = (rotation[i, j] + rotation[j, i]) * scale
    q[1 + k] = (rotation[i, k] + rotation[k, i]) * scale
    return q


def circle_segments(centre_m: Array, radius_m: float, count: int = 24) -> Array:
    """A horizontal circle as line segments (count, 2, 3)."""
    angle = np.linspace(0.0, 2.0 * math.pi, count + 1)
    points = centre_m + radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return path_segments(points)


def path_segments(points: Array, *, dashed: bool = False) -> Array:
    """Consecutive points (N, 3) as line segments (M, 2, 3); a dashed path leaves every other one out.

    Nothing is joined across a point that is not a number. Without any segment one of no length is given, M being >= 1.
    """
    if len(points) < 2:
        return np.zeros((1, 2, 3))
    segments = np.stack([points[:-1], points[1:]], axis=1)[:: 2 if dashed else 1]
    known: Array = segments[np.isfinite(segments).all(axis=(1, 2))]
    return known if len(known) else np.zeros((1, 2, 3))


def letter_segments(text: str, height_m: float) -> Array:
    """Letters drawn as lines in the plane x, y (N, 2, 3), centred, y being their up."""
    segments: list[Array] = []
    width = 0.0
    for letter in text:
        strokes = _STROKES[letter]
        segments += [path_segments(np.array([[width + x, y, 0.0] for x, y in stroke])) for stroke in strokes]
        width += 1.4 if strokes else 0.8
    return (np.concatenate(segments) - [0.5 * width - 0.2, 0.5, 0.0]) * [0.6 * height_m, height_m, 1.0]


class Scene:
    """A viser server that shows one vehicle. Methods may be called from any thread, one at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self._server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self._owners: dict[int, str] = {}
        self._cameras: dict[int, Framing] = {}
        self._flown: deque[Array] = deque(maxlen=round(TRAIL_S / _TRAIL_STEP_S))
        self._reference: deque[Array] = deque(maxlen=round(TRAIL_S / _TRAIL_STEP_S))
        self._trail_time_s = -math.inf
        self._vehicle_enu_m = np.zeros(3)
        self._heading_rad = 0.0
        self._draw_surroundings()
        self._nodes = _draw_vehicle(self._server.scene)
        start = overview_pose("free", np.zeros((1, 3)), _ASPECT_AT_FIRST)
        self._server.initial_camera.position = tuple(start.position_enu_m)
        self._server.initial_camera.look_at = tuple(start.look_at_enu_m)
        self._server.initial_camera.fov = FOV_RAD

    @property
    def port(self) -> int:
        """Loopback port of viser's page and WebSocket."""
        return int(self._server.get_port())

    @property
    def watched(self) -> bool:
        """Whether any browser shows the scene."""
        return bool(self._server.get_clients())

    def close(self) -> None:
        self._server.stop()

    def own(self, local_port: int, client: str) -> None:
        """Note which browser session stands behind a proxied connection, by the proxy's local port."""
        with self._lock:
            self._owners[local_port] = client

    def disown(self, local_port: int) -> None:
        with self._lock:
            self._owners.pop(local_port, None)

    def look(self, client: str, view: str) -> int:
        """Set what the cameras of one browser session follow, ``own`` for nothing; answers how many there were."""
        moved = 0
        for number, handle in self._server.get_clients().items():
            if self._owner_of(number) != client:
                continue
            framing = Framing(view)
            with self._lock:
                self._cameras[number] = framing
            self._move(handle, framing, self._points_of_interest())
            moved += 1
        return moved

    def update(self, frame: Array) -> None:
        """Show one frame of :mod:`gcs.signals`."""
        position_ned_m = frame[SLICES["estimate.position_ned"]]
        ned_from_body = frame[SLICES["estimate.ned_from_body"]]
        if not (np.isfinite(position_ned_m).all() and np.isfinite(ned_from_body).all()):
            return
        self._vehicle_enu_m = enu_from_ned(position_ned_m)
        self._heading_rad = float(frame[SLICES["estimate.euler"]][2])
        reference_ned_m = frame[SLICES["reference.position_ned"]]
        longer = self._remember(float(frame[0]), enu_from_ned(reference_ned_m))
        if not self.watched:
            return
        with self._server.atomic():
            self._show_vehicle(frame, ned_from_body)
            self._show_reference(enu_from_ned(reference_ned_m))
            if longer:
                self._show_trails()
        self._move_cameras()

    def _remember(self, time_s: float, reference_enu_m: Array) -> bool:
        """Add to the trails every tenth of a second; a gap stays a gap, a clock that went back starts anew."""
        if time_s < self._trail_time_s:
            self._flown.clear()
            self._reference.clear()
        elif time_s < self._trail_time_s + _TRAIL_STEP_S:
            return False
        elif time_s > self._trail_time_s + _TRAIL_GAP_S:
            self._flown.append(np.full(3, np.nan))
            self._reference.append(np.full(3, np.nan))
        self._trail_time_s = time_s
        self._flown.append(self._vehicle_enu_m)
        self._reference.append(reference_enu_m)
        return True

    def _show_vehicle(self, frame: Array, ned_from_body: Array) -> None:
        nodes, position = self._nodes, self._vehicle_enu_m
        nodes["vehicle"].position = position
        nodes["vehicle"].wxyz = enu_from_frd_quaternion(ned_from_body)
        velocity_enu_m_s = enu_from_ned(frame[SLICES["estimate.velocity_ned"]])
        if np.isfinite(velocity_enu_m_s).all():
            nodes["velocity"].points = np.stack([position, position + _VELOCITY_SHOWN_S * velocity_enu_m_s])[None]
        ground = position * [1.0, 1.0, 0.0]
        steps = np.linspace(0.0, 1.0, 40)[:, None]
        nodes["drop"].points = path_segments(ground + steps * (position - ground), dashed=True)
        nodes["shadow"].position = ground
        covariance = frame[SLICES["estimate.position_covariance"]]
        if np.isfinite(covariance).all():
            semi_axes_m, rotation = ellipsoid(covariance)
            nodes["sigma"].scale = (float(semi_axes_m[0]), float(semi_axes_m[1]), float(semi_axes_m[2]))
            nodes["sigma"].wxyz = quaternion_from_rotation(rotation)
            nodes["sigma"].position = position

    def _show_reference(self, reference_enu_m: Array) -> None:
        known = bool(np.isfinite(reference_enu_m).all())
        node = self._nodes["reference"]
        if node.visible != known:
            node.visible = known
        if known:
            node.position = reference_enu_m

    def _show_trails(self) -> None:
        self._nodes["flown"].points = path_segments(np.array(self._flown))
        reference = np.array(self._reference)
        self._nodes["reference_path"].points = path_segments(reference, dashed=True)
        self._nodes["reference_ground"].points = path_segments(reference * [1.0, 1.0, 0.0])

    def _points_of_interest(self) -> Array:
        """What an overview shows besides home: vehicle, its place on the ground, trails and reference (N, 3)."""
        vehicle = self._vehicle_enu_m
        return np.array([vehicle, vehicle * [1.0, 1.0, 0.0], *self._flown, *self._reference])

    def _move_cameras(self) -> None:
        clients = self._server.get_clients()
        with self._lock:
            self._cameras = {number: self._cameras.get(number) or Framing("free") for number in clients}
            cameras = dict(self._cameras)
        points = self._points_of_interest()
        for number, framing in cameras.items():
            self._move(clients[number], framing, points)

    def _move(self, handle: Any, framing: Framing, points_enu_m: Array) -> None:
        if framing.view == "chase":
            _point(handle, chase_pose(self._vehicle_enu_m, self._heading_rad))
        elif framing.view in OVERVIEWS:
            pose = framing.follow(points_enu_m, handle.camera.aspect)
            if pose is not None:
                _point(handle, pose)

    def _owner_of(self, number: int) -> str | None:
        # viser does not publish the connection behind a client; its table of live connections tells the peer's port.
        connection = self._server._websock_server._live_connections.get(number)
        if connection is None:
            return None
        with self._lock:
            return self._owners.get(connection.remote_address[1])

    def _draw_surroundings(self) -> None:
        scene = self._server.scene
        scene.configure_default_lights(cast_shadow=False)
        scene.add_grid(
            "/ground",
            width=100.0,
            height=100.0,
            cell_size=1.0,
            cell_color=_GRID,
            section_size=5.0,
            section_color=_LINE,
            fade_distance=60.0,
            shadow_opacity=0.0,
        )
        axes = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
        scene.add_line_segments("/home/axes", axes, _REFERENCE, thickness=2.0, thickness_units="screen")
        for name, text, height_m, place in (
            ("north", "N", 0.14, (0.0, 1.15, 0.0)),
            ("east", "E", 0.14, (1.15, 0.0, 0.0)),
            ("five_north", "5 m N", 0.22, (0.0, 5.2, 0.0)),
            ("five_east", "5 m E", 0.22, (5.7, 0.0, 0.0)),
            ("name", "home", 0.2, (0.0, -0.3, 0.0)),
        ):
            letters = letter_segments(text, height_m)
            scene.add_line_segments(
                f"/home/{name}",
                letters,
                _LABEL,
                thickness=1.5,
                thickness_units="screen",
                wxyz=_LEAN.wxyz,
                position=place,
            )


def _point(handle: Any, pose: CameraPose) -> None:
    with handle.atomic():
        handle.camera.up_direction = (0.0, 0.0, 1.0)
        handle.camera.position = tuple(pose.position_enu_m)
        handle.camera.look_at = tuple(pose.look_at_enu_m)


def _draw_vehicle(scene: Any) -> dict[str, Any]:
    """An X quadrotor in body axes (front, right, down) and what moves with it."""
    arm_m = load_quadrotor().arm_m
    reach = arm_m * math.sqrt(0.5)
    hubs = np.array([[reach, reach, 0.0], [-reach, -reach, 0.0], [reach, -reach, 0.0], [-reach, reach, 0.0]])
    arms = np.stack([np.zeros_like(hubs), hubs], axis=1)
    front = np.concatenate([circle_segments(hub, 0.55 * arm_m) for hub in hubs[[0, 2]]])
    rear = np.concatenate([circle_segments(hub, 0.55 * arm_m) for hub in hubs[[1, 3]]])
    nose = np.array([[[0.0, 0.0, 0.0], [1.5 * arm_m, 0.0, 0.0]]])
    nothing = np.zeros((1, 2, 3))

    def lines(name: str, points: Array, color: tuple[int, int, int], width_px: float) -> Any:
        return scene.add_line_segments(name, points, color, thickness=width_px, thickness_units="screen")

    nodes = {"vehicle": scene.add_frame("/vehicle", show_axes=False)}
    lines("/vehicle/arms", arms, _TEXT, 3.0)
    lines("/vehicle/front", front, _TEXT, 2.0)
    lines("/vehicle/rear", rear, _LABEL, 2.0)
    lines("/vehicle/nose", nose, _TEXT, 1.5)
    nodes["velocity"] = lines("/velocity", nothing, _FLOWN, 2.0)
    nodes["flown"] = lines("/flown", nothing, _FLOWN, 2.5)
    nodes["reference_path"] = lines("/reference_path", nothing, _REFERENCE, 1.5)
    nodes["reference_ground"] = lines("/reference_ground", nothing, _LINE, 1.5)
    nodes["reference"] = scene.add_icosphere("/reference", 0.04, _REFERENCE, visible=False, cast_shadow=False)
    nodes["drop"] = lines("/drop", nothing, _LABEL, 1.0)
    nodes["shadow"] = lines("/shadow", circle_segments(np.zeros(3), 0.8 * arm_m), _LABEL, 1.0)
    nodes["sigma"] = scene.add_icosphere(
        "/sigma", 1.0, _REFERENCE, opacity=0.16, cast_shadow=False, receive_shadow=False, scale=_LEAST_SEMI_AXIS_M
    )
    return nodes
