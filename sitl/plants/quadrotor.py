"""Truth plant of the quadrotor: rigid body, rotor lag and saturation, drag, aerodynamic moments, ground contact.

Raja (2.8)-(2.16) with the drag and the aerodynamic moments of (4.9), which (2.10) lacks, on AIR-relative velocity.
State, shape (17,): the 13 of :mod:`models.rigid_body` and the four rotor speeds [rad/s].
Rotor 1 front-left, 2 front-right, 3 rear-right, 4 rear-left.

The ground is the plane z = 0 through the landing gear. A vehicle whose weight is not lifted stands on it: it stops
sideways by friction, the gear levels it, and nothing creeps. Tipping over and damage are not modelled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.frames import STANDARD_GRAVITY_M_S2, Array
from models.kernel import kernel
from models.parameters import QuadrotorParameters
from models.rigid_body import rigid_body_derivative

STATE_SIZE = 17
ROTOR_SPEED = slice(13, 17)
WORK_SIZE = 7 * STATE_SIZE

# Entries of the constants vector a kernel takes.
MASS, DRAG, ARM, FORCE, TORQUE, LAG, FORCE_MIN, FORCE_MAX = range(8)

GROUND_FRICTION = 0.6
GEAR_LEVELLING_S = 0.1
GEAR_MAX_RATE_RAD_S = 3.0


class QuadrotorConstants(NamedTuple):
    """Parameters as plain arrays for the kernels; the entries of ``scalars`` are named above."""

    scalars: Array
    inertia_kg_m2: Array
    inertia_inverse: Array
    aerodynamic_moments: Array


def constants_of(parameters: QuadrotorParameters) -> QuadrotorConstants:
    """Arrays the kernels take, from the parameter file."""
    scalars = np.array(
        [
            parameters.mass_kg,
            parameters.linear_drag_1_s,
            parameters.arm_m / math.sqrt(2.0),
            parameters.rotor_force_coefficient_n_s2,
            parameters.rotor_torque_coefficient_n_m_s2,
            parameters.rotor_lag_s,
            parameters.rotor_force_coefficient_n_s2 * parameters.rotor_min_speed_rad_s**2,
            parameters.rotor_max_force_n,
        ]
    )
    inertia = np.diag(parameters.inertia_kg_m2)
    moments = np.ascontiguousarray(parameters.aerodynamic_moments)
    return QuadrotorConstants(scalars, inertia, np.linalg.inv(inertia), moments)


def initial_state(yaw_rad: float = 0.0) -> Array:
    """Standing on the ground at the local origin, rotors still, shape (17,)."""
    state = np.zeros(STATE_SIZE)
    state[6], state[9] = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return state


@kernel("f8(f8, f8[::1], f8[::1], f8[::1])")
def mix(thrust_n: float, torque_body_n_m: Array, scalars: Array, rotor_force_n: Array) -> float:
    """Rotor forces for thrust and torque within each rotor's limits; the inverse of Raja (2.16).

    What does not fit is shed in this order: yaw torque, then thrust (moved up or down to keep roll and pitch), then
    roll and pitch together. Writes four forces [N]; returns 1.0 if anything was shed, else 0.0.
    """
    low, high = scalars[FORCE_MIN], scalars[FORCE_MAX]
    roll = 0.25 * torque_body_n_m[0] / scalars[ARM]
    pitch = 0.25 * torque_body_n_m[1] / scalars[ARM]
    yaw = 0.25 * torque_body_n_m[2] * scalars[FORCE] / scalars[TORQUE]
    shed = 0.0
    largest = abs(roll) + abs(pitch)
    if 2.0 * largest > high - low:
        roll *= 0.5 * (high - low) / largest
        pitch *= 0.5 * (high - low) / largest
        largest = 0.5 * (high - low)
        shed = 1.0
    base = 0.25 * thrust_n
    if base < low + largest or base > high - largest:
        base = max(low + largest, min(high - largest, base))
        shed = 1.0
    rotor_force_n[0] = base + roll + pitch
    rotor_force_n[1] = base - roll + pitch
    rotor_force_n[2] = base - roll - pitch
    rotor_force_n[3] = base + roll - pitch
    room = abs(yaw)
    for i in range(4):
        upward = (yaw > 0.0) == (i % 2 == 0)
        room = min(room, high - rotor_force_n[i] if upward else rotor_force_n[i] - low)
    room = max(room, 0.0)
    if room < abs(yaw):
        shed = 1.0
    yaw = math.copysign(room, yaw)
    for i in range(4):
        rotor_force_n[i] += yaw if i % 2 == 0 else -yaw
    return shed


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def derivative(
    state: Array,
    rotor_command_rad_s: Array,
    wind_ned_m_s: Array,
    disturbance: Array,
    scalars: Array,
    inertia: Array,
    inertia_inverse: Array,
    moments: Array,
    force_torque: Array,
    out: Array,
) -> None:
    """d(state)/dt, shape (17,), in free air. ``disturbance``: force ned [N] (3), torque body [N m] (3).

    ``force_torque`` (6,) is left holding body force without gravity and body torque.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    ax, ay, az = state[3] - wind_ned_m_s[0], state[4] - wind_ned_m_s[1], state[5] - wind_ned_m_s[2]
    mass, drag = scalars[MASS], scalars[MASS] * scalars[DRAG]
    r00, r01, r02 = w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    r10, r11, r12 = 2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)
    r20, r21, r22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
    u = r00 * ax + r10 * ay + r20 * az
    v = r01 * ax + r11 * ay + r21 * az
    wb = r02 * ax + r12 * ay + r22 * az
    thrust, roll, pitch, yaw = 0.0, 0.0, 0.0, 0.0
    for i in range(4):
        square = state[13 + i] * state[13 + i]
        force = scalars[FORCE] * square
        thrust += force
        roll += force if i == 0 or i == 3 else -force
        pitch += force if i < 2 else -force
        yaw += scalars[TORQUE] * square if i % 2 == 0 else -scalars[TORQUE] * square
        out[13 + i] = (rotor_command_rad_s[i] - state[13 + i]) / scalars[LAG]
    dx, dy, dz = disturbance[0], disturbance[1], disturbance[2]
    force_torque[0] = -drag * u + r00 * dx + r10 * dy + r20 * dz
    force_torque[1] = -drag * v + r01 * dx + r11 * dy + r21 * dz
    force_torque[2] = -drag * wb + r02 * dx + r12 * dy + r22 * dz - thrust
    force_torque[3] = scalars[ARM] * roll + disturbance[3]
    force_torque[4] = scalars[ARM] * pitch + disturbance[4]
    force_torque[5] = yaw + disturbance[5]
    p, q, r = state[10], state[11], state[12]
    for row in range(3):
        # (4.9) gives angular accelerations; the inertia is diagonal here, so the moment is I times that.
        m = moments[row]
        force_torque[3 + row] += inertia[row, row] * (m[0] * u + m[1] * v + m[2] * wb + m[3] * p + m[4] * q + m[5] * r)
    rigid_body_derivative(state[:13], force_torque[:3], force_torque[3:], mass, inertia, inertia_inverse, out[:13])


