"""Process model of the full-state filter: layout of its states, propagation of state and covariance, injection.

Raja (3.8) and (3.11)-(3.12) with the IMU as input, as a multiplicative error-state filter: the nominal quaternion stays
on the unit sphere and its error is a rotation vector in body axes, q_true = q (x) exp(error). The additive 16-state
form that only normalises q lets its covariance leave that sphere's tangent space, and diverges after minutes.

    error                  nominal
     0:3   position [m]     0:3   position, ned
     3:6   velocity [m/s]   3:6   velocity, ned
     6:9   attitude [rad]   6:10  quaternion ned_from_body
     9:12  gyro bias        10:13 [rad/s]
    12:15  accel bias       13:16 [m/s^2]
    15     barometer offset 16    [m]: pressure height minus height above the origin
    16     GNSS delay       17    [s]: latency of the fixes beyond the configured one
    17:20  earth field      18:21 [T], ned
    20:23  magnetic bias    21:24 [T], body (hard iron)

The last eight have zero covariance until a sensor that needs them speaks, and cost nothing in accuracy till then.
"""

from __future__ import annotations

import math

import numpy as np

from models.frames import (
    STANDARD_GRAVITY_M_S2,
    Array,
    euler_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_from_quaternion,
)
from models.kernel import kernel

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
QUATERNION = slice(6, 10)
GYRO_BIAS = slice(10, 13)
ACCEL_BIAS = slice(13, 16)
BAROMETER_OFFSET = 16
GNSS_DELAY = 17
EARTH_FIELD = slice(18, 21)
MAGNETIC_BIAS = slice(21, 24)
NOMINAL_SIZE = 24

ERROR_POSITION, ERROR_VELOCITY, ERROR_ATTITUDE, ERROR_GYRO_BIAS, ERROR_ACCEL_BIAS = 0, 3, 6, 9, 12
ERROR_BAROMETER_OFFSET, ERROR_GNSS_DELAY, ERROR_EARTH_FIELD, ERROR_MAGNETIC_BIAS = 15, 16, 17, 20
ERROR_SIZE = 23
CORE_SIZE = 15
"""The error states of ``models.estimate.Estimate``: position, velocity, attitude, gyro bias, accelerometer bias."""


@kernel("void(f8[::1], f8[::1], f8)")
def propagate_nominal(nominal: Array, imu: Array, dt_s: float) -> None:
    """Advance the nominal state in place by ``dt_s`` under a constant IMU reading (6,): gyro, accelerometer.

    Midpoint rule: the specific force is turned to ned by the attitude half-way; Raja (3.12). ``dt_s`` may be negative.
    """
    half = np.empty(3)
    for k in range(3):
        half[k] = 0.5 * dt_s * (imu[k] - nominal[10 + k])
    q = nominal[6:10].copy()
    turn = quaternion_from_rotation_vector(half)
    middle = quaternion_multiply(q, turn)
    r = rotation_from_quaternion(middle)
    for k in range(3):
        acceleration = 0.0
        for j in range(3):
            acceleration += r[k, j] * (imu[3 + j] - nominal[13 + j])
        if k == 2:
            acceleration += STANDARD_GRAVITY_M_S2
        nominal[k] += dt_s * nominal[3 + k] + 0.5 * dt_s * dt_s * acceleration
        nominal[3 + k] += dt_s * acceleration
    q = quaternion_multiply(middle, turn)
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        nominal[6 + k] = q[k] / norm


