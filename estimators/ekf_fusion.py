"""One function per sensor: rows, gate, update, and recovery when a good source has been rejected for long."""

from __future__ import annotations

import math

import numpy as np

from estimators.ekf_alignment import adopt_earth_field, set_yaw, start_provisional_field
from estimators.ekf_measurements import (
    attitude_rows,
    barometer_row,
    drag_rows,
    heading_row,
    magnetic_rows,
    position_rows,
    range_row,
    velocity_rows,
)
from estimators.ekf_model import (
    ACCEL_BIAS,
    BAROMETER_OFFSET,
    ERROR_ACCEL_BIAS,
    ERROR_BAROMETER_OFFSET,
    ERROR_GNSS_DELAY,
    ERROR_GYRO_BIAS,
    ERROR_MAGNETIC_BIAS,
    ERROR_POSITION,
    ERROR_VELOCITY,
    GNSS_DELAY,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    inject,
)
from estimators.ekf_parameters import EkfParameters, PoseAttitude
from estimators.ekf_state import EkfState, Reset
from estimators.kalman import joseph_update, reset_block
from models.atmosphere import height_m as pressure_height_m
from models.estimate import Innovation
from models.frames import STANDARD_GRAVITY_M_S2, Array, Geodetic, Vec3, ned_from_geodetic
from models.samples import BarometerSample, GnssSample, MagnetometerSample, PoseSample, RangeSample

ZERO = np.zeros(3)
FIX_3D = 3
REST_INTERVAL_S = 0.2
REST_STD_M_S = 0.3
REST_ACCEL_M_S2 = 0.5
REST_RATE_RAD_S = 0.1


def fuse(state: EkfState, source: str, time_s: float, rows: int) -> Innovation:
    """Gate and fuse the rows now in the state's scratch arrays; record the outcome, whichever it is."""
    threshold = float(state.thresholds[rows])
    accepted = joseph_update(
        state.covariance,
        state.innovation,
        state.jacobian,
        state.variance,
        rows,
        threshold,
        state.correction,
        state.report,
    )
    report = state.report.tolist()
    outcome = Innovation(
        source=source,
        time_s=time_s,
        innovation=tuple(state.innovation[:rows].tolist()),
        variance=tuple(report[2 : 2 + rows]),
        nis=report[0],
        gate_ratio=report[1],
        accepted=accepted,
    )
    health = state.source(source)
    if accepted:
        inject(state.nominal, state.covariance, state.correction)
        health.accepted = True
        health.rejected_since_s = math.nan
    elif math.isnan(health.rejected_since_s):
        health.rejected_since_s = time_s
    health.fused_s = time_s
    state.innovations.append(outcome)
    return outcome


def source_alive(state: EkfState, source: str, params: EkfParameters) -> bool:
    """Whether a source is heard and believed: neither silent nor rejected for max(.1 s, 3 x its measured interval)."""
    health = state.health.get(source)
    if health is None or not health.accepted:
        return False
    limit_s = health.silence_limit_s(params)
    # A comparison with NaN is false: not rejected.
    return (
        state.newest_arrival_s - health.heard_arrival_s <= limit_s
        and not state.time_s - health.rejected_since_s > limit_s
    )


def stuck(state: EkfState, source: str, time_s: float, params: EkfParameters) -> bool:
    """Whether a source has been rejected without a break for ``reset_after_s``, and at least three of its intervals."""
    health = state.source(source)
    patience_s = params.reset_after_s
    if not math.isnan(health.interval_s):
        patience_s = max(patience_s, 3.0 * health.interval_s)
    return time_s - health.rejected_since_s >= patience_s


def reset_position(
    state: EkfState,
    source: str,
    time_s: float,
    reason: str,
    position: Array,
    std_m: Vec3,
    velocity: Array | None,
    speed_std_m_s: float,
) -> None:
    """Put the position (and velocity, where measured) on a measurement and forget its old uncertainty; report it."""
    before = state.nominal[:6].copy()
    state.nominal[POSITION] = position
    reset_block(state.covariance, ERROR_POSITION, np.square(np.array(std_m)))
    if velocity is not None:
        known = np.isfinite(velocity)
        state.nominal[VELOCITY] = np.where(known, velocity, 0.0)
        reset_block(state.covariance, ERROR_VELOCITY, np.where(known, speed_std_m_s**2, 1.0))
    state.barometer_started = False
    state.positioned = True
    delta = (state.nominal[:6] - before).tolist()
    state.resets.append(Reset(source, time_s, reason, (delta[0], delta[1], delta[2]), (delta[3], delta[4], delta[5])))


