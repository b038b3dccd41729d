"""The arithmetic of the cascade as kernels over packed numbers: one call for a whole step, one for a seed.

A law is packed by :mod:`controllers.law`, inputs and memory by :mod:`controllers.cascade`; the constants below are the
places of the numbers in these arrays. Compiled into one piece, a step costs some microseconds even when a tick finds
the processor's caches cold, where the same lines in numpy cost hundreds. The whole step stays in one file, because
the cache of compiled kernels notices changes by file.
"""

from __future__ import annotations

import math

import numpy as np

from controllers.mixer import TILT_TORQUE_CUT, achievable
from models.frames import STANDARD_GRAVITY_M_S2, Array, quaternion_from_euler, wrap_angle
from models.kernel import kernel

LONGEST_STEP_S = 0.1
LEAST_TILT_COSINE = 0.5

# The law: matrices row by row, then the vehicle's terms.
ATTITUDE_K, ATTITUDE_KR, ATTITUDE_KI = 0, 24, 33
HEIGHT_K, HEIGHT_KR, HEIGHT_KI = 42, 44, 45
HORIZONTAL_K, HORIZONTAL_KR, HORIZONTAL_KI = 46, 54, 58
MASS, WEIGHT, DRAG, MODEL_YAW, ROTOR_LAG = 62, 63, 64, 65, 66
INERTIA, MOMENTS, MIXER, FEED_FORWARD = 67, 70, 88, 92
LAW_SIZE = 93

# The inputs of a step: estimate, reference, limit and the given tilt; :func:`prepare_inputs` fills the last two.
TIME, EULER, BODY_RATES, POSITION, VELOCITY = 0, 1, 4, 7, 10
REFERENCE_POSITION, REFERENCE_VELOCITY, REFERENCE_ACCELERATION, REFERENCE_JERK = 13, 16, 19, 22
REFERENCE_YAW, REFERENCE_YAW_RATE, TILT_LIMIT, OUTER, GIVEN_TILT = 25, 26, 27, 28, 29
YAW, YAW_ERROR = 31, 32
INPUT_SIZE = 33

# The memory after a step: anchor and its motion, integrals z and their rates, the command, and what follows from it.
LAST_TIME, ANCHOR, ANCHOR_VELOCITY, ANCHOR_ACCELERATION = 0, 1, 4, 7
ANCHOR_YAW, ANCHOR_YAW_RATE, LAST_YAW, OUTER_ACTIVE = 10, 11, 12, 13
HORIZONTAL_Z, HEIGHT_Z, ATTITUDE_Z = 14, 16, 17
HORIZONTAL_Z_RATE, HEIGHT_Z_RATE, ATTITUDE_Z_RATE = 20, 22, 23
TILT, THRUST, TORQUE, NED_FROM_BODY, RATES_AHEAD, SATURATED = 26, 28, 29, 32, 36, 39
MEMORY_SIZE = 40


@kernel("UniTuple(f8, 2)(f8, f8, f8)")
def turned(angle_rad: float, north: float, east: float) -> tuple[float, float]:
    """A horizontal vector, seen from a frame turned by ``angle_rad`` about down."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * north + s * east, c * east - s * north


@kernel("UniTuple(f8, 2)(f8, f8, f8)")
def tilt_of(yaw_rad: float, north_m_s2: float, east_m_s2: float) -> tuple[float, float]:
    """Roll and pitch [rad] that give a small horizontal acceleration at a heading."""
    forward, side = turned(yaw_rad, north_m_s2, east_m_s2)
    return side / STANDARD_GRAVITY_M_S2, -forward / STANDARD_GRAVITY_M_S2


@kernel("UniTuple(f8, 2)(f8, f8, f8)")
def acceleration_of(yaw_rad: float, roll_rad: float, pitch_rad: float) -> tuple[float, float]:
    """Inverse of :func:`tilt_of`: north and east acceleration [m/s^2] of a small tilt."""
    return turned(-yaw_rad, -pitch_rad * STANDARD_GRAVITY_M_S2, roll_rad * STANDARD_GRAVITY_M_S2)


@kernel("void(f8[::1], f8[::1], f8)")
def prepare_inputs(law: Array, x: Array, unwrapped_from_rad: float) -> None:
    """Unwrap the heading, and zero the reference's motion where the law does not feed it forward; changes ``x``."""
    x[YAW] = unwrapped_from_rad + wrap_angle(x[EULER + 2] - unwrapped_from_rad)
    x[YAW_ERROR] = wrap_angle(x[REFERENCE_YAW] - x[YAW])
    if law[FEED_FORWARD] == 0.0:
        x[REFERENCE_VELOCITY:REFERENCE_YAW] = 0.0
        x[REFERENCE_YAW_RATE] = 0.0


