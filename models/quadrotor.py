"""Reference model of the quadrotor: Raja (2.8)-(2.12) with the aerodynamic moments of (4.9),
its linearisation (4.9)-(4.10) and the sub-models (4.12), (4.17), (4.22) that the controllers are designed on.

Corrections to the printed equations: column 13 of (4.9) and the duplicate row of (4.12) are dropped, the "1" of
row 9 of (4.9) belongs to column 12, and (2.4) is the product in the order of its matrix. (4.9) is the linearisation
at a heading of -.01863 rad, the *model heading*; a controller designed on it turns horizontal vectors into that frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.frames import STANDARD_GRAVITY_M_S2, Array
from models.parameters import QuadrotorParameters

STATE_NAMES = ("north", "east", "down", "v_north", "v_east", "v_down", "roll", "pitch", "yaw", "p", "q", "r")
INPUT_NAMES = ("thrust", "torque_roll", "torque_pitch", "torque_yaw")
POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
EULER = slice(6, 9)
RATES = slice(9, 12)

ATTITUDE_STATES = (6, 7, 8, 9, 10, 11, 3, 4)
ATTITUDE_INPUTS = (1, 2, 3)
HEIGHT_STATES = (2, 5)
HEIGHT_INPUTS = (0,)
HORIZONTAL_STATES = (0, 1, 3, 4)
TILT_STATES = (6, 7)


@dataclass(frozen=True, slots=True)
class LinearModel:
    """x' = A x + B u, y = C x about a trim; ``a`` (n, n), ``b`` (n, m), ``c`` (k, n)."""

    a: Array
    b: Array
    c: Array


def derivative(state: Array, inputs: Array, parameters: QuadrotorParameters, wind_ned_m_s: Array) -> Array:
    """x' of the rigid body, Raja (2.8)-(2.12), with inertial velocity as in (4.7).

    ``state`` (12,): position ned [m], velocity ned [m/s], roll, pitch, yaw [rad], p, q, r [rad/s].
    ``inputs`` (4,): thrust [N], torques about body x, y, z [N m]. Drag is ``-linear_drag (v - wind)`` [m/s^2]; the
    aerodynamic moments take body air-relative velocity and rates, (4.9) rows 10-12. Singular at pitch 90 deg.
    """
    roll, pitch, yaw = state[EULER]
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    ned_from_body = np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )
    air_ned_m_s = state[VELOCITY] - wind_ned_m_s
    rates = state[RATES]
    inertia = np.array(parameters.inertia_kg_m2)
    result = np.empty(12)
    result[POSITION] = state[VELOCITY]
    result[VELOCITY] = -ned_from_body[:, 2] * inputs[0] / parameters.mass_kg - parameters.linear_drag_1_s * air_ned_m_s
    result[5] += STANDARD_GRAVITY_M_S2
    euler_from_rates = np.array([[1.0, sr * sp / cp, cr * sp / cp], [0.0, cr, -sr], [0.0, sr / cp, cr / cp]])
    result[EULER] = euler_from_rates @ rates
    aerodynamic = parameters.aerodynamic_moments @ np.concatenate((ned_from_body.T @ air_ned_m_s, rates))
    result[RATES] = (inputs[1:] - np.cross(rates, inertia * rates)) / inertia + aerodynamic
    return result


def hover_inputs(parameters: QuadrotorParameters) -> Array:
    """Thrust and torques (4,) of hover in still air [N, N m]."""
    return np.array([parameters.mass_kg * STANDARD_GRAVITY_M_S2, 0.0, 0.0, 0.0])


def linear_model(parameters: QuadrotorParameters) -> LinearModel:
    """Hover linearisation (4.9)-(4.10): A (12, 12), B (12, 4) at the model heading; C is the identity.

    The moments per velocity are taken as printed, though (4.9) has inertial velocity as its state: turned by the model
    heading they would differ by .11 in the smallest entries, and the gains (4.15) would not come out.
    """
    sine = STANDARD_GRAVITY_M_S2 * math.sin(parameters.linearisation_yaw_rad)
    cosine = STANDARD_GRAVITY_M_S2 * math.cos(parameters.linearisation_yaw_rad)
    a = np.zeros((12, 12))
    a[POSITION, VELOCITY] = np.eye(3)
    a[VELOCITY, VELOCITY] = -parameters.linear_drag_1_s * np.eye(3)
    a[3, 6:8] = -sine, -cosine
    a[4, 6:8] = cosine, -sine
    a[EULER, RATES] = np.eye(3)
    a[RATES, VELOCITY] = parameters.aerodynamic_moments[:, :3]
    a[RATES, RATES] = parameters.aerodynamic_moments[:, 3:]
    b = np.zeros((12, 4))
    b[5, 0] = -1.0 / parameters.mass_kg
    b[RATES, 1:] = np.diag(1.0 / np.array(parameters.inertia_kg_m2))
    return LinearModel(a, b, np.eye(12))


def attitude_model(parameters: QuadrotorParameters) -> LinearModel:
    """(4.12): states roll, pitch, yaw, p, q, r, v_x, v_y; inputs torques; outputs roll, pitch, yaw."""
    full = linear_model(parameters)
    return LinearModel(
        full.a[np.ix_(ATTITUDE_STATES, ATTITUDE_STATES)], full.b[np.ix_(ATTITUDE_STATES, ATTITUDE_INPUTS)], np.eye(3, 8)
    )


def height_model(parameters: QuadrotorParameters) -> LinearModel:
    """(4.17): states down, v_down; input thrust; output down."""
    full = linear_model(parameters)
    return LinearModel(
        full.a[np.ix_(HEIGHT_STATES, HEIGHT_STATES)], full.b[np.ix_(HEIGHT_STATES, HEIGHT_INPUTS)], np.eye(1, 2)
    )


def horizontal_model(parameters: QuadrotorParameters) -> LinearModel:
    """(4.22): states x, y, v_x, v_y; inputs roll and pitch, taken as reached at once; outputs x, y."""
    full = linear_model(parameters)
    return LinearModel(
        full.a[np.ix_(HORIZONTAL_STATES, HORIZONTAL_STATES)],
        full.a[np.ix_(HORIZONTAL_STATES, TILT_STATES)],
        np.eye(2, 4),
    )


def tilt_from_acceleration(yaw_rad: float) -> Array:
    """Matrix (2, 2) that gives roll and pitch [rad] of a small horizontal NED acceleration [m/s^2] at a heading."""
    s, c = math.sin(yaw_rad), math.cos(yaw_rad)
    return np.array([[-s, c], [-c, -s]]) / STANDARD_GRAVITY_M_S2
