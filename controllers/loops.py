"""Kernels of the three loops: what each asks for without its integral, and the turns between heading and NED."""

from __future__ import annotations

import math

import numpy as np

from models.frames import STANDARD_GRAVITY_M_S2, Array
from models.kernel import kernel


@kernel("f8[::1](f8, f8[::1])")
def turned(angle_rad: float, vector: Array) -> Array:
    """North and east of a vector, seen from a frame turned by ``angle_rad`` about down; shape (2,)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    result = np.empty(2)
    result[0] = c * vector[0] + s * vector[1]
    result[1] = c * vector[1] - s * vector[0]
    return result


@kernel("f8[::1](f8, f8[::1])")
def tilt_of(yaw_rad: float, acceleration_ned_m_s2: Array) -> Array:
    """Roll and pitch [rad] that give a small horizontal acceleration at a heading; shape (2,)."""
    forward_side = turned(yaw_rad, acceleration_ned_m_s2)
    result = np.empty(2)
    result[0] = forward_side[1] / STANDARD_GRAVITY_M_S2
    result[1] = -forward_side[0] / STANDARD_GRAVITY_M_S2
    return result


@kernel("f8[::1](f8, f8[::1])")
def acceleration_of(yaw_rad: float, tilt_rad: Array) -> Array:
    """Inverse of :func:`tilt_of`: north and east acceleration [m/s^2] of a small tilt; shape (2,)."""
    forward_side = np.empty(2)
    forward_side[0] = -tilt_rad[1] * STANDARD_GRAVITY_M_S2
    forward_side[1] = tilt_rad[0] * STANDARD_GRAVITY_M_S2
    return turned(-yaw_rad, forward_side)


@kernel("f8[::1](f8, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def horizontal_direct(
    yaw_rad: float,
    model_yaw_rad: float,
    offset_ned_m: Array,
    velocity_error_ned_m_s: Array,
    reference_offset_ned_m: Array,
    acceleration_ff_ned_m_s2: Array,
    k: Array,
    k_r: Array,
) -> Array:
    """Tilt command (2,) of the horizontal loop without its integral: u_ff - K (x - x_ref) + K_r (r - s)."""
    angle = yaw_rad - model_yaw_rad
    offset, velocity = turned(angle, offset_ned_m), turned(angle, velocity_error_ned_m_s)
    reference = turned(angle, reference_offset_ned_m)
    result = tilt_of(yaw_rad, acceleration_ff_ned_m_s2)
    for i in range(2):
        result[i] += k_r[i, 0] * reference[0] + k_r[i, 1] * reference[1]
        result[i] -= k[i, 0] * offset[0] + k[i, 1] * offset[1] + k[i, 2] * velocity[0] + k[i, 3] * velocity[1]
    return result


@kernel("f8[::1](f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def attitude_direct(state: Array, reference: Array, torque_ff_n_m: Array, k: Array, k_r: Array) -> Array:
    """Torque (3,) of the attitude loop without its integral; ``state`` (8,) relative to the anchor, (4.11)."""
    result = torque_ff_n_m.copy()
    for i in range(3):
        for j in range(3):
            result[i] += k_r[i, j] * reference[j]
        for j in range(8):
            result[i] -= k[i, j] * state[j]
    return result


@kernel("f8[::1](f8, f8[::1], f8[::1], f8[::1], f8[:,::1])")
def feed_forward_torque(
    yaw_rad: float, velocity_ned_m_s: Array, rates_rad_s: Array, inertia: Array, moments: Array
) -> Array:
    """Torque (3,) that balances the aerodynamic moments of (4.9) at the reference's velocity and body rates."""
    forward_side = turned(yaw_rad, velocity_ned_m_s)
    result = np.empty(3)
    for i in range(3):
        moment = moments[i, 0] * forward_side[0] + moments[i, 1] * forward_side[1] + moments[i, 2] * velocity_ned_m_s[2]
        for j in range(3):
            moment += moments[i, 3 + j] * rates_rad_s[j]
        result[i] = -inertia[i] * moment
    return result