@kernel("UniTuple(f8, 2)(f8[::1], f8[::1], f8[::1])")
def tilt_direct(law: Array, x: Array, anchor: Array) -> tuple[float, float]:
    """Roll and pitch of the horizontal loop without its integral: u_ff - K (x - x_ref) + K_r (r - s).

    The feed-forward acceleration includes the drag of the motion.
    """
    position, velocity = x[POSITION : POSITION + 2], x[VELOCITY : VELOCITY + 2]
    target = x[REFERENCE_POSITION : REFERENCE_POSITION + 2]
    velocity_ff = x[REFERENCE_VELOCITY : REFERENCE_VELOCITY + 2]
    acceleration_ff = x[REFERENCE_ACCELERATION : REFERENCE_ACCELERATION + 2]
    k, k_r = law[HORIZONTAL_K : HORIZONTAL_K + 8].reshape(2, 4), law[HORIZONTAL_KR : HORIZONTAL_KR + 4].reshape(2, 2)
    angle = x[YAW] - law[MODEL_YAW]
    ahead, side = turned(angle, position[0] - anchor[0], position[1] - anchor[1])
    ahead_speed, side_speed = turned(angle, velocity[0] - velocity_ff[0], velocity[1] - velocity_ff[1])
    ahead_wanted, side_wanted = turned(angle, target[0] - anchor[0], target[1] - anchor[1])
    roll, pitch = tilt_of(
        x[YAW], acceleration_ff[0] + law[DRAG] * velocity_ff[0], acceleration_ff[1] + law[DRAG] * velocity_ff[1]
    )
    roll += k_r[0, 0] * ahead_wanted + k_r[0, 1] * side_wanted
    roll -= k[0, 0] * ahead + k[0, 1] * side + k[0, 2] * ahead_speed + k[0, 3] * side_speed
    pitch += k_r[1, 0] * ahead_wanted + k_r[1, 1] * side_wanted
    pitch -= k[1, 0] * ahead + k[1, 1] * side + k[1, 2] * ahead_speed + k[1, 3] * side_speed
    return roll, pitch


@kernel("f8(f8[::1], f8[::1], f8)")
def force_direct(law: Array, x: Array, anchor_down_m: float) -> float:
    """Vertical force [N], positive up, without the integral: m (g - a_ref - drag) - K (x - x_ref) + K_r (r - s)."""
    velocity_ff = x[REFERENCE_VELOCITY + 2]
    acceleration_ff = x[REFERENCE_ACCELERATION + 2] + law[DRAG] * velocity_ff
    force_n: float = (
        law[WEIGHT]
        - law[MASS] * acceleration_ff
        - law[HEIGHT_K] * (x[POSITION + 2] - anchor_down_m)
        - law[HEIGHT_K + 1] * (x[VELOCITY + 2] - velocity_ff)
        + law[HEIGHT_KR] * (x[REFERENCE_POSITION + 2] - anchor_down_m)
    )
    return force_n


@kernel("UniTuple(f8, 4)(f8[::1], f8[::1], b1)")
def moving_attitude(law: Array, x: Array, outer_active: bool) -> tuple[float, float, float, float]:
    """Roll and pitch that the reference's motion needs, and the rates p and q of that and of its yaw."""
    if law[FEED_FORWARD] == 0.0 or not outer_active:
        return 0.0, 0.0, 0.0, 0.0
    drag, yaw, yaw_rate = law[DRAG], x[YAW], x[REFERENCE_YAW_RATE]
    v, a, j = REFERENCE_VELOCITY, REFERENCE_ACCELERATION, REFERENCE_JERK
    roll, pitch = tilt_of(yaw, x[a] + drag * x[v], x[a + 1] + drag * x[v + 1])
    roll_rate, pitch_rate = tilt_of(yaw, x[j] + drag * x[a], x[j + 1] + drag * x[a + 1])
    return roll, pitch, roll_rate + yaw_rate * pitch, pitch_rate - yaw_rate * roll


