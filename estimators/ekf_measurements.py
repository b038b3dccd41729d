"""Measurement rows of the full-state filter: one kernel per sensor, each filling innovation, Jacobian and nothing else.

Every kernel takes the nominal state (24,), the measurement, and writes ``innovation`` (6,) = measured - predicted and
``jacobian`` (6, 23) = d(predicted)/d(error) for its rows; rows it does not use are left untouched. Angles are wrapped
here, before any gate sees them. The attitude error is a body rotation vector: R_true = R (I + [error]x).
"""

from __future__ import annotations

import math

import numpy as np

from models.frames import STANDARD_GRAVITY_M_S2, Array, rotation_from_quaternion, wrap_angle
from models.kernel import kernel


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[:,::1])")
def position_rows(
    nominal: Array, position_ned_m: Array, lever_body_m: Array, delayed: float, innovation: Array, jacobian: Array
) -> None:
    """Three rows: position of a point of the body, p + R lever - v delay; ``delayed`` is 1 for GNSS, 0 for mocap."""
    delay = delayed * nominal[17]
    r = rotation_from_quaternion(nominal[6:10])
    x, y, z = lever_body_m[0], lever_body_m[1], lever_body_m[2]
    for i in range(3):
        jacobian[i, :] = 0.0
        predicted = nominal[i] - nominal[3 + i] * delay + r[i, 0] * x + r[i, 1] * y + r[i, 2] * z
        innovation[i] = position_ned_m[i] - predicted
        jacobian[i, i] = 1.0
        jacobian[i, 3 + i] = -delay
        jacobian[i, 6] = r[i, 2] * y - r[i, 1] * z
        jacobian[i, 7] = r[i, 0] * z - r[i, 2] * x
        jacobian[i, 8] = r[i, 1] * x - r[i, 0] * y
        jacobian[i, 16] = -delayed * nominal[3 + i]


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def velocity_rows(
    nominal: Array, velocity_ned_m_s: Array, lever_body_m: Array, imu: Array, innovation: Array, jacobian: Array
) -> None:
    """Three rows: velocity of a point of the body, v + R (w x lever) - a delay, with the IMU reading (6,) then."""
    r = rotation_from_quaternion(nominal[6:10])
    w = np.empty(3)
    f = np.empty(3)
    for k in range(3):
        w[k] = imu[k] - nominal[10 + k]
        f[k] = imu[3 + k] - nominal[13 + k]
    lever = lever_body_m
    sweep = np.empty(3)
    sweep[0] = w[1] * lever[2] - w[2] * lever[1]
    sweep[1] = w[2] * lever[0] - w[0] * lever[2]
    sweep[2] = w[0] * lever[1] - w[1] * lever[0]
    delay = nominal[17]
    for k in range(3):
        sweep[k] -= delay * f[k]
    for i in range(3):
        jacobian[i, :] = 0.0
        gravity = STANDARD_GRAVITY_M_S2 if i == 2 else 0.0
        force = r[i, 0] * f[0] + r[i, 1] * f[1] + r[i, 2] * f[2]
        moved = r[i, 0] * sweep[0] + r[i, 1] * sweep[1] + r[i, 2] * sweep[2]
        innovation[i] = velocity_ned_m_s[i] - (nominal[3 + i] + moved - delay * gravity)
        jacobian[i, 3 + i] = 1.0
        jacobian[i, 6] = r[i, 2] * sweep[1] - r[i, 1] * sweep[2]
        jacobian[i, 7] = r[i, 0] * sweep[2] - r[i, 2] * sweep[0]
        jacobian[i, 8] = r[i, 1] * sweep[0] - r[i, 0] * sweep[1]
        # w = gyro - bias: d(R (w x lever))/d(bias) = R [lever]x
        jacobian[i, 9] = r[i, 1] * lever[2] - r[i, 2] * lever[1]
        jacobian[i, 10] = r[i, 2] * lever[0] - r[i, 0] * lever[2]
        jacobian[i, 11] = r[i, 0] * lever[1] - r[i, 1] * lever[0]
        for k in range(3):
            jacobian[i, 12 + k] = delay * r[i, k]
        jacobian[i, 16] = -(force + gravity)


@kernel("void(f8[::1], f8, i8, f8[::1], f8[:,::1])")
def heading_row(nominal: Array, yaw_rad: float, row: int, innovation: Array, jacobian: Array) -> None:
    """One row: heading atan2(R10, R00), exact at any tilt short of the vertical; Raja (3.14), fourth entry."""
    r = rotation_from_quaternion(nominal[6:10])
    jacobian[row, :] = 0.0
    innovation[row] = wrap_angle(yaw_rad - math.atan2(r[1, 0], r[0, 0]))
    squared = max(r[0, 0] * r[0, 0] + r[1, 0] * r[1, 0], 1e-6)
    jacobian[row, 7] = (-r[0, 0] * r[1, 2] + r[1, 0] * r[0, 2]) / squared
    jacobian[row, 8] = (r[0, 0] * r[1, 1] - r[1, 0] * r[0, 1]) / squared


