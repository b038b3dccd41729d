"""The vehicle's own attitude and rate loops, the part of its firmware that runs at every tick.

Attitude error (quaternion) to rates by proportional gains, rates to torque by PI on the inertia, then the mixer.
It reads truth for rates and truth plus a slow error for attitude (see :mod:`sitl.navigation`): it stands for firmware
whose own estimator is good, and is no part of what this project is about.
"""

from __future__ import annotations

import math

from models.frames import Array
from models.kernel import kernel
from sitl.plants.quadrotor import FORCE, FORCE_MAX, mix

# First entry of a command, shape (6,). OFF: rest unused. TORQUE: torque body [N m] 1:4, thrust [N] 4.
# RATES: rates [rad/s] 1:4, thrust [N] 4. ATTITUDE: quaternion ned_from_body 1:5, thrust [N] 5.
OFF, TORQUE, RATES, ATTITUDE = range(4)
COMMAND_SIZE = 6

# Crossover of the rate loop is bound by the motor lag of .05 s: 10/s gives a damping of .7 with it.
RATE_GAIN_1_S = (10.0, 10.0, 5.0)
RATE_INTEGRAL_1_S2 = (15.0, 15.0, 4.0)
ATTITUDE_GAIN_1_S = (4.5, 4.5, 2.0)
RATE_LIMIT_RAD_S = (3.8, 3.8, 1.5)
INTEGRAL_LIMIT_RAD_S2 = 80.0


@kernel("f8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8, f8[::1])")
def control(
    command: Array,
    state: Array,
    attitude_error_rad: Array,
    integral: Array,
    scalars: Array,
    inertia: Array,
    dt_s: float,
    rotor_command_rad_s: Array,
) -> float:
    """Rotor speed commands (4,) [rad/s] for one tick; returns 1.0 while the mixer sheds something.

    ``attitude_error_rad`` (3,) is the error of the vehicle's own attitude estimate, a small body rotation vector;
    ``integral`` (3,) [rad/s^2] is kept between calls and frozen while the mixer sheds.
    """
    kind = int(command[0])
    if kind == OFF:
        for i in range(4):
            rotor_command_rad_s[i] = 0.0
        for i in range(3):
            integral[i] = 0.0
        return 0.0
    work = rotor_command_rad_s.copy()
    torque = work[:3]
    if kind == TORQUE:
        for i in range(3):
            torque[i] = command[1 + i]
            integral[i] = 0.0
        thrust = command[4]
        shed = mix(thrust, torque, scalars, rotor_command_rad_s)
    else:
        rates = work[:3]
        if kind == ATTITUDE:
            thrust = command[5]
            a, b, c, d = state[6], -state[7], -state[8], -state[9]
            w, x, y, z = command[1], command[2], command[3], command[4]
            ew = a * w - b * x - c * y - d * z
            side = 2.0 if ew >= 0.0 else -2.0
            rates[0] = ATTITUDE_GAIN_1_S[0] * (side * (a * x + b * w + c * z - d * y) - attitude_error_rad[0])
            rates[1] = ATTITUDE_GAIN_1_S[1] * (side * (a * y + c * w + d * x - b * z) - attitude_error_rad[1])
            rates[2] = ATTITUDE_GAIN_1_S[2] * (side * (a * z + d * w + b * y - c * x) - attitude_error_rad[2])
        else:
            thrust = command[4]
            for i in range(3):
                rates[i] = command[1 + i]
        previous = (integral[0], integral[1], integral[2])
        for i in range(3):
            limit = RATE_LIMIT_RAD_S[i]
            error = max(-limit, min(limit, rates[i])) - state[10 + i]
            grown = integral[i] + dt_s * RATE_INTEGRAL_1_S2[i] * error
            integral[i] = max(-INTEGRAL_LIMIT_RAD_S2, min(INTEGRAL_LIMIT_RAD_S2, grown))
            torque[i] = inertia[i, i] * (RATE_GAIN_1_S[i] * error + integral[i])
        shed = mix(thrust, torque, scalars, rotor_command_rad_s)
        if shed > 0.0:
            for i in range(3):
                integral[i] = previous[i]
    for i in range(4):
        force = min(scalars[FORCE_MAX], rotor_command_rad_s[i])
        rotor_command_rad_s[i] = math.sqrt(force / scalars[FORCE])
    return shed
