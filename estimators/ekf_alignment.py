"""Start of the full-state filter: level by the accelerometer, heading by mocap or magnetometer, the Earth field."""

from __future__ import annotations

import math

import numpy as np

from estimators.ekf_model import (
    EARTH_FIELD,
    ERROR_ACCEL_BIAS,
    ERROR_ATTITUDE,
    ERROR_EARTH_FIELD,
    ERROR_GYRO_BIAS,
    ERROR_MAGNETIC_BIAS,
    ERROR_POSITION,
    ERROR_VELOCITY,
    MAGNETIC_BIAS,
    QUATERNION,
)
from estimators.ekf_parameters import EkfParameters
from estimators.ekf_state import EkfState, Reset
from estimators.kalman import reset_block
from models.frames import (
    STANDARD_GRAVITY_M_S2,
    Array,
    Geodetic,
    euler_from_quaternion,
    quaternion_from_euler,
    quaternion_multiply,
    rotation_from_quaternion,
    wrap_angle,
)
from models.magnetic_field import earth_field_ned_t
from models.samples import MagnetometerSample, PoseSample

UNPOSITIONED_STD_M = 10.0
TILT_DIRECTION_MIN_M_S2 = 1.0


def align(
    state: EkfState, pose: PoseSample | None, magnetometer: MagnetometerSample | None, params: EkfParameters
) -> None:
    """Set attitude, velocity and biases from the IMU samples since ``align_first`` and one source of heading.

    Tilt: the mean specific force points up if the vehicle does not accelerate; how much it differs from g, and how fast
    it turns, widens the tilt. A pose, when there is one, gives the whole attitude. Does nothing without a heading.
    """
    rows = np.array([state.imu_row(i) for i in range(state.align_first, state.imu_count)])
    force = np.mean(rows[:, 4:7], axis=0)
    turning = float(np.linalg.norm(np.mean(rows[:, 1:4], axis=0)))
    norm = float(np.linalg.norm(force))
    if norm < TILT_DIRECTION_MIN_M_S2:
        return
    roll = math.atan2(-force[1], -force[2])
    pitch = math.atan2(force[0], math.hypot(force[1], force[2]))
    tilt_std = params.initial_tilt_std_rad + abs(norm / STANDARD_GRAVITY_M_S2 - 1.0) + 0.5 * min(turning, 1.0)
    if pose is not None:
        quaternion = np.array(pose.ned_from_body)
        roll, pitch, yaw = euler_from_quaternion(quaternion / np.linalg.norm(quaternion)).tolist()
        tilt_std, yaw_std = params.pose_tilt_std_rad, params.pose_yaw_std_rad
    elif magnetometer is not None and params.use_magnetometer:
        yaw, horizontal_t = _magnetic_heading(roll, pitch, np.array(magnetometer.field_body_t))
        yaw += _declination_rad(state, params) or 0.0
        yaw_std = params.magnetic_bias_std_t / max(horizontal_t, 1e-6) + 2.0 * tilt_std
    else:
        return
    state.nominal[:] = 0.0
    state.nominal[QUATERNION] = quaternion_from_euler(roll, pitch, wrap_angle(yaw))
    state.covariance[:, :] = 0.0
    _set_diagonal(state, ERROR_POSITION, UNPOSITIONED_STD_M, UNPOSITIONED_STD_M, UNPOSITIONED_STD_M)
    moving = 0.0 if turning < 0.1 and abs(norm - STANDARD_GRAVITY_M_S2) < 0.5 else 20.0
    _set_diagonal(state, ERROR_VELOCITY, *[params.initial_velocity_std_m_s + moving] * 3)
    _set_diagonal(state, ERROR_GYRO_BIAS, *[params.initial_gyro_bias_std_rad_s] * 3)
    _set_diagonal(state, ERROR_ACCEL_BIAS, *[params.initial_accel_bias_std_m_s2] * 3)
    _set_attitude_std(state, tilt_std, min(yaw_std, 1.0))
    newest = state.imu_count - 1
    state.imu_fused = newest
    state.time_s = float(state.imu_row(newest)[0])
    state.running = True
    if params.use_magnetometer and (params.earth_field_ned_t is not None or state.origin is not None):
        place = state.origin or Geodetic(0.0, 0.0, 0.0)
        _start_field(state, _earth_field(place, params), params)


def _set_diagonal(state: EkfState, first: int, *std: float) -> None:
    reset_block(state.covariance, first, np.square(np.array(std)))


def _set_attitude_std(state: EkfState, tilt_std: float, yaw_std: float) -> None:
    """Attitude covariance in body axes for independent tilt and heading errors: R' diag(t^2, t^2, y^2) R."""
    r = rotation_from_quaternion(state.nominal[QUATERNION])
    reset_block(state.covariance, ERROR_ATTITUDE, np.ones(3))
    block = r.T @ np.diag([tilt_std**2, tilt_std**2, yaw_std**2]) @ r
    state.covariance[ERROR_ATTITUDE : ERROR_ATTITUDE + 3, ERROR_ATTITUDE : ERROR_ATTITUDE + 3] = 0.5 * (block + block.T)


