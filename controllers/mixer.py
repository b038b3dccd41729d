"""What four rotors can give of a wanted thrust and torque: the model-side limits behind the anti-windup."""

from __future__ import annotations

import math

import numpy as np

from models.frames import Array
from models.kernel import kernel
from models.parameters import QuadrotorParameters

THRUST_CUT = 1
TILT_TORQUE_CUT = 2
YAW_TORQUE_CUT = 4


def mixer_limits(parameters: QuadrotorParameters) -> Array:
    """Numbers (4,) for :func:`achievable`: lever [m], torque per force [m], least and greatest rotor force [N]."""
    return np.array(
        [
            parameters.arm_m / math.sqrt(2.0),
            parameters.rotor_torque_coefficient_n_m_s2 / parameters.rotor_force_coefficient_n_s2,
            parameters.rotor_force_coefficient_n_s2 * parameters.rotor_min_speed_rad_s**2,
            parameters.rotor_max_force_n,
        ]
    )


@kernel("i8(f8[::1], f8[::1], f8[::1])")
def achievable(wanted: Array, limits: Array, given: Array) -> int:
    """Thrust and torques the X mixer (2.16) can give; returns which were cut as a sum of the ``*_CUT`` flags.

    ``wanted`` (4,): thrust [N], torques x, y, z [N m]; ``given`` (4,) is filled; ``limits`` from :func:`mixer_limits`.
    Roll and pitch come first (scaled together if even they exceed the rotors' span), then thrust is moved just far
    enough to fit them, and yaw gets what is left.
    """
    lever, yaw_lever, least, most = limits[0], limits[1], limits[2], limits[3]
    # Rotors 1 and 3 (front left, rear right) speed up for positive yaw, 2 and 4 slow down.
    roll_part, pitch_part = wanted[1] / (4.0 * lever), wanted[2] / (4.0 * lever)
    yaw_part, mean = wanted[3] / (4.0 * yaw_lever), wanted[0] / 4.0
    # What is not cut is handed back bit for bit: a rounding error must not look like saturation.
    given[:] = wanted
    highest = mean + max(abs(roll_part + pitch_part) + yaw_part, abs(roll_part - pitch_part) - yaw_part)
    lowest = mean - max(abs(roll_part + pitch_part) - yaw_part, abs(roll_part - pitch_part) + yaw_part)
    if highest <= most and lowest >= least:
        return 0
    cut = 0
    span = abs(roll_part) + abs(pitch_part)
    if 2.0 * span > most - least:
        scale = (most - least) / (2.0 * span)
        roll_part, pitch_part, span = roll_part * scale, pitch_part * scale, span * scale
        cut |= TILT_TORQUE_CUT
    if mean < least + span or mean > most - span:
        mean = min(max(mean, least + span), most - span)
        cut |= THRUST_CUT
    f1, f2 = mean + roll_part + pitch_part, mean - roll_part + pitch_part
    f3, f4 = mean - roll_part - pitch_part, mean + roll_part - pitch_part
    if yaw_part >= 0.0:
        room = min(most - f1, most - f3, f2 - least, f4 - least)
    else:
        room = min(most - f2, most - f4, f1 - least, f3 - least)
    if abs(yaw_part) > room:
        yaw_part = math.copysign(max(room, 0.0), yaw_part)
        cut |= YAW_TORQUE_CUT
    if cut & THRUST_CUT:
        given[0] = 4.0 * mean
    if cut & TILT_TORQUE_CUT:
        given[1] = 4.0 * lever * roll_part
        given[2] = 4.0 * lever * pitch_part
    if cut & YAW_TORQUE_CUT:
        given[3] = 4.0 * yaw_lever * yaw_part
    return cut
