"""LQR with integral action, Raja (4.1)-(4.25): weights to gains of the attitude, height and horizontal loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_are

from controllers.gains import LqrWeights
from controllers.law import CascadeLaw, LoopGains, vehicle_terms
from models.frames import Array
from models.parameters import QuadrotorParameters
from models.quadrotor import LinearModel, attitude_model, height_model, horizontal_model


@dataclass(frozen=True, slots=True)
class LqrGains:
    """K_x and K_i of each loop: u = -K_x x - K_i xi, xi' = r - C x, as printed in (4.15), (4.20), (4.25).

    Attitude K (3, 8), K_i (3, 3); height K (1, 2), K_i (1, 1); horizontal K (2, 4), K_i (2, 2).
    """

    attitude_k: Array
    attitude_ki: Array
    height_k: Array
    height_ki: Array
    horizontal_k: Array
    horizontal_ki: Array


def augmented(model: LinearModel) -> tuple[Array, Array]:
    """A and B of a model with the integrals of its output errors as further states: xi' = r - C x."""
    n, m, k = model.a.shape[0], model.b.shape[1], model.c.shape[0]
    a = np.zeros((n + k, n + k))
    a[:n, :n] = model.a
    a[n:, :n] = -model.c
    b = np.zeros((n + k, m))
    b[:n] = model.b
    return a, b


def design_loop(model: LinearModel, state_weights: Array, input_weights: Array) -> tuple[Array, Array]:
    """K_x (m, n) and K_i (m, k) that minimise (4.2) for the augmented model, by (4.4)-(4.5).

    ``state_weights`` (n + k,) and ``input_weights`` (m,) are the diagonals of Q and R.
    Raises numpy.linalg.LinAlgError if the Riccati equation has no stabilising solution.
    """
    a, b = augmented(model)
    solution = solve_continuous_are(a, b, np.diag(state_weights), np.diag(input_weights))
    k = (b.T @ solution) / input_weights[:, None]
    n = model.a.shape[0]
    return k[:, :n], k[:, n:]


def design_lqr(weights: LqrWeights, parameters: QuadrotorParameters) -> LqrGains:
    """Gains of all three loops; with the ``published`` weights (4.15) to printed rounding.

    Raises numpy.linalg.LinAlgError if a loop cannot be designed; within the ranges of the gain table all can.
    """
    w = weights.attitude
    attitude_k, attitude_ki = design_loop(
        attitude_model(parameters),
        np.array(
            [w.q_roll, w.q_pitch, w.q_yaw, w.q_roll_rate, w.q_pitch_rate, w.q_yaw_rate, w.q_velocity_x, w.q_velocity_y]
            + [w.q_roll_integral, w.q_pitch_integral, w.q_yaw_integral]
        ),
        np.array([w.r_roll, w.r_pitch, w.r_yaw]),
    )
    h = weights.height
    height_k, height_ki = design_loop(
        height_model(parameters), np.array([h.q_height, h.q_climb, h.q_integral]), np.array([h.r_thrust])
    )
    p = weights.position
    horizontal_k, horizontal_ki = design_loop(
        horizontal_model(parameters),
        np.array([p.q_x, p.q_y, p.q_velocity_x, p.q_velocity_y, p.q_x_integral, p.q_y_integral]),
        np.array([p.r_roll, p.r_pitch]),
    )
    return LqrGains(attitude_k, attitude_ki, height_k, height_ki, horizontal_k, horizontal_ki)


def lqr_law(weights: LqrWeights, parameters: QuadrotorParameters) -> CascadeLaw:
    """The law of an LQR gain set in I-P form; raises as :func:`design_lqr`."""
    gains = design_lqr(weights, parameters)
    return CascadeLaw(
        kind="lqr",
        name=weights.name,
        feed_forward=weights.feed_forward,
        gains=LoopGains(
            attitude_k=np.ascontiguousarray(gains.attitude_k),
            attitude_kr=np.zeros((3, 3)),
            attitude_ki=np.ascontiguousarray(-gains.attitude_ki),
            height_k=np.ascontiguousarray(gains.height_k[0]),
            height_kr=0.0,
            height_ki=-float(gains.height_ki[0, 0]),
            horizontal_k=np.ascontiguousarray(gains.horizontal_k),
            horizontal_kr=np.zeros((2, 2)),
            horizontal_ki=np.ascontiguousarray(-gains.horizontal_ki),
        ),
        vehicle=vehicle_terms(parameters),
    )