@kernel("void(f8[::1], f8, f8[::1], f8[::1])")
def stand(state: Array, dt_s: float, rotor_command_rad_s: Array, scalars: Array) -> None:
    """One step on the ground with the weight not lifted: friction stops the slide, the gear levels the vehicle.

    Rates in the state are those really turned through, so that a gyro integrated over landing agrees with the attitude.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    limit = GEAR_MAX_RATE_RAD_S
    roll_rate = max(-limit, min(limit, -roll / GEAR_LEVELLING_S))
    pitch_rate = max(-limit, min(limit, -pitch / GEAR_LEVELLING_S))
    state[10] = roll_rate
    state[11] = pitch_rate * math.cos(roll)
    state[12] = -pitch_rate * math.sin(roll)
    p, q, r = 0.5 * dt_s * state[10], 0.5 * dt_s * state[11], 0.5 * dt_s * state[12]
    state[6] = w - x * p - y * q - z * r
    state[7] = x + w * p + y * r - z * q
    state[8] = y + w * q + z * p - x * r
    state[9] = z + w * r + x * q - y * p
    speed = math.hypot(state[3], state[4])
    loss = GROUND_FRICTION * STANDARD_GRAVITY_M_S2 * dt_s
    kept = max(0.0, 1.0 - loss / speed) if speed > 0.0 else 0.0
    state[3] *= kept
    state[4] *= kept
    state[5] = 0.0
    state[0] += dt_s * state[3]
    state[1] += dt_s * state[4]
    state[2] = 0.0
    decay = math.exp(-dt_s / scalars[LAG])
    for i in range(13, 17):
        state[i] = rotor_command_rad_s[i - 13] + (state[i] - rotor_command_rad_s[i - 13]) * decay


@kernel("f8(f8[::1], f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def step(
    state: Array,
    dt_s: float,
    rotor_command_rad_s: Array,
    wind_ned_m_s: Array,
    disturbance: Array,
    scalars: Array,
    inertia: Array,
    inertia_inverse: Array,
    moments: Array,
    work: Array,
) -> float:
    """Advance the state by ``dt_s`` in place: RK4 in the air, :func:`stand` on the ground. Returns 1.0 on the ground.

    ``work``, shape (WORK_SIZE,), is scratch memory. Touching down takes the vertical speed away within this step.
    """
    n = STATE_SIZE
    k1, k2, k3, k4 = work[:n], work[n : 2 * n], work[2 * n : 3 * n], work[3 * n : 4 * n]
    trial, force_torque = work[4 * n : 5 * n], work[5 * n : 5 * n + 6]
    d, s, jj, ji, m = disturbance, scalars, inertia, inertia_inverse, moments
    derivative(state, rotor_command_rad_s, wind_ned_m_s, d, s, jj, ji, m, force_torque, k1)
    grounded = state[2] >= 0.0 and state[5] >= 0.0 and k1[5] >= 0.0
    if grounded:
        stand(state, dt_s, rotor_command_rad_s, scalars)
    else:
        for i in range(n):
            trial[i] = state[i] + 0.5 * dt_s * k1[i]
        derivative(trial, rotor_command_rad_s, wind_ned_m_s, d, s, jj, ji, m, force_torque, k2)
        for i in range(n):
            trial[i] = state[i] + 0.5 * dt_s * k2[i]
        derivative(trial, rotor_command_rad_s, wind_ned_m_s, d, s, jj, ji, m, force_torque, k3)
        for i in range(n):
            trial[i] = state[i] + dt_s * k3[i]
        derivative(trial, rotor_command_rad_s, wind_ned_m_s, d, s, jj, ji, m, force_torque, k4)
        for i in range(n):
            state[i] += dt_s / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
        if state[2] > 0.0:
            state[2] = 0.0
            state[5] = min(state[5], 0.0)
    norm = math.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    for i in range(6, 10):
        state[i] /= norm
    return 1.0 if grounded else 0.0