@kernel("void(f8[::1], f8[::1], f8, f8[::1], b1, f8[::1])")
def torque_direct(
    law: Array, x: Array, anchor_yaw_rad: float, tilt_rad: Array, outer_active: bool, torque_n_m: Array
) -> None:
    """Torque (3,) of the attitude loop without its integral, (4.11), into ``torque_n_m``.

    Its feed-forward balances the aerodynamic moments of (4.9) at the reference's velocity and body rates.
    """
    roll, pitch, p, q = moving_attitude(law, x, outer_active)
    r, v = x[REFERENCE_YAW_RATE], REFERENCE_VELOCITY
    ahead_ff, side_ff = turned(x[YAW], x[v], x[v + 1])
    motion = (ahead_ff, side_ff, x[v + 2], p, q, r)
    ahead, side = turned(x[YAW] - law[MODEL_YAW], x[VELOCITY] - x[v], x[VELOCITY + 1] - x[v + 1])
    yaw = x[YAW] - anchor_yaw_rad
    rates = x[BODY_RATES : BODY_RATES + 3]
    state = (x[EULER] - roll, x[EULER + 1] - pitch, yaw, rates[0] - p, rates[1] - q, rates[2] - r, ahead, side)
    reference = (tilt_rad[0] - roll, tilt_rad[1] - pitch, yaw + x[YAW_ERROR])
    for i in range(3):
        moment = 0.0
        for n in range(6):
            moment += law[MOMENTS + 6 * i + n] * motion[n]
        torque = -law[INERTIA + i] * moment
        for n in range(3):
            torque += law[ATTITUDE_KR + 3 * i + n] * reference[n]
        for n in range(8):
            torque -= law[ATTITUDE_K + 8 * i + n] * state[n]
        torque_n_m[i] = torque


@kernel("f8(f8[::1], f8[::1])")
def tilt_cosine(law: Array, x: Array) -> float:
    """cos(roll) cos(pitch): thrust is force over it, so that a tilt does not cost height; 1 without feed-forward."""
    if law[FEED_FORWARD] == 0.0:
        return 1.0
    return float(max(LEAST_TILT_COSINE, math.cos(x[EULER]) * math.cos(x[EULER + 1])))


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], b1)")
def integral_rates(law: Array, x: Array, memory: Array, lost: Array, tilt_limited: bool) -> None:
    """Rates of the integrals into ``memory``, which holds the tilt; 0 where one would push on into saturation.

    ``lost`` (4,) is the thrust and torque that the rotors cannot give.
    """
    target, k_i = REFERENCE_POSITION, law[HORIZONTAL_KI : HORIZONTAL_KI + 4]
    north, east = x[target] - x[POSITION], x[target + 1] - x[POSITION + 1]
    ahead, side = turned(x[YAW] - law[MODEL_YAW], north, east)
    roll_push, pitch_push = k_i[0] * ahead + k_i[1] * side, k_i[2] * ahead + k_i[3] * side
    outwards = roll_push * memory[TILT] + pitch_push * memory[TILT + 1] > 0.0
    if x[OUTER] == 0.0 or (tilt_limited and outwards):
        roll_push, pitch_push = 0.0, 0.0
    north_rate, east_rate = acceleration_of(x[YAW], roll_push, pitch_push)
    memory[HORIZONTAL_Z_RATE], memory[HORIZONTAL_Z_RATE + 1] = north_rate, east_rate
    height_rate = law[HEIGHT_KI] * (x[target + 2] - x[POSITION + 2])
    memory[HEIGHT_Z_RATE] = 0.0 if height_rate * lost[0] > 0.0 else height_rate
    errors = (memory[TILT] - x[EULER], memory[TILT + 1] - x[EULER + 1], x[YAW_ERROR])
    for i in range(3):
        rate = 0.0
        for n in range(3):
            rate += law[ATTITUDE_KI + 3 * i + n] * errors[n]
        memory[ATTITUDE_Z_RATE + i] = 0.0 if rate * lost[1 + i] > 0.0 else rate


@kernel("void(f8[::1], f8[::1], f8[::1])")
def fill_motion(x: Array, anchor: Array, memory: Array) -> None:
    """What the next step needs of this one's time, heading and reference, with the anchor (3,), into ``memory``."""
    memory[LAST_TIME], memory[LAST_YAW], memory[OUTER_ACTIVE] = x[TIME], x[YAW], x[OUTER]
    memory[ANCHOR : ANCHOR + 3] = anchor
    memory[ANCHOR_VELOCITY : ANCHOR_VELOCITY + 3] = x[REFERENCE_VELOCITY : REFERENCE_VELOCITY + 3]
    memory[ANCHOR_ACCELERATION : ANCHOR_ACCELERATION + 3] = x[REFERENCE_ACCELERATION : REFERENCE_ACCELERATION + 3]
    memory[ANCHOR_YAW_RATE] = x[REFERENCE_YAW_RATE]


@kernel("void(f8[::1], f8[::1], f8[::1])")
def fill_lower_rungs(law: Array, x: Array, memory: Array) -> None:
    """Attitude and the rates one rotor lag ahead, of the command in ``memory``."""
    attitude = quaternion_from_euler(memory[TILT], memory[TILT + 1], x[REFERENCE_YAW])
    memory[NED_FROM_BODY : NED_FROM_BODY + 4] = attitude
    for i in range(3):
        memory[RATES_AHEAD + i] = x[BODY_RATES + i] + law[ROTOR_LAG] * memory[TORQUE + i] / law[INERTIA + i]