def fuse_pose(state: EkfState, sample: PoseSample, nominal: Array, params: EkfParameters) -> None:
    """Motion capture: position, and heading (Raja (3.14)) or the whole attitude."""
    stamp = sample.time_s
    state.source("pose").heard(stamp)
    state.last_pose = sample
    position = np.array(sample.position_ned_m)
    std = params.pose_position_std_m
    if not state.positioned:
        reset_position(state, "pose", stamp, "first pose", position, (std, std, std), None, 0.0)
        return
    position_rows(nominal, position, ZERO, 0.0, state.innovation, state.jacobian)
    state.variance[:3] = std * std
    w, x, y, z = sample.ned_from_body
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    if params.pose_attitude is PoseAttitude.FULL:
        attitude_rows(nominal, np.array(sample.ned_from_body), 3, state.innovation, state.jacobian)
        state.variance[3:5] = params.pose_tilt_std_rad**2
        state.variance[5] = params.pose_yaw_std_rad**2
        rows = 6
    else:
        heading_row(nominal, yaw, 3, state.innovation, state.jacobian)
        state.variance[3] = params.pose_yaw_std_rad**2
        rows = 4
    outcome = fuse(state, "pose", stamp, rows)
    _open_biases(state, outcome, rows, params)
    if not outcome.accepted and stuck(state, "pose", stamp, params):
        reset_position(state, "pose", stamp, "rejected for long", position, (std, std, std), None, 0.0)
        reset_block(state.covariance, ERROR_VELOCITY, np.full(3, 1.0))
        set_yaw(state, "pose", stamp, "rejected for long", yaw, params.pose_yaw_std_rad)


def _open_biases(state: EkfState, outcome: Innovation, rows: int, params: EkfParameters) -> None:
    """NIS-triggered inflation: a running mean of NIS per row above its threshold opens the bias covariance once.

    The process noise stays matched, so the filter is consistent in peace, and a jumped bias is relearnt within seconds.
    """
    if not params.bias_inflation:
        return
    health = state.source("pose")
    interval_s = 0.01 if math.isnan(health.interval_s) else health.interval_s
    weight = min(1.0, interval_s / params.inflation_window_s)
    state.nis_mean += weight * (min(outcome.nis / rows, 50.0) - state.nis_mean)
    if state.nis_mean > params.inflation_nis_ratio and outcome.time_s - state.inflated_s > params.inflation_hold_s:
        for k in range(3):
            state.covariance[ERROR_GYRO_BIAS + k, ERROR_GYRO_BIAS + k] += params.inflation_gyro_std_rad_s**2
            state.covariance[ERROR_ACCEL_BIAS + k, ERROR_ACCEL_BIAS + k] += params.inflation_accel_std_m_s2**2
        state.inflated_s = outcome.time_s
        state.resets.append(Reset("pose", outcome.time_s, "innovations too large: bias covariance opened"))


def fuse_gnss(state: EkfState, sample: GnssSample, nominal: Array, params: EkfParameters) -> None:
    """Satellite position, velocity and heading, at the time the fix is true for.

    Stands back while motion capture is alive: the two frames agree to metres only.
    """
    if sample.fix_type < FIX_3D or source_alive(state, "pose", params):
        return
    stamp = sample.time_s
    state.source("gnss_position").heard(stamp)
    place = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
    if state.origin is None:
        state.origin = place
    if not state.field_known and params.use_magnetometer:
        adopt_earth_field(state, place, stamp, params)
    position = np.array(ned_from_geodetic(place, state.origin))
    horizontal = sample.horizontal_std_m if sample.horizontal_std_m > 0.0 else params.gnss_position_std_m
    vertical = sample.vertical_std_m if sample.vertical_std_m > 0.0 else params.gnss_vertical_std_m
    speed_std = sample.speed_std_m_s if sample.speed_std_m_s > 0.0 else params.gnss_speed_std_m_s
    velocity = None if sample.velocity_ned_m_s is None else np.array(sample.velocity_ned_m_s)
    std = (horizontal, horizontal, vertical)
    if not state.positioned:
        reset_position(state, "gnss_position", stamp, "first fix", position, std, velocity, max(speed_std, 0.3))
        state.nominal[GNSS_DELAY] = 0.0
        reset_block(state.covariance, ERROR_GNSS_DELAY, np.array([params.gnss_delay_std_s**2]))
        state.source("gnss_position").accepted = True
        return
    lever = np.array(params.gnss_lever_body_m)
    position_rows(nominal, position, lever, 1.0, state.innovation, state.jacobian)
    state.variance[:2] = horizontal * horizontal
    state.variance[2] = vertical * vertical
    outcome = fuse(state, "gnss_position", stamp, 3)
    if velocity is not None and math.isfinite(velocity[0]):
        imu = state.imu_row(state.imu_fused)[1:]
        down_known = math.isfinite(velocity[2])
        velocity_rows(nominal, np.nan_to_num(velocity), lever, imu, state.innovation, state.jacobian)
        state.variance[:3] = speed_std * speed_std
        fuse(state, "gnss_velocity", stamp, 3 if down_known else 2)
    if sample.yaw_rad is not None:
        heading_row(nominal, sample.yaw_rad, 0, state.innovation, state.jacobian)
        state.variance[0] = params.gnss_yaw_std_rad**2
        fuse(state, "gnss_yaw", stamp, 1)
    if not outcome.accepted and stuck(state, "gnss_position", stamp, params):
        reset_position(state, "gnss_position", stamp, "rejected for long", position, std, velocity, max(speed_std, 0.3))
        state.source("gnss_position").rejected_since_s = math.nan
        state.source("gnss_position").accepted = True


