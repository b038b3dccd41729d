"""The cascade in readable numpy: the twin that the compiled kernels are compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controllers.law import CascadeLaw
from controllers.mixer import TILT_TORQUE_CUT, achievable
from models.estimate import Estimate, Reference
from models.frames import STANDARD_GRAVITY_M_S2, quaternion_from_euler

LONGEST_STEP_S = 0.1
LEAST_TILT_COSINE = 0.5
TILT_FROM_ACCELERATION = np.array([[0.0, 1.0], [-1.0, 0.0]]) / STANDARD_GRAVITY_M_S2


@dataclass
class TwinState:
    """Memory of the cascade: z and its rates per loop (horizontal, height, attitude), anchor s, yaw, command."""

    time_s: float
    horizontal_z: np.ndarray
    height_z: float
    attitude_z: np.ndarray
    anchor: np.ndarray
    anchor_velocity: np.ndarray
    anchor_acceleration: np.ndarray
    anchor_yaw: float
    anchor_yaw_rate: float
    yaw: float
    outer_active: bool
    tilt: np.ndarray
    thrust: float
    torque: np.ndarray
    horizontal_rate: np.ndarray
    height_rate: float
    attitude_rate: np.ndarray


@dataclass
class TwinLadder:
    ned_from_body: np.ndarray
    rates: np.ndarray
    torque: np.ndarray
    thrust: float
    saturated: bool


def rotation(angle: float) -> np.ndarray:
    """From north and east to the axes of a frame turned by ``angle`` about down."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s], [-s, c]])


def wrapped(angle: float) -> float:
    return (angle + math.pi) % math.tau - math.pi


class Inputs:
    """Estimate and reference as arrays, the reference's motion zeroed where the law does not feed it forward."""

    def __init__(self, law: CascadeLaw, estimate: Estimate, reference: Reference, unwrapped_from: float) -> None:
        moving = reference if law.feed_forward else Reference((0.0, 0.0, 0.0))
        self.euler = np.array(estimate.euler_rad)
        self.rates = np.array(estimate.rates_body_rad_s)
        self.position = np.array(estimate.position_ned_m)
        self.velocity = np.array(estimate.velocity_ned_m_s)
        self.target = np.array(reference.position_ned_m)
        self.velocity_ff = np.array(moving.velocity_ned_m_s)
        self.acceleration_ff = np.array(moving.acceleration_ned_m_s2)
        self.jerk_ff = np.array(moving.jerk_ned_m_s3)
        self.yaw_rate_ff = moving.yaw_rate_rad_s
        self.yaw = unwrapped_from + wrapped(estimate.euler_rad[2] - unwrapped_from)
        self.yaw_error = wrapped(reference.yaw_rad - self.yaw)
        self.frame = rotation(self.yaw - law.vehicle.model_yaw_rad)
        self.tilt_from_ned = TILT_FROM_ACCELERATION @ rotation(self.yaw)
        cosine = math.cos(self.euler[0]) * math.cos(self.euler[1])
        self.tilt_cosine = max(LEAST_TILT_COSINE, cosine) if law.feed_forward else 1.0


def tilt_direct(law: CascadeLaw, x: Inputs, anchor: np.ndarray) -> np.ndarray:
    g = law.gains
    acceleration = (x.acceleration_ff + law.vehicle.linear_drag_1_s * x.velocity_ff)[:2]
    offset, speed = (x.position - anchor)[:2], (x.velocity - x.velocity_ff)[:2]
    feedback = g.horizontal_k @ np.concatenate((x.frame @ offset, x.frame @ speed))
    return x.tilt_from_ned @ acceleration - feedback + g.horizontal_kr @ x.frame @ (x.target - anchor)[:2]


def force_direct(law: CascadeLaw, x: Inputs, anchor: np.ndarray) -> float:
    g, vehicle = law.gains, law.vehicle
    acceleration = (x.acceleration_ff + vehicle.linear_drag_1_s * x.velocity_ff)[2]
    state = np.array([(x.position - anchor)[2], (x.velocity - x.velocity_ff)[2]])
    proportional = g.height_kr * (x.target - anchor)[2]
    return float(vehicle.weight_n - vehicle.mass_kg * acceleration - g.height_k @ state + proportional)


def torque_direct(law: CascadeLaw, x: Inputs, anchor_yaw: float, tilt: np.ndarray, outer: bool) -> np.ndarray:
    g, vehicle, drag = law.gains, law.vehicle, law.vehicle.linear_drag_1_s
    anchor, anchor_rate = np.zeros(2), np.zeros(2)
    if law.feed_forward and outer:
        anchor = x.tilt_from_ned @ (x.acceleration_ff + drag * x.velocity_ff)[:2]
        turning = x.yaw_rate_ff * np.array([anchor[1], -anchor[0]])
        anchor_rate = x.tilt_from_ned @ (x.jerk_ff + drag * x.acceleration_ff)[:2] + turning
    rates = np.array([*anchor_rate, x.yaw_rate_ff])
    yaw = x.yaw - anchor_yaw
    speed = x.frame @ (x.velocity - x.velocity_ff)[:2]
    state = np.array([*(x.euler[:2] - anchor), yaw, *(x.rates - rates), *speed])
    reference = np.array([*(tilt - anchor), yaw + x.yaw_error])
    motion = np.array([*(rotation(x.yaw) @ x.velocity_ff[:2]), x.velocity_ff[2], *rates])
    torque_ff = -vehicle.inertia_kg_m2 * (vehicle.aerodynamic_moments @ motion)
    return torque_ff - g.attitude_k @ state + g.attitude_kr @ reference


