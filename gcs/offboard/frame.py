"""One tick as a frame of the signal table: what recorder, stream, dashboard and reports see."""

from __future__ import annotations

import math

import numpy as np

from gcs.offboard.modes import State
from gcs.offboard.vehicle_view import VehicleView
from gcs.records import TickInputs
from gcs.signals import SLICES, empty_frame
from models.arrays import Array
from models.estimate import Estimate, Innovation, Reference
from models.frames import euler_from_quaternion
from models.setpoints import Ladder

CONTROLLER_NUMBERS = {"lqr": 1.0, "pid": 2.0}
# Filled as a list: item by item that costs a fraction of what numpy's slices do.
Values = list[float]
_NO_OUTPUTS = (math.nan,) * 4
_NO_VECTOR = (math.nan,) * 3
_EMPTY: Values = empty_frame().tolist()


def signal_frame(
    *,
    t_s: float,
    state: State,
    inputs: TickInputs,
    view: VehicleView,
    estimate: Estimate | None,
    innovations: tuple[Innovation, ...],
    reference: Reference | None,
    ladder: Ladder | None,
    controller: str,
    gain_set: int,
) -> Array:
    """The frame of this tick, shape (gcs.signals.FRAME_SIZE,); NaN where there is no value now."""
    frame = _EMPTY.copy()
    frame[SLICES["time"]] = (t_s,)
    frame[SLICES["link.latency"]] = (inputs.link_latency_s,)
    frame[SLICES["link.received"]] = (inputs.link_received,)
    frame[SLICES["link.rate"]] = (inputs.link_rate_hz,)
    frame[SLICES["mode.state"]] = (float(state),)
    frame[SLICES["mode.armed"]] = (float(view.armed),)
    frame[SLICES["control.kind"]] = (CONTROLLER_NUMBERS[controller],)
    frame[SLICES["control.gain_set"]] = (float(gain_set),)
    _fill_vehicle(frame, view)
    if estimate is not None:
        _fill_estimate(frame, estimate)
    if innovations:
        worst = max(innovations, key=lambda innovation: innovation.nis / len(innovation.innovation))
        frame[SLICES["estimate.nis"]] = (worst.nis / len(worst.innovation),)
    if reference is not None:
        frame[SLICES["reference.position_ned"]] = reference.position_ned_m
        frame[SLICES["reference.velocity_ned"]] = reference.velocity_ned_m_s
        frame[SLICES["reference.yaw"]] = (reference.yaw_rad,)
    if ladder is not None:
        _fill_control(frame, ladder)
    return np.array(frame)


def _fill_vehicle(frame: Values, view: VehicleView) -> None:
    if view.imu is not None:
        frame[SLICES["imu.gyro_body"]] = view.imu.gyro_body_rad_s
        frame[SLICES["imu.accel_body"]] = view.imu.accel_body_m_s2
    if view.autopilot_ned_from_body is not None:
        frame[SLICES["autopilot.euler"]] = euler_from_quaternion(np.array(view.autopilot_ned_from_body)).tolist()
    frame[SLICES["autopilot.position_ned"]] = view.autopilot_position_ned_m
    frame[SLICES["autopilot.velocity_ned"]] = view.autopilot_velocity_ned_m_s
    frame[SLICES["actuator.outputs"]] = (*view.actuator_outputs, *_NO_OUTPUTS)[:4]
    frame[SLICES["battery.voltage"]] = (view.battery_v,)
    frame[SLICES["battery.remaining"]] = (view.battery_remaining,)


def _fill_estimate(frame: Values, estimate: Estimate) -> None:
    frame[SLICES["estimate.position_ned"]] = estimate.position_ned_m if estimate.position_valid else _NO_VECTOR
    frame[SLICES["estimate.velocity_ned"]] = estimate.velocity_ned_m_s if estimate.position_valid else _NO_VECTOR
    frame[SLICES["estimate.euler"]] = estimate.euler_rad
    frame[SLICES["estimate.ned_from_body"]] = estimate.ned_from_body
    frame[SLICES["estimate.rates_body"]] = estimate.rates_body_rad_s
    frame[SLICES["estimate.gyro_bias"]] = estimate.gyro_bias_rad_s
    frame[SLICES["estimate.accel_bias"]] = estimate.accel_bias_m_s2
    std = [math.sqrt(max(variance, 0.0)) for variance in estimate.covariance.diagonal()[:9].tolist()]
    frame[SLICES["estimate.position_std"]] = std[0:3]
    frame[SLICES["estimate.velocity_std"]] = std[3:6]
    frame[SLICES["estimate.attitude_std"]] = std[6:9]
    (nn, ne, nd), (_, ee, ed), (_, _, dd) = estimate.covariance[:3, :3].tolist()
    frame[SLICES["estimate.position_covariance"]] = (nn, ne, nd, ee, ed, dd)


def _fill_control(frame: Values, ladder: Ladder) -> None:
    frame[SLICES["control.euler_command"]] = euler_from_quaternion(np.array(ladder.ned_from_body)).tolist()
    frame[SLICES["control.rates_command"]] = ladder.rates_body_rad_s
    frame[SLICES["control.torque_body"]] = ladder.torque_body_n_m
    frame[SLICES["control.thrust"]] = (ladder.thrust_n,)
    frame[SLICES["control.saturated"]] = (float(ladder.saturated),)