@kernel("void(f8[::1], f8[::1], f8, f8[:,::1])")
def transition_rows(nominal: Array, imu: Array, dt_s: float, transition: Array) -> None:
    """Rows 0:9, columns 0:15 of Phi = I + A dt + (A dt)^2 / 2 into ``transition`` (9, 15); the other rows are identity.

    A: position' = velocity, velocity' = -R [a]x attitude - R accel_bias, attitude' = -[w]x attitude - gyro_bias, with R
    half-way through the step: what A changes by over the step is of second order too.
    """
    w = np.empty(3)
    a = np.empty(3)
    half = np.empty(3)
    for k in range(3):
        w[k] = imu[k] - nominal[10 + k]
        a[k] = imu[3 + k] - nominal[13 + k]
        half[k] = 0.5 * dt_s * w[k]
    r = rotation_from_quaternion(quaternion_multiply(nominal[6:10], quaternion_from_rotation_vector(half)))
    skew = np.zeros((3, 3))
    skew[0, 1], skew[0, 2] = -w[2], w[1]
    skew[1, 0], skew[1, 2] = w[2], -w[0]
    skew[2, 0], skew[2, 1] = -w[1], w[0]
    force = np.empty((3, 3))  # -R [a]x
    for i in range(3):
        force[i, 0] = -r[i, 1] * a[2] + r[i, 2] * a[1]
        force[i, 1] = r[i, 0] * a[2] - r[i, 2] * a[0]
        force[i, 2] = -r[i, 0] * a[1] + r[i, 1] * a[0]
    half_dt2 = 0.5 * dt_s * dt_s
    transition[:, :] = 0.0
    for i in range(3):
        transition[i, i] = 1.0
        transition[i, 3 + i] = dt_s
        transition[3 + i, 3 + i] = 1.0
        transition[6 + i, 6 + i] = 1.0
        transition[6 + i, 9 + i] = -dt_s
        for j in range(3):
            force_skew = 0.0
            skew_skew = 0.0
            for k in range(3):
                force_skew += force[i, k] * skew[k, j]
                skew_skew += skew[i, k] * skew[k, j]
            transition[i, 6 + j] = half_dt2 * force[i, j]
            transition[i, 12 + j] = -half_dt2 * r[i, j]
            transition[3 + i, 6 + j] = dt_s * force[i, j] - half_dt2 * force_skew
            transition[3 + i, 9 + j] = -half_dt2 * force[i, j]
            transition[3 + i, 12 + j] = -dt_s * r[i, j]
            transition[6 + i, 6 + j] += -dt_s * skew[i, j] + half_dt2 * skew_skew
            transition[6 + i, 9 + j] += half_dt2 * skew[i, j]