def _magnetic_heading(roll: float, pitch: float, field_body_t: Array) -> tuple[float, float]:
    """Tilt-compensated heading from magnetic north [rad] and the horizontal field it rests on [T]."""
    level = rotation_from_quaternion(quaternion_from_euler(roll, pitch, 0.0)) @ field_body_t
    return math.atan2(-level[1], level[0]), math.hypot(level[0], level[1])


def _earth_field(place: Geodetic, params: EkfParameters) -> Array:
    """Field [T] given by the parameters, or by the World Magnetic Model turned to a given declination."""
    if params.earth_field_ned_t is not None:
        return np.array(params.earth_field_ned_t)
    field = np.array(earth_field_ned_t(place, params.magnetic_year))
    if params.declination_rad is not None:
        horizontal = math.hypot(field[0], field[1])
        field[0], field[1] = (
            horizontal * math.cos(params.declination_rad),
            horizontal * math.sin(params.declination_rad),
        )
    return field


def _declination_rad(state: EkfState, params: EkfParameters) -> float | None:
    """Declination if anything tells it: parameters, or the World Magnetic Model at a known origin."""
    if params.declination_rad is not None and params.earth_field_ned_t is None:
        return params.declination_rad
    if params.earth_field_ned_t is None and state.origin is None:
        return None
    field = _earth_field(state.origin or Geodetic(0.0, 0.0, 0.0), params)
    return math.atan2(field[1], field[0])


def _start_field(state: EkfState, field_ned_t: Array, params: EkfParameters) -> None:
    state.nominal[EARTH_FIELD] = field_ned_t
    state.nominal[MAGNETIC_BIAS] = 0.0
    _set_diagonal(state, ERROR_EARTH_FIELD, *[params.earth_field_std_t] * 3)
    _set_diagonal(state, ERROR_MAGNETIC_BIAS, *[params.magnetic_bias_std_t] * 3)
    state.density[ERROR_EARTH_FIELD : ERROR_EARTH_FIELD + 3] = params.earth_field_walk_t**2
    state.density[ERROR_MAGNETIC_BIAS : ERROR_MAGNETIC_BIAS + 3] = params.magnetic_bias_walk_t**2
    state.field_started = True
    state.field_known = True


def start_provisional_field(state: EkfState, sample: MagnetometerSample, params: EkfParameters) -> None:
    """While no position tells the Earth field: take the field as measured for the Earth's, so that heading is held."""
    measured = rotation_from_quaternion(state.nominal[QUATERNION]) @ np.array(sample.field_body_t)
    _start_field(state, measured, params)
    _set_diagonal(state, ERROR_EARTH_FIELD, *[params.magnetic_bias_std_t] * 3)
    state.field_known = False


def adopt_earth_field(state: EkfState, place: Geodetic, time_s: float, params: EkfParameters) -> None:
    """The first fix tells the Earth field: from here on heading is from true north, turned there at once (a reset).

    Under motion capture the heading is already known, and the field measured with it is kept.
    """
    state.field_known = True
    if state.last_pose is not None:
        return
    _start_field(state, _earth_field(place, params), params)
    sample = state.last_magnetometer
    if sample is None:
        return
    yaw = level_heading_rad(state, sample)
    horizontal = math.hypot(float(state.nominal[EARTH_FIELD][0]), float(state.nominal[EARTH_FIELD][1]))
    yaw_std = params.magnetic_bias_std_t / max(horizontal, 1e-6)
    set_yaw(state, "magnetometer", time_s, "Earth field known from the first fix", yaw, min(yaw_std, 1.0))


def level_heading_rad(state: EkfState, sample: MagnetometerSample) -> float:
    """Heading from true north [rad] by one magnetometer reading, at the estimated tilt, field and bias."""
    roll, pitch, _ = euler_from_quaternion(state.nominal[QUATERNION]).tolist()
    field = np.array(sample.field_body_t) - state.nominal[MAGNETIC_BIAS]
    north, east, _ = state.nominal[EARTH_FIELD].tolist()
    return _magnetic_heading(roll, pitch, field)[0] + math.atan2(east, north)


def set_yaw(state: EkfState, source: str, time_s: float, reason: str, yaw_rad: float, std_rad: float) -> None:
    """Turn the estimate about the vertical to a heading, velocity with it; forget the old heading's covariance."""
    q = state.nominal[QUATERNION].copy()
    delta = wrap_angle(yaw_rad - float(euler_from_quaternion(q)[2]))
    state.nominal[QUATERNION] = quaternion_multiply(quaternion_from_euler(0.0, 0.0, delta), q)
    r = rotation_from_quaternion(state.nominal[QUATERNION])
    p = state.covariance
    vertical = r[2, :].copy()
    along = slice(ERROR_ATTITUDE, ERROR_ATTITUDE + 3)
    # Take the attitude error along the vertical out of every correlation, then give it its own variance.
    keep = np.eye(3) - np.outer(vertical, vertical)
    p[along, :] = keep @ p[along, :]
    p[:, along] = p[:, along] @ keep
    p[along, along] += std_rad**2 * np.outer(vertical, vertical)
    state.resets.append(Reset(source, time_s, reason, yaw_delta_rad=delta))
