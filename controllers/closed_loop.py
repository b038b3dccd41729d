"""The whole closed loop as one linear system: quadrotor, rotor lag, delay, and the three loops with their integrals.

States, in this order: the twelve of (4.7), rotor thrust and torques behind their lag (4), the second-order Padé
states of the delay of each of the four commands (8), and the integral contributions z of attitude (3), height (1) and
horizontal loop (2). Every claim about stability is made on this system, never on eig(A - B K_x) alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, schur

from controllers.law import CascadeLaw
from models.frames import Array
from models.parameters import QuadrotorParameters
from models.quadrotor import (
    ATTITUDE_STATES,
    HEIGHT_STATES,
    HORIZONTAL_STATES,
    INPUT_NAMES,
    STATE_NAMES,
    linear_model,
)

PLANT = slice(0, 12)
ROTORS = slice(12, 16)
DELAY = slice(16, 24)
ATTITUDE_INTEGRAL = slice(24, 27)
HEIGHT_INTEGRAL = slice(27, 28)
HORIZONTAL_INTEGRAL = slice(28, 30)
SIZE = 30
FREE_WITHOUT_OUTER_LOOP = (0, 1, 28, 29)

NAMES = (
    *STATE_NAMES,
    *(f"rotor {name}" for name in INPUT_NAMES),
    *(f"delay {name} {order}" for name in INPUT_NAMES for order in (1, 2)),
    *(f"integral {name}" for name in ("roll", "pitch", "yaw", "height", "x", "y")),
)
"""Name of every state, for poles that are labelled by the state that takes part most."""

LOOPS = ("roll", "pitch", "yaw", "height", "x", "y")
"""Order of injections, commands, references and outputs."""


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """x' = A x + B_d d + B_r r, command = C_u x + D_u r, output = C_y x; columns and rows in the order of LOOPS.

    ``d`` adds to the command of a loop where it is cut: torques, thrust, and for x and y the pitch and roll command.
    """

    names: tuple[str, ...]
    a: Array
    b_injection: Array
    b_reference: Array
    c_command: Array
    d_command: Array
    c_output: Array


def closed_loop(law: CascadeLaw, parameters: QuadrotorParameters, motor_lag_s: float, delay_s: float) -> ClosedLoop:
    """Assemble the cascade of ``law``; ``motor_lag_s`` and ``delay_s`` must be positive."""
    g = law.gains
    # Rows of command over states and over references (attitude references are the tilt commands and yaw).
    tilt = np.zeros((2, SIZE))
    tilt[:, HORIZONTAL_STATES] = -g.horizontal_k
    tilt[:, HORIZONTAL_INTEGRAL] = np.eye(2)
    thrust = np.zeros((1, SIZE))
    thrust[:, HEIGHT_STATES] = -g.height_k
    thrust[:, HEIGHT_INTEGRAL] = 1.0
    torque = np.zeros((3, SIZE))
    torque[:, ATTITUDE_STATES] = -g.attitude_k
    torque[:, ATTITUDE_INTEGRAL] = np.eye(3)
    torque += g.attitude_kr[:, :2] @ tilt

    a, b_command = _plant(parameters, motor_lag_s, delay_s)
    actuators = np.vstack((thrust, torque))
    a += b_command @ actuators
    a[ATTITUDE_INTEGRAL, 6:9] -= g.attitude_ki
    a[ATTITUDE_INTEGRAL] += g.attitude_ki[:, :2] @ tilt
    a[HEIGHT_INTEGRAL, 2] -= g.height_ki
    a[HORIZONTAL_INTEGRAL, 0:2] -= g.horizontal_ki

    b_injection = np.zeros((SIZE, 6))
    b_injection[:, 0:3], b_injection[:, 3] = b_command[:, 1:], b_command[:, 0]
    for column, axis in ((4, 1), (5, 0)):
        b_injection[:, column] = _through_tilt(law, b_command)[:, axis]
    c_command = np.vstack((torque, thrust, tilt[1], tilt[0]))

    b_reference = np.zeros((SIZE, 6))
    b_reference[:, 0:3] = b_command[:, 1:] @ g.attitude_kr
    b_reference[ATTITUDE_INTEGRAL, 0:3] += g.attitude_ki
    b_reference[:, 3] = b_command[:, 0] * g.height_kr
    b_reference[HEIGHT_INTEGRAL, 3] += g.height_ki
    b_reference[:, 4:6] = _through_tilt(law, b_command) @ g.horizontal_kr
    b_reference[HORIZONTAL_INTEGRAL, 4:6] += g.horizontal_ki
    d_command = np.zeros((6, 6))
    d_command[0:3, 0:3] = g.attitude_kr
    d_command[3, 3] = g.height_kr
    d_command[4, 4:6], d_command[5, 4:6] = g.horizontal_kr[1], g.horizontal_kr[0]
    d_command[0:3, 4:6] = g.attitude_kr[:, :2] @ g.horizontal_kr

    c_output = np.zeros((6, SIZE))
    c_output[[0, 1, 2, 3, 4, 5], [6, 7, 8, 2, 0, 1]] = 1.0
    return ClosedLoop(NAMES, a, b_injection, b_reference, c_command, d_command, c_output)


def inner_loop(law: CascadeLaw, parameters: QuadrotorParameters, motor_lag_s: float, delay_s: float) -> ClosedLoop:
    """The cascade without its horizontal loop: roll and pitch follow their references, x and y are left out."""
    zero_k, zero_kr = np.zeros((2, 4)), np.zeros((2, 2))
    gains = replace(law.gains, horizontal_k=zero_k, horizontal_kr=zero_kr, horizontal_ki=zero_kr)
    whole = closed_loop(replace(law, gains=gains), parameters, motor_lag_s, delay_s)
    keep = [index for index in range(SIZE) if index not in FREE_WITHOUT_OUTER_LOOP]
    return ClosedLoop(
        names=tuple(NAMES[index] for index in keep),
        a=whole.a[np.ix_(keep, keep)],
        b_injection=whole.b_injection[keep],
        b_reference=whole.b_reference[keep],
        c_command=whole.c_command[:, keep],
        d_command=whole.d_command,
        c_output=whole.c_output[:, keep],
    )


def _plant(parameters: QuadrotorParameters, motor_lag_s: float, delay_s: float) -> tuple[Array, Array]:
    """A (SIZE, SIZE) and B (SIZE, 4) from commanded thrust and torques, with delay and rotor lag, nothing closed.

    The delay is the second-order Padé form (1 - s T/2 + (s T)^2/12) / (1 + s T/2 + (s T)^2/12) in controllable form.
    """
    model = linear_model(parameters)
    a = np.zeros((SIZE, SIZE))
    b = np.zeros((SIZE, 4))
    a[PLANT, PLANT] = model.a
    a[PLANT, ROTORS] = model.b
    a[ROTORS, ROTORS] = -np.eye(4) / motor_lag_s
    for channel in range(4):
        first, second = DELAY.start + 2 * channel, DELAY.start + 2 * channel + 1
        a[first, second] = 1.0
        a[second, first] = -12.0 / delay_s**2
        a[second, second] = -6.0 / delay_s
        b[second, channel] = 1.0
        # Output of the Padé form: command - (12 / T) * second state.
        rotor = ROTORS.start + channel
        a[rotor, second] = -12.0 / delay_s / motor_lag_s
        b[rotor, channel] = 1.0 / motor_lag_s
    return a, b


def _through_tilt(law: CascadeLaw, b_command: Array) -> Array:
    """Columns (SIZE, 2): what a change of the roll and of the pitch command does to the attitude loop."""
    columns: Array = b_command[:, 1:] @ law.gains.attitude_kr[:, :2]
    columns[ATTITUDE_INTEGRAL] += law.gains.attitude_ki[:, :2]
    return columns


def frequency_response(a: Array, b: Array, c: Array, omega_rad_s: Array) -> npt.NDArray[np.complex128]:
    """C (j w I - A)^-1 B at every frequency, shape (w, rows of C, columns of B).

    One complex Schur form, then back substitution for all frequencies at once: as robust as solving each, and fast.
    """
    triangular, unitary = schur(a, output="complex")
    right = unitary.conj().T @ b
    n, m, w = a.shape[0], b.shape[1], omega_rad_s.size
    solution = np.empty((n, w * m), dtype=np.complex128)
    frequencies = np.repeat(1j * omega_rad_s, m)
    for row in range(n - 1, -1, -1):
        coupled = triangular[row, row + 1 :] @ solution[row + 1 :]
        solution[row] = (np.tile(right[row], w) + coupled) / (frequencies - triangular[row, row])
    response: npt.NDArray[np.complex128] = (c @ unitary) @ solution
    return response.reshape(c.shape[0], w, m).transpose(1, 0, 2)


def step_responses(loop: ClosedLoop, duration_s: float, samples: int) -> tuple[Array, Array, Array]:
    """Times (k,), outputs and commands (k, 6, 6) for a unit step of every reference: [time, row, reference]."""
    n = loop.a.shape[0]
    interval_s = duration_s / (samples - 1)
    augmented = np.zeros((n + 6, n + 6))
    augmented[:n, :n], augmented[:n, n:] = loop.a, loop.b_reference
    transition = expm(augmented * interval_s)
    state = np.zeros((n, 6))
    states = np.empty((samples, n, 6))
    for k in range(samples):
        states[k] = state
        state = transition[:n, :n] @ state + transition[:n, n:]
    outputs = loop.c_output @ states
    commands = loop.c_command @ states + loop.d_command
    return np.linspace(0.0, duration_s, samples), outputs, commands