@kernel("void(f8[::1], f8[:,::1], f8[::1], f8, f8[::1])")
def propagate_covariance(nominal: Array, covariance: Array, imu: Array, dt_s: float, density: Array) -> None:
    """P = Phi P Phi' + Q dt in place, with Phi at the nominal state before its own propagation; never literal (3.2).

    ``density`` (23,) is the diagonal of Q, power per error state. Only nine rows of Phi differ from the identity.
    """
    phi = np.empty((9, 15))
    transition_rows(nominal, imu, dt_s, phi)
    half_way = np.zeros((9, 23))
    for i in range(9):
        for k in range(15):
            f = phi[i, k]
            if f != 0.0:
                for j in range(23):
                    half_way[i, j] += f * covariance[k, j]
    for i in range(9):
        for j in range(i, 9):
            total = 0.0
            for k in range(15):
                total += half_way[i, k] * phi[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
        for j in range(9, 23):
            covariance[i, j] = half_way[i, j]
            covariance[j, i] = half_way[i, j]
    for i in range(23):
        covariance[i, i] += density[i] * dt_s


@kernel("void(f8[::1], f8[:,::1], f8[:,::1], i8, f8, f8, f8[::1])")
def predict(
    nominal: Array, covariance: Array, imu_ring: Array, before: int, share_before: float, dt_s: float, density: Array
) -> None:
    """Advance state and covariance in place by ``dt_s`` between sample ``before`` of the ring (m, 7) and the next.

    ``share_before`` weighs the earlier sample: 0 if a sample is the mean over the interval up to its stamp, .5 if it is
    a reading of that moment (trapezoid).
    """
    i, j = before % imu_ring.shape[0], (before + 1) % imu_ring.shape[0]
    imu = np.empty(6)
    for k in range(6):
        imu[k] = share_before * imu_ring[i, 1 + k] + (1.0 - share_before) * imu_ring[j, 1 + k]
    propagate_covariance(nominal, covariance, imu, dt_s, density)
    propagate_nominal(nominal, imu, dt_s)


@kernel("void(f8[::1], f8[:,::1], f8[::1])")
def inject(nominal: Array, covariance: Array, correction: Array) -> None:
    """Move an error-state correction (23,) into the nominal state, and turn the attitude covariance with it.

    The attitude error is then counted from the corrected attitude: G = I - [correction]x / 2 (Sola 2017, eq. 287).
    """
    for k in range(6):
        nominal[k] += correction[k]
    for k in range(14):
        nominal[10 + k] += correction[9 + k]
    turn = quaternion_from_rotation_vector(correction[6:9])
    q = quaternion_multiply(nominal[6:10], turn)
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        nominal[6 + k] = q[k] / norm
    x, y, z = 0.5 * correction[6], 0.5 * correction[7], 0.5 * correction[8]
    n = covariance.shape[0]
    for j in range(n):
        a, b, c = covariance[6, j], covariance[7, j], covariance[8, j]
        covariance[6, j] = a + z * b - y * c
        covariance[7, j] = b - z * a + x * c
        covariance[8, j] = c + y * a - x * b
    for j in range(n):
        a, b, c = covariance[j, 6], covariance[j, 7], covariance[j, 8]
        covariance[j, 6] = a + z * b - y * c
        covariance[j, 7] = b - z * a + x * c
        covariance[j, 8] = c + y * a - x * b


@kernel("void(f8[::1], f8[:,::1], i8, i8, f8, f8, f8[::1])")
def predict_output(
    nominal: Array, imu_ring: Array, first: int, count: int, share_before: float, time_s: float, output: Array
) -> None:
    """Carry the nominal state from the fusion horizon to the newest IMU sample, into ``output`` (24,).

    ``imu_ring`` (m, 7) holds time, gyro, accelerometer; sample ``first`` is the last one at or before ``time_s`` and
    ``count`` newer ones follow it; ``share_before`` as in :func:`predict`.
    """
    size = imu_ring.shape[0]
    imu = np.empty(6)
    output[:] = nominal
    before = first % size
    now_s = time_s
    for step in range(1, count + 1):
        after = (first + step) % size
        for k in range(6):
            imu[k] = share_before * imu_ring[before, 1 + k] + (1.0 - share_before) * imu_ring[after, 1 + k]
        propagate_nominal(output, imu, imu_ring[after, 0] - now_s)
        now_s = imu_ring[after, 0]
        before = after


@kernel("f8(f8[::1], f8[:,::1], f8[:,::1], i8, i8, f8, f8, f8[::1], f8[::1], f8[::1], f8[:,::1])")
def carry_to_now(
    nominal: Array,
    covariance: Array,
    imu_ring: Array,
    first: int,
    count: int,
    share_before: float,
    time_s: float,
    density: Array,
    output: Array,
    euler_rad: Array,
    core: Array,
) -> float:
    """What the filter says of the newest IMU sample: state as :func:`predict_output`, Euler angles (3,), and the
    covariance of the 15 core states (15, 15), carried over the horizon in one step. Returns the larger variance of the
    attitude error about body x and y at the horizon [rad^2].
    """
    predict_output(nominal, imu_ring, first, count, share_before, time_s, output)
    euler_rad[:] = euler_from_quaternion(output[6:10])
    newest = (first + count) % imu_ring.shape[0]
    ahead_s = imu_ring[newest, 0] - time_s
    if ahead_s > 0.0:
        ahead = covariance.copy()
        propagate_covariance(nominal, ahead, imu_ring[newest, 1:7].copy(), ahead_s, density)
        core[:, :] = ahead[:15, :15]
    else:
        core[:, :] = covariance[:15, :15]
    tilt_variance: float = max(covariance[6, 6], covariance[7, 7])
    return tilt_variance
