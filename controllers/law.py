"""The one control law behind LQR and PI/PID, in numbers: what a gain set becomes once it is designed.

Each of the three loops (horizontal, height, attitude) is

    u = u_ff - K (x - x_ref) + K_r (r - s) + z,        z' = K_i (r - C x)

on states x relative to an anchor s. For the LQR, K_r = 0 and z = -K_i' xi is the integral action of Raja's I-P form
(K_i = -K_i' of (4.15), (4.20), (4.25)); for the PID, K_r is the P gain and K holds P and D. Carrying the integral as
its contribution z to the command makes every change of law bumpless by the same line, z_0 = u_last - (the rest).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from controllers.loops import LAW_SIZE
from controllers.mixer import mixer_limits
from models.frames import STANDARD_GRAVITY_M_S2, Array
from models.parameters import QuadrotorParameters


@dataclass(frozen=True, slots=True)
class LoopGains:
    """Gains of the three loops.

    ``attitude_k`` (3, 8) on roll, pitch, yaw, p, q, r, v_x, v_y to torque [N m]; ``height_k`` (2,) on down, v_down to
    force; ``horizontal_k`` (2, 4) on x, y, v_x, v_y to roll and pitch. ``*_kr`` act on the references and ``*_ki`` on
    the integral of the errors: (3, 3), scalar, (2, 2).
    """

    attitude_k: Array
    attitude_kr: Array
    attitude_ki: Array
    height_k: Array
    height_kr: float
    height_ki: float
    horizontal_k: Array
    horizontal_kr: Array
    horizontal_ki: Array


@dataclass(frozen=True, slots=True)
class VehicleTerms:
    """What the law needs to know of the vehicle: weight, feed-forward terms, mixer limits, model heading."""

    mass_kg: float
    weight_n: float
    linear_drag_1_s: float
    inertia_kg_m2: Array
    aerodynamic_moments: Array
    model_yaw_rad: float
    rotor_lag_s: float
    mixer: Array


@dataclass(frozen=True, slots=True)
class CascadeLaw:
    """A gain set ready to fly: kind and name, whether the reference is fed forward, gains and vehicle terms.

    ``packed`` (LAW_SIZE,) is all of it in the order of :mod:`controllers.loops`, for the kernels.
    """

    kind: Literal["lqr", "pid"]
    name: str
    feed_forward: bool
    gains: LoopGains
    vehicle: VehicleTerms
    packed: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        g, v = self.gains, self.vehicle
        parts = (
            *(g.attitude_k, g.attitude_kr, g.attitude_ki),
            *(g.height_k, g.height_kr, g.height_ki),
            *(g.horizontal_k, g.horizontal_kr, g.horizontal_ki),
            *(v.mass_kg, v.weight_n, v.linear_drag_1_s, v.model_yaw_rad, v.rotor_lag_s),
            *(v.inertia_kg_m2, v.aerodynamic_moments, v.mixer, self.feed_forward),
        )
        packed = np.concatenate([np.ravel(part) for part in parts], dtype=np.float64)
        assert packed.shape == (LAW_SIZE,), "a gain or a vehicle term has an unexpected shape"
        object.__setattr__(self, "packed", packed)


def vehicle_terms(parameters: QuadrotorParameters) -> VehicleTerms:
    """The vehicle's part of a law, from its parameters."""
    return VehicleTerms(
        mass_kg=parameters.mass_kg,
        weight_n=parameters.mass_kg * STANDARD_GRAVITY_M_S2,
        linear_drag_1_s=parameters.linear_drag_1_s,
        inertia_kg_m2=np.array(parameters.inertia_kg_m2),
        aerodynamic_moments=np.ascontiguousarray(parameters.aerodynamic_moments),
        model_yaw_rad=parameters.linearisation_yaw_rad,
        rotor_lag_s=parameters.rotor_lag_s,
        mixer=mixer_limits(parameters),
    )