def seed(law, estimate, reference, last, *, outer_active=True) -> TwinState:
    x = Inputs(law, estimate, reference, estimate.euler_rad[2])
    anchor_yaw, tilt = x.yaw + x.yaw_error, np.array(last.tilt_rad)
    return TwinState(
        time_s=estimate.time_s,
        horizontal_z=np.linalg.inv(x.tilt_from_ned) @ (tilt - tilt_direct(law, x, x.target)),
        height_z=last.thrust_n * x.tilt_cosine - force_direct(law, x, x.target),
        attitude_z=np.array(last.torque_n_m) - torque_direct(law, x, anchor_yaw, tilt, outer_active),
        anchor=x.target,
        anchor_velocity=x.velocity_ff,
        anchor_acceleration=x.acceleration_ff,
        anchor_yaw=anchor_yaw,
        anchor_yaw_rate=x.yaw_rate_ff,
        yaw=x.yaw,
        outer_active=outer_active,
        tilt=tilt,
        thrust=last.thrust_n,
        torque=np.array(last.torque_n_m),
        horizontal_rate=np.zeros(2),
        height_rate=0.0,
        attitude_rate=np.zeros(3),
    )


def step(state, estimate, reference, *, law, limits, tilt_reference_rad=None) -> tuple[TwinState, TwinLadder]:
    g, outer = law.gains, tilt_reference_rad is None
    x = Inputs(law, estimate, reference, state.yaw)
    elapsed = min(max(estimate.time_s - state.time_s, 0.0), LONGEST_STEP_S)
    anchor = state.anchor + elapsed * (state.anchor_velocity + 0.5 * elapsed * state.anchor_acceleration)
    anchor_yaw = state.anchor_yaw + elapsed * state.anchor_yaw_rate
    horizontal_z = state.horizontal_z + elapsed * state.horizontal_rate
    height_z = state.height_z + elapsed * state.height_rate
    attitude_z = state.attitude_z + elapsed * state.attitude_rate

    if outer:
        direct = tilt_direct(law, x, anchor)
        if not state.outer_active:
            horizontal_z = np.linalg.inv(x.tilt_from_ned) @ (state.tilt - direct)
        wanted_tilt = direct + x.tilt_from_ned @ horizontal_z
    else:
        wanted_tilt = np.array(tilt_reference_rad)
    scale = min(1.0, limits.tilt_rad / max(math.hypot(*wanted_tilt), 1e-9))
    tilt = wanted_tilt * scale
    thrust = (force_direct(law, x, anchor) + height_z) / x.tilt_cosine
    torque = torque_direct(law, x, anchor_yaw, tilt, outer) + attitude_z
    wanted, given = np.array([thrust, *torque]), np.empty(4)
    cut = achievable(wanted, law.vehicle.mixer, given)
    lost = wanted - given

    push = g.horizontal_ki @ x.frame @ (x.target - x.position)[:2]
    frozen = (scale < 1.0 or cut & TILT_TORQUE_CUT) and push @ wanted_tilt > 0.0
    height_rate = float(g.height_ki * (x.target - x.position)[2])
    attitude_rate = g.attitude_ki @ np.array([*(tilt - x.euler[:2]), x.yaw_error])
    next_state = replace(
        state,
        time_s=estimate.time_s,
        horizontal_z=horizontal_z,
        height_z=height_z,
        attitude_z=attitude_z,
        anchor=anchor,
        anchor_velocity=x.velocity_ff,
        anchor_acceleration=x.acceleration_ff,
        anchor_yaw=anchor_yaw,
        anchor_yaw_rate=x.yaw_rate_ff,
        yaw=x.yaw,
        outer_active=outer,
        tilt=tilt,
        thrust=thrust,
        torque=torque,
        horizontal_rate=np.linalg.inv(x.tilt_from_ned) @ push if outer and not frozen else np.zeros(2),
        height_rate=0.0 if height_rate * lost[0] > 0.0 else height_rate,
        attitude_rate=np.where(attitude_rate * lost[1:] > 0.0, 0.0, attitude_rate),
    )
    ahead = x.rates + law.vehicle.rotor_lag_s * torque / law.vehicle.inertia_kg_m2
    attitude = quaternion_from_euler(tilt[0], tilt[1], reference.yaw_rad)
    return next_state, TwinLadder(attitude, ahead, torque, thrust, scale < 1.0 or cut != 0)
