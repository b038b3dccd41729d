"""Rigid-body kinematics and Newton-Euler dynamics with a quaternion attitude, shared by every vehicle.

State, shape (13,): position ned [m], velocity ned [m/s], quaternion ``ned_from_body`` (w, x, y, z), body rates [rad/s].
Forces, torques, rotors and air are the vehicle's own business and come in as arguments.
"""

from __future__ import annotations

from models.frames import STANDARD_GRAVITY_M_S2, Array
from models.kernel import kernel

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ATTITUDE = slice(6, 10)
RATES = slice(10, 13)
STATE_SIZE = 13


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[:,::1], f8[:,::1], f8[::1])")
def rigid_body_derivative(
    state: Array,
    force_body_n: Array,
    torque_body_n_m: Array,
    mass_kg: float,
    inertia_kg_m2: Array,
    inertia_inverse: Array,
    derivative: Array,
) -> None:
    """Write d(state)/dt, shape (13,), into ``derivative``; Raja (2.8)-(2.10) with velocity in NED and a quaternion.

        p' = v,   v' = R f / m + g,   q' = q * (0, omega) / 2,   omega' = I^-1 (tau - omega x I omega)

    ``force_body_n`` holds all forces but gravity. ``inertia_kg_m2`` (3, 3) may have products of inertia.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    fx, fy, fz = force_body_n[0] / mass_kg, force_body_n[1] / mass_kg, force_body_n[2] / mass_kg
    derivative[0] = state[3]
    derivative[1] = state[4]
    derivative[2] = state[5]
    derivative[3] = (w * w + x * x - y * y - z * z) * fx + 2.0 * (x * y - w * z) * fy + 2.0 * (x * z + w * y) * fz
    derivative[4] = 2.0 * (x * y + w * z) * fx + (w * w - x * x + y * y - z * z) * fy + 2.0 * (y * z - w * x) * fz
    derivative[5] = 2.0 * (x * z - w * y) * fx + 2.0 * (y * z + w * x) * fy + (w * w - x * x - y * y + z * z) * fz
    derivative[5] += STANDARD_GRAVITY_M_S2
    derivative[6] = -0.5 * (x * p + y * q + z * r)
    derivative[7] = 0.5 * (w * p + y * r - z * q)
    derivative[8] = 0.5 * (w * q + z * p - x * r)
    derivative[9] = 0.5 * (w * r + x * q - y * p)
    hx = inertia_kg_m2[0, 0] * p + inertia_kg_m2[0, 1] * q + inertia_kg_m2[0, 2] * r
    hy = inertia_kg_m2[1, 0] * p + inertia_kg_m2[1, 1] * q + inertia_kg_m2[1, 2] * r
    hz = inertia_kg_m2[2, 0] * p + inertia_kg_m2[2, 1] * q + inertia_kg_m2[2, 2] * r
    tx = torque_body_n_m[0] - (q * hz - r * hy)
    ty = torque_body_n_m[1] - (r * hx - p * hz)
    tz = torque_body_n_m[2] - (p * hy - q * hx)
    for i in range(3):
        derivative[10 + i] = inertia_inverse[i, 0] * tx + inertia_inverse[i, 1] * ty + inertia_inverse[i, 2] * tz