def fuse_magnetometer(state: EkfState, sample: MagnetometerSample, nominal: Array, params: EkfParameters) -> None:
    """Magnetic field in body axes, against the Earth field and the hard iron carried as states."""
    stamp = sample.time_s
    state.source("magnetometer").heard(stamp)
    if not params.use_magnetometer or stamp - state.source("magnetometer").fused_s < params.magnetometer_min_interval_s:
        return
    state.last_magnetometer = sample
    if not state.field_started:
        start_provisional_field(state, sample, params)
        return
    magnetic_rows(nominal, np.array(sample.field_body_t), state.innovation, state.jacobian)
    state.variance[:3] = params.magnetometer_std_t**2
    outcome = fuse(state, "magnetometer", stamp, 3)
    if not outcome.accepted and stuck(state, "magnetometer", stamp, params):
        reset_block(state.covariance, ERROR_MAGNETIC_BIAS, np.full(3, params.magnetic_bias_std_t**2))
        state.source("magnetometer").rejected_since_s = math.nan
        state.resets.append(Reset("magnetometer", stamp, "rejected for long: magnetic bias forgotten"))


def fuse_barometer(state: EkfState, sample: BarometerSample, nominal: Array, params: EkfParameters) -> None:
    """Pressure height, with an offset that starts at the first reading and follows the weather."""
    stamp = sample.time_s
    health = state.source("barometer")
    health.heard(stamp)
    if not params.use_barometer or stamp - health.fused_s < params.barometer_min_interval_s:
        return
    height_m = pressure_height_m(sample.pressure_pa)
    state.variance[0] = params.barometer_std_m**2
    late = not state.barometer_started
    if not late:
        barometer_row(nominal, height_m, state.innovation, state.jacobian)
        outcome = fuse(state, "barometer", stamp, 1)
        late = not outcome.accepted and stuck(state, "barometer", stamp, params)
        if late:
            state.resets.append(Reset("barometer", stamp, "rejected for long: offset learnt anew"))
    if late:
        state.nominal[BAROMETER_OFFSET] = height_m + float(nominal[2])
        reset_block(state.covariance, ERROR_BAROMETER_OFFSET, np.array([params.barometer_std_m**2]))
        state.density[ERROR_BAROMETER_OFFSET] = params.barometer_offset_walk_m**2
        state.barometer_started = True
        health.rejected_since_s = math.nan


def fuse_range(state: EkfState, sample: RangeSample, nominal: Array, params: EkfParameters) -> None:
    """Distance to level ground; the ground's height is taken from the first reading, and anew after long rejection."""
    stamp = sample.time_s
    state.source("range").heard(stamp)
    w, x, y, z = nominal[6:10].tolist()
    cosine = w * w + z * z - x * x - y * y
    if not params.use_range or not sample.min_m < sample.distance_m < sample.max_m or cosine < 0.5:
        return
    if not state.positioned:
        return
    if math.isnan(state.ground_down_m):
        state.ground_down_m = float(nominal[2]) + sample.distance_m * cosine
        return
    range_row(nominal, sample.distance_m, state.ground_down_m, state.innovation, state.jacobian)
    state.variance[0] = params.range_std_m**2
    outcome = fuse(state, "range", stamp, 1)
    if not outcome.accepted and stuck(state, "range", stamp, params):
        state.ground_down_m = float(nominal[2]) + sample.distance_m * cosine
        state.source("range").rejected_since_s = math.nan
        state.resets.append(Reset("range", stamp, "rejected for long: ground height learnt anew"))


def fuse_drag(state: EkfState, imu: Array, params: EkfParameters) -> None:
    """Accelerometer x and y as drag, Raja (3.14); the wind it ignores widens the rows."""
    drag_rows(state.nominal, imu[3:], params.drag_1_s, state.innovation, state.jacobian)
    state.variance[:2] = params.drag_accel_std_m_s2**2 + (params.drag_1_s * params.wind_std_m_s) ** 2
    fuse(state, "drag", state.time_s, 2)


def fuse_rest(state: EkfState, imu: Array) -> None:
    """Before any position source spoke: while the IMU feels nothing but gravity, the velocity is taken for zero.

    Keeps the tilt level and teaches the gyro bias on the ground; never used once a position source has been heard.
    """
    if state.time_s - state.rest_fused_s < REST_INTERVAL_S:
        return
    w, f = imu[:3] - state.nominal[GYRO_BIAS], imu[3:] - state.nominal[ACCEL_BIAS]
    if abs(math.sqrt(float(f @ f)) - STANDARD_GRAVITY_M_S2) > REST_ACCEL_M_S2 or float(w @ w) > REST_RATE_RAD_S**2:
        return
    state.rest_fused_s = state.time_s
    state.jacobian[:3] = 0.0
    for k in range(3):
        state.innovation[k] = -state.nominal[ERROR_VELOCITY + k]
        state.jacobian[k, ERROR_VELOCITY + k] = 1.0
    state.variance[:3] = REST_STD_M_S**2
    fuse(state, "rest", state.time_s, 3)