@kernel("void(f8[::1], f8[::1], i8, f8[::1], f8[:,::1])")
def attitude_rows(nominal: Array, ned_from_body: Array, row: int, innovation: Array, jacobian: Array) -> None:
    """Three rows: rotation vector [rad] from the nominal to the measured attitude, in body axes."""
    a, b, c, d = nominal[6], -nominal[7], -nominal[8], -nominal[9]
    w, x, y, z = ned_from_body[0], ned_from_body[1], ned_from_body[2], ned_from_body[3]
    error = np.empty(4)
    error[0] = a * w - b * x - c * y - d * z
    error[1] = a * x + b * w + c * z - d * y
    error[2] = a * y - b * z + c * w + d * x
    error[3] = a * z + b * y - c * x + d * w
    sine = math.sqrt(error[1] * error[1] + error[2] * error[2] + error[3] * error[3])
    angle = 2.0 * math.atan2(sine, abs(error[0]))
    scale = 2.0 if sine < 1e-9 else angle / sine
    if error[0] < 0.0:
        scale = -scale
    for i in range(3):
        jacobian[row + i, :] = 0.0
        jacobian[row + i, 6 + i] = 1.0
        innovation[row + i] = scale * error[1 + i]


@kernel("void(f8[::1], f8[::1], f8[::1], f8[:,::1])")
def magnetic_rows(nominal: Array, field_body_t: Array, innovation: Array, jacobian: Array) -> None:
    """Three rows: flux density in the body, R' field + bias [T]."""
    r = rotation_from_quaternion(nominal[6:10])
    m = np.empty(3)
    for i in range(3):
        m[i] = r[0, i] * nominal[18] + r[1, i] * nominal[19] + r[2, i] * nominal[20]
        innovation[i] = field_body_t[i] - m[i] - nominal[21 + i]
    for i in range(3):
        jacobian[i, :] = 0.0
        for k in range(3):
            jacobian[i, 17 + k] = r[k, i]
        jacobian[i, 20 + i] = 1.0
    jacobian[0, 7], jacobian[0, 8] = -m[2], m[1]
    jacobian[1, 6], jacobian[1, 8] = m[2], -m[0]
    jacobian[2, 6], jacobian[2, 7] = -m[1], m[0]


@kernel("void(f8[::1], f8, f8[::1], f8[:,::1])")
def barometer_row(nominal: Array, pressure_height_m: float, innovation: Array, jacobian: Array) -> None:
    """One row: pressure height, offset - down [m]."""
    jacobian[0, :] = 0.0
    innovation[0] = pressure_height_m - (nominal[16] - nominal[2])
    jacobian[0, 2] = -1.0
    jacobian[0, 15] = 1.0


@kernel("void(f8[::1], f8, f8, f8[::1], f8[:,::1])")
def range_row(nominal: Array, distance_m: float, ground_down_m: float, innovation: Array, jacobian: Array) -> None:
    """One row: distance along body z to level ground, (ground - down) / R22 [m]."""
    r = rotation_from_quaternion(nominal[6:10])
    cosine = max(r[2, 2], 0.1)
    predicted = (ground_down_m - nominal[2]) / cosine
    jacobian[0, :] = 0.0
    innovation[0] = distance_m - predicted
    jacobian[0, 2] = -1.0 / cosine
    jacobian[0, 6] = predicted * r[2, 1] / cosine
    jacobian[0, 7] = -predicted * r[2, 0] / cosine


@kernel("void(f8[::1], f8[::1], f8, f8[::1], f8[:,::1])")
def drag_rows(nominal: Array, accel_body_m_s2: Array, drag_1_s: float, innovation: Array, jacobian: Array) -> None:
    """Two rows: specific force along body x and y, bias - drag (R' v), in still air; Raja (3.14), last entries.

    The wind it ignores is carried by a widened variance, (drag x wind)^2.
    """
    r = rotation_from_quaternion(nominal[6:10])
    u = np.empty(3)
    for i in range(3):
        u[i] = r[0, i] * nominal[3] + r[1, i] * nominal[4] + r[2, i] * nominal[5]
    for i in range(2):
        jacobian[i, :] = 0.0
        innovation[i] = accel_body_m_s2[i] - nominal[13 + i] + drag_1_s * u[i]
        for k in range(3):
            jacobian[i, 3 + k] = -drag_1_s * r[k, i]
        jacobian[i, 12 + i] = 1.0
    jacobian[0, 7], jacobian[0, 8] = drag_1_s * u[2], -drag_1_s * u[1]
    jacobian[1, 6], jacobian[1, 8] = -drag_1_s * u[2], drag_1_s * u[0]