@kernel("f8[::1](f8[::1], f8[::1], f8[::1])")
def seeded(law: Array, x: Array, command: Array) -> Array:
    """Memory (MEMORY_SIZE,) from which a step at the same inputs asks for ``command``: tilt, thrust, torque (6,)."""
    memory = np.zeros(MEMORY_SIZE)
    prepare_inputs(law, x, x[EULER + 2])
    target = x[REFERENCE_POSITION : REFERENCE_POSITION + 3]
    fill_motion(x, target, memory)
    memory[ANCHOR_YAW] = x[YAW] + x[YAW_ERROR]
    memory[TILT : TILT + 6] = command
    roll, pitch = tilt_direct(law, x, target)
    north, east = acceleration_of(x[YAW], command[0] - roll, command[1] - pitch)
    memory[HORIZONTAL_Z], memory[HORIZONTAL_Z + 1] = north, east
    memory[HEIGHT_Z] = command[2] * tilt_cosine(law, x) - force_direct(law, x, target[2])
    torque = memory[ATTITUDE_Z : ATTITUDE_Z + 3]
    torque_direct(law, x, memory[ANCHOR_YAW], command[0:2], x[OUTER] != 0.0, torque)
    for i in range(3):
        torque[i] = command[3 + i] - torque[i]
    return memory


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1])")
def fill_tilt(law: Array, x: Array, last: Array, memory: Array) -> bool:
    """Tilt command into ``memory``, where the horizontal integral is taken up again if it rested; True if limited."""
    roll, pitch = x[GIVEN_TILT], x[GIVEN_TILT + 1]
    if x[OUTER] != 0.0:
        roll, pitch = tilt_direct(law, x, memory[ANCHOR : ANCHOR + 3])
        if last[OUTER_ACTIVE] == 0.0:
            north, east = acceleration_of(x[YAW], last[TILT] - roll, last[TILT + 1] - pitch)
            memory[HORIZONTAL_Z], memory[HORIZONTAL_Z + 1] = north, east
        roll_z, pitch_z = tilt_of(x[YAW], memory[HORIZONTAL_Z], memory[HORIZONTAL_Z + 1])
        roll, pitch = roll + roll_z, pitch + pitch_z
    scale = min(1.0, x[TILT_LIMIT] / max(math.hypot(roll, pitch), 1e-9))
    memory[TILT], memory[TILT + 1] = roll * scale, pitch * scale
    return bool(scale < 1.0)


@kernel("f8[::1](f8[::1], f8[::1], f8[::1])")
def stepped(law: Array, last: Array, x: Array) -> Array:
    """Memory (MEMORY_SIZE,) after one step of the cascade from ``last`` at the inputs ``x``, which it changes."""
    memory = np.zeros(MEMORY_SIZE)
    prepare_inputs(law, x, last[LAST_YAW])
    elapsed_s = min(max(x[TIME] - last[LAST_TIME], 0.0), LONGEST_STEP_S)
    anchor = np.empty(3)
    for i in range(3):
        # The anchor moves with the reference velocity and acceleration of the last step.
        speed = last[ANCHOR_VELOCITY + i] + 0.5 * elapsed_s * last[ANCHOR_ACCELERATION + i]
        anchor[i] = last[ANCHOR + i] + elapsed_s * speed
    fill_motion(x, anchor, memory)
    memory[ANCHOR_YAW] = last[ANCHOR_YAW] + elapsed_s * last[ANCHOR_YAW_RATE]
    for i in range(HORIZONTAL_Z_RATE - HORIZONTAL_Z):
        memory[HORIZONTAL_Z + i] = last[HORIZONTAL_Z + i] + elapsed_s * last[HORIZONTAL_Z_RATE + i]

    angle_limited = fill_tilt(law, x, last, memory)
    wanted, torque = memory[THRUST : THRUST + 4], memory[TORQUE : TORQUE + 3]
    wanted[0] = (force_direct(law, x, anchor[2]) + memory[HEIGHT_Z]) / tilt_cosine(law, x)
    torque_direct(law, x, memory[ANCHOR_YAW], memory[TILT : TILT + 2], x[OUTER] != 0.0, torque)
    for i in range(3):
        torque[i] += memory[ATTITUDE_Z + i]
    given = np.empty(4)
    cut = achievable(wanted, law[MIXER : MIXER + 4], given)
    integral_rates(law, x, memory, wanted - given, angle_limited or (cut & TILT_TORQUE_CUT) != 0)
    fill_lower_rungs(law, x, memory)
    memory[SATURATED] = 1.0 if angle_limited or cut != 0 else 0.0
    return memory
