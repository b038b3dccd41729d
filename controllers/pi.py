"""PI/PID cascade: position to acceleration to tilt, attitude to torque, height to thrust.

P and I act on the error and D on the rate, so a step of the reference gives no derivative kick. Gains are per unit
inertia, mass or gravity, so that one set carries over to a vehicle of another size.
"""

from __future__ import annotations

import numpy as np

from controllers.gains import PidGains
from controllers.law import CascadeLaw, LoopGains, vehicle_terms
from models.parameters import QuadrotorParameters
from models.quadrotor import tilt_from_acceleration


def pid_law(gains: PidGains, parameters: QuadrotorParameters) -> CascadeLaw:
    """The law of a PID gain set; raises nothing."""
    inertia = np.array(parameters.inertia_kg_m2)
    axes = (gains.roll, gains.pitch, gains.yaw)
    proportional = np.diag([axis.p for axis in axes]) * inertia
    attitude_k = np.zeros((3, 8))
    attitude_k[:, 0:3] = proportional
    attitude_k[:, 3:6] = np.diag([axis.d for axis in axes]) * inertia
    tilt = tilt_from_acceleration(parameters.linearisation_yaw_rad)
    mass = parameters.mass_kg
    return CascadeLaw(
        kind="pid",
        name=gains.name,
        feed_forward=gains.feed_forward,
        gains=LoopGains(
            attitude_k=attitude_k,
            attitude_kr=proportional,
            attitude_ki=np.diag([axis.i for axis in axes]) * inertia,
            # Thrust points up while position counts down, hence the signs.
            height_k=-mass * np.array([gains.height.p, gains.height.d]),
            height_kr=-mass * gains.height.p,
            height_ki=-mass * gains.height.i,
            horizontal_k=np.ascontiguousarray(np.hstack((gains.position.p * tilt, gains.position.d * tilt))),
            horizontal_kr=gains.position.p * tilt,
            horizontal_ki=gains.position.i * tilt,
        ),
        vehicle=vehicle_terms(parameters),
    )
