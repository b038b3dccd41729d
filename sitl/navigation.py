"""The vehicle's own idea of where it is: truth plus slow errors, standing for its firmware's estimator.

Each error is a first-order Gauss-Markov process, e' = -e / tau + white noise, of the size its position source allows.
Telemetry of the autopilot (ATTITUDE, LOCAL_POSITION_NED, ...) shows these values, never truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.frames import (
    Quaternion,
    Vec3,
    euler_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
)
from sitl.vehicle import QuadrotorVehicle


@dataclass(frozen=True, slots=True)
class NavigationConfig:
    """1-sigma errors of the autopilot's own estimate and their time constant."""

    position_m: float = 0.15
    velocity_m_s: float = 0.03
    roll_pitch_rad: float = 0.003
    yaw_rad: float = 0.01
    correlation_s: float = 20.0


NAVIGATION_GNSS = NavigationConfig()
NAVIGATION_MOCAP = NavigationConfig(position_m=0.003, velocity_m_s=0.005, yaw_rad=0.004)


class NavigationState:
    """Plain values of one instant, kept as tuples because the outer loops and the telemetry read them one by one."""

    __slots__ = ("euler_rad", "ned_from_body", "position_ned_m", "rates_body_rad_s", "velocity_ned_m_s")

    def __init__(self, position: Vec3, velocity: Vec3, attitude: Quaternion, euler: Vec3, rates: Vec3) -> None:
        self.position_ned_m = position
        self.velocity_ned_m_s = velocity
        self.ned_from_body = attitude
        self.euler_rad = euler
        self.rates_body_rad_s = rates


class Navigation:
    """Errors of the vehicle's estimate; :meth:`update` moves them on, :meth:`state` reads the estimate now."""

    def __init__(self, vehicle: QuadrotorVehicle, config: NavigationConfig, generator: np.random.Generator) -> None:
        self._vehicle = vehicle
        self._config = config
        self._sigma = np.array(
            [*[config.position_m] * 3, *[config.velocity_m_s] * 3, *[config.roll_pitch_rad] * 2, config.yaw_rad]
        )
        self._generator = generator
        self._error = self._sigma * generator.standard_normal(9)
        self._tick = -1
        self._state: NavigationState | None = None
        vehicle.attitude_error_rad[:] = self._error[6:9]

    @property
    def config(self) -> NavigationConfig:
        """Sizes of the errors."""
        return self._config

    def update(self, dt_s: float) -> None:
        """Let the errors wander for ``dt_s``; the attitude error goes to the inner loop as well."""
        keep = math.exp(-dt_s / self._config.correlation_s)
        drive = math.sqrt(1.0 - keep * keep)
        self._error *= keep
        self._error += drive * self._sigma * self._generator.standard_normal(9)
        self._vehicle.attitude_error_rad[:] = self._error[6:9]
        self._tick = -1

    def state(self) -> NavigationState:
        """The estimate at the vehicle's present tick."""
        if self._state is None or self._tick != self._vehicle.tick:
            truth = self._vehicle.state
            attitude = quaternion_multiply(truth[6:10], quaternion_from_rotation_vector(self._error[6:9]))
            n, e, d, vn, ve, vd = (truth[0:6] + self._error[0:6]).tolist()
            w, x, y, z = attitude.tolist()
            roll, pitch, yaw = euler_from_quaternion(attitude).tolist()
            p, q, r = truth[10:13].tolist()
            self._state = NavigationState((n, e, d), (vn, ve, vd), (w, x, y, z), (roll, pitch, yaw), (p, q, r))
            self._tick = self._vehicle.tick
        return self._state
