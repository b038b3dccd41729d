"""Full-state filter: position, velocity, attitude and IMU biases from the IMU and whatever aids it.

Raja section 3.1 in multiplicative error-state form (:mod:`estimators.ekf_model`), on a fixed-lag horizon: samples wait
in order until the horizon has reached them, so a fix that is .2 s old corrects the state of .2 s ago, exactly; the IMU
then carries that state to now. The horizon follows the age of the oldest measurement seen lately (``max_horizon_s`` at
most); what comes later still is fused at the horizon against the state carried back, or dropped and counted.

``step`` is pure in the sense of the house: no clock, no global state; the state object is changed and handed back.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np

from estimators.ekf_alignment import align
from estimators.ekf_fusion import (
    fuse_barometer,
    fuse_drag,
    fuse_gnss,
    fuse_magnetometer,
    fuse_pose,
    fuse_range,
    fuse_rest,
    source_alive,
)
from estimators.ekf_model import BAROMETER_OFFSET, CORE_SIZE, carry_to_now, predict, propagate_nominal
from estimators.ekf_parameters import EkfParameters
from estimators.ekf_state import IMU_RING_SIZE, EkfOutput, EkfState, Reset, initial
from models.estimate import Estimate
from models.frames import Geodetic, geodetic_from_ned, ned_from_geodetic
from models.samples import (
    AnySample,
    BarometerSample,
    GnssSample,
    HomeSample,
    ImuSample,
    MagnetometerSample,
    OriginSample,
    PoseSample,
    RangeSample,
)

__all__ = ["EkfOutput", "EkfParameters", "EkfState", "Reset", "initial", "step"]

SAME_TIME_S = 1e-3
REBOOT_S = 1.0
HORIZON_MARGIN_S = 2e-3
HORIZON_SHRINK = 5e-3
QUEUE_SIZE = 1000
ATTITUDE_VALID_STD_RAD = math.radians(10.0)

Aiding = PoseSample | GnssSample | MagnetometerSample | BarometerSample | RangeSample


def step(state: EkfState, samples: Sequence[AnySample], *, params: EkfParameters) -> tuple[EkfState, EkfOutput]:
    """One tick: take the samples since the last one, in arrival order, and estimate the state at the newest IMU.

    Kinds the filter has no use for are ignored. A stamp that jumps back by more than a second is a reboot of the
    vehicle: the filter starts anew and says so.
    """
    state.innovations.clear()
    state.resets.clear()
    dropped_before = state.dropped
    for sample in samples:
        match sample:
            case ImuSample():
                state = _take_imu(state, sample, params)
            case PoseSample() | GnssSample() | MagnetometerSample() | BarometerSample() | RangeSample():
                _enqueue(state, sample, params)
            case OriginSample():
                place = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
                _move_origin(state, place, sample.time_s, params)
                state.origin_from_vehicle = True
            case HomeSample():
                _take_home(state, sample, params)
            case _:
                pass
    if not state.running:
        _try_align(state, params)
    if state.running:
        _advance(state, params)
    output = EkfOutput(
        _estimate(state, params) if state.running else None,
        tuple(state.innovations),
        tuple(state.resets),
        state.dropped - dropped_before,
    )
    return state, output


def _take_imu(state: EkfState, sample: ImuSample, params: EkfParameters) -> EkfState:
    """Append an IMU sample; a repeat is dropped, a reboot or a long gap starts the filter anew."""
    gap_s = sample.time_s - state.newest_s
    if gap_s < -REBOOT_S:
        resets = [*state.resets, Reset("imu", sample.time_s, "vehicle time jumped back: started anew")]
        state = initial(params)
        state.resets = resets
    elif gap_s <= 0.0:
        state.dropped += 1
        return state
    elif gap_s > params.max_imu_gap_s and state.imu_count > 0:
        if state.running:
            state.resets.append(Reset("imu", sample.time_s, f"no IMU for {gap_s:.2f} s: aligned anew"))
        state.running = state.positioned = state.field_started = state.barometer_started = False
        state.field_known = False
        state.align_first = state.imu_count
    else:
        state.horizon_s = max(params.horizon_s, state.horizon_s - HORIZON_SHRINK * gap_s)
    state.push_imu(sample)
    return state


def _delay_and_rank(sample: Aiding, params: EkfParameters) -> tuple[float, int]:
    """Age of a measurement at its stamp, and its place among those of one time: arrival order must not matter."""
    match sample:
        case PoseSample():
            return params.pose_delay_s, 0
        case GnssSample():
            return params.gnss_delay_s, 1
        case MagnetometerSample():
            return params.magnetometer_delay_s, 2
        case BarometerSample():
            return 0.0, 3
        case RangeSample():
            return 0.0, 4


def _enqueue(state: EkfState, sample: Aiding, params: EkfParameters) -> None:
    """Put a measurement in line at the time it is true for; the horizon makes room for its age."""
    delay_s, rank = _delay_and_rank(sample, params)
    # To the microsecond of the wire: a delay taken off must not reorder what was simultaneous.
    true_s = round(sample.time_s - delay_s, 6)
    age_s = state.newest_s - true_s
    if state.imu_count > 0 and not -REBOOT_S < age_s < params.max_horizon_s + params.late_tolerance_s:
        state.dropped += 1
        return
    if state.horizon_s < age_s + HORIZON_MARGIN_S and age_s > SAME_TIME_S:
        state.horizon_s = min(age_s + HORIZON_MARGIN_S, params.max_horizon_s)
    if len(state.queue) >= QUEUE_SIZE:
        del state.queue[0]
        state.dropped += 1
    if isinstance(sample, PoseSample | GnssSample):
        source = "pose" if isinstance(sample, PoseSample) else "gnss_position"
        state.source(source).heard_arrival_s = sample.arrival_s
    state.queued += 1
    bisect.insort(state.queue, (true_s, rank, state.queued, sample))


def _move_origin(state: EkfState, place: Geodetic, time_s: float, params: EkfParameters) -> None:
    """The vehicle says where its local frame begins: ours moves there, so that both speak of the same place."""
    if params.origin is not None or state.origin == place:
        return
    if state.origin is not None and state.running and state.positioned:
        north, east, down = ned_from_geodetic(state.origin, place)
        state.nominal[:3] += (north, east, down)
        state.nominal[BAROMETER_OFFSET] += down
        state.ground_down_m += down
        state.resets.append(Reset("origin", time_s, "local origin moved to the vehicle's", (north, east, down)))
    state.origin = place


def _take_home(state: EkfState, sample: HomeSample, params: EkfParameters) -> None:
    """Home in geodetic and local coordinates tells the origin too, for vehicles that do not send it."""
    north, east, down = sample.position_ned_m
    if state.origin_from_vehicle or not math.isfinite(north + east + down):
        return
    home = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
    _move_origin(state, geodetic_from_ned((-north, -east, -down), home), sample.time_s, params)
    state.origin_from_vehicle = True


def _try_align(state: EkfState, params: EkfParameters) -> None:
    """Align once enough IMU samples and a heading are there; then drop the measurements that came before."""
    first = max(state.align_first, state.imu_count - IMU_RING_SIZE // 2)
    while state.newest_s - float(state.imu_row(first)[0]) > 2.0 * params.align_s and first < state.imu_count - 1:
        first += 1
    state.align_first = first
    if state.imu_count - first < 2 or state.newest_s - float(state.imu_row(first)[0]) < params.align_s:
        _forget_before(state, state.newest_s - 2.0 * params.align_s)
        return
    pose: PoseSample | None = None
    magnetometer: MagnetometerSample | None = None
    for _, _, _, sample in state.queue:
        if isinstance(sample, PoseSample):
            pose = sample
        elif isinstance(sample, MagnetometerSample):
            magnetometer = sample
    align(state, pose, magnetometer, params)
    if state.running:
        _forget_before(state, state.time_s)


def _forget_before(state: EkfState, time_s: float) -> None:
    del state.queue[: bisect.bisect_left(state.queue, (time_s, -1))]


def _advance(state: EkfState, params: EkfParameters) -> None:
    """Bring the fusion horizon forward through IMU samples and queued measurements, in order of time."""
    target_s = state.newest_s - state.horizon_s
    queue = state.queue
    while state.imu_fused + 1 < state.imu_count:
        until_s = float(state.imu_ring[(state.imu_fused + 1) % IMU_RING_SIZE, 0])
        if until_s > target_s + SAME_TIME_S:
            break
        while queue and queue[0][0] <= until_s - SAME_TIME_S:
            _fuse_first(state, params)
        _predict(state, until_s)
        state.imu_fused += 1
        while queue and queue[0][0] <= until_s:
            _fuse_first(state, params)
        if params.drag_1_s > 0.0:
            fuse_drag(state, state.imu_row(state.imu_fused)[1:], params)
        if not state.positioned:
            fuse_rest(state, state.imu_row(state.imu_fused)[1:])


def _predict(state: EkfState, until_s: float) -> None:
    """Advance the horizon within the interval after the last fused IMU sample."""
    dt_s = until_s - state.time_s
    predict(state.nominal, state.covariance, state.imu_ring, state.imu_fused, state.share_before, dt_s, state.density)
    state.time_s = until_s


def _fuse_first(state: EkfState, params: EkfParameters) -> None:
    """Fuse the first queued measurement: go to its time, or, if that has passed, carry the state back to compare."""
    true_s, _, _, sample = state.queue.pop(0)
    ahead_s = true_s - state.time_s
    nominal = state.nominal
    if ahead_s > SAME_TIME_S:
        _predict(state, true_s)
    elif ahead_s < -params.late_tolerance_s:
        state.dropped += 1
        return
    elif ahead_s < 0.0:
        nominal = state.nominal.copy()
        propagate_nominal(nominal, state.imu_row(state.imu_fused)[1:], ahead_s)
    match sample:
        case PoseSample():
            fuse_pose(state, sample, nominal, params)
        case GnssSample():
            fuse_gnss(state, sample, nominal, params)
        case MagnetometerSample():
            fuse_magnetometer(state, sample, nominal, params)
        case BarometerSample():
            fuse_barometer(state, sample, nominal, params)
        case RangeSample():
            fuse_range(state, sample, nominal, params)
        case _:
            raise TypeError(f"{type(sample).__name__} is not an aiding sample")


def _estimate(state: EkfState, params: EkfParameters) -> Estimate:
    """State and covariance carried from the horizon to the newest IMU sample."""
    nominal, euler, core = state.predicted, np.empty(3), np.empty((CORE_SIZE, CORE_SIZE))
    newest = state.imu_count - 1
    tilt_variance = carry_to_now(
        state.nominal,
        state.covariance,
        state.imu_ring,
        state.imu_fused,
        newest - state.imu_fused,
        state.share_before,
        state.time_s,
        state.density,
        nominal,
        euler,
        core,
    )
    px, py, pz, vx, vy, vz, qw, qx, qy, qz, gx, gy, gz, ax, ay, az, *_ = nominal.tolist()
    roll, pitch, yaw = euler.tolist()
    _, p, q, r, *_ = state.imu_row(newest).tolist()
    return Estimate(
        time_s=state.newest_s,
        position_ned_m=(px, py, pz),
        velocity_ned_m_s=(vx, vy, vz),
        ned_from_body=(qw, qx, qy, qz),
        euler_rad=(roll, pitch, yaw),
        rates_body_rad_s=(p - gx, q - gy, r - gz),
        gyro_bias_rad_s=(gx, gy, gz),
        accel_bias_m_s2=(ax, ay, az),
        covariance=core,
        position_valid=state.positioned
        and (source_alive(state, "pose", params) or source_alive(state, "gnss_position", params)),
        attitude_valid=tilt_variance < ATTITUDE_VALID_STD_RAD**2,
    )
