"""A small nonlinear quadrotor for controller tests: rigid body, rotor lag and limits, drag, aerodynamic moments, wind.

Written from Raja (2.8)-(2.16) and (4.9) apart from the product's own plant and reference model: 400 Hz RK4, control at
100 Hz on perfect state, so that what a test sees is the controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numba
import numpy as np

from controllers import flight_controller
from controllers.cascade import CascadeLimits
from controllers.flight_controller import FlightControllerState
from controllers.gains import GainSet
from models.estimate import Estimate, Reference
from models.frames import quaternion_from_euler
from models.parameters import QuadrotorParameters, load_quadrotor

PARAMETERS = load_quadrotor()
GRAVITY = 9.80665
CONTROL_S = 0.01
SUBSTEPS = 4
NO_COVARIANCE = np.zeros((15, 15))


@numba.njit(cache=True)
def _derivative(x, rotor_command, wind, torque, mass, inertia, drag, moments, lever, kf, kt, lag):
    roll, pitch, yaw = x[6], x[7], x[8]
    p, q, r = x[9], x[10], x[11]
    cr, sr, cp, sp, cy, sy = (
        math.cos(roll),
        math.sin(roll),
        math.cos(pitch),
        math.sin(pitch),
        math.cos(yaw),
        math.sin(yaw),
    )
    f = kf * x[12:16] ** 2
    thrust = f.sum()
    m1 = lever * (f[0] - f[1] - f[2] + f[3]) + torque[0]
    m2 = lever * (f[0] + f[1] - f[2] - f[3]) + torque[1]
    m3 = kt / kf * (f[0] - f[1] + f[2] - f[3]) + torque[2]
    air = x[3:6] - wind
    u = cp * cy * air[0] + cp * sy * air[1] - sp * air[2]
    v = (sr * sp * cy - cr * sy) * air[0] + (sr * sp * sy + cr * cy) * air[1] + sr * cp * air[2]
    w = (cr * sp * cy + sr * sy) * air[0] + (cr * sp * sy - sr * cy) * air[1] + cr * cp * air[2]
    d = np.empty(16)
    d[0:3] = x[3:6]
    d[3] = -(cr * sp * cy + sr * sy) * thrust / mass - drag * air[0]
    d[4] = -(cr * sp * sy - sr * cy) * thrust / mass - drag * air[1]
    d[5] = GRAVITY - cr * cp * thrust / mass - drag * air[2]
    d[6] = p + math.tan(pitch) * (sr * q + cr * r)
    d[7] = cr * q - sr * r
    d[8] = (sr * q + cr * r) / cp
    motion = np.array([u, v, w, p, q, r])
    aero = moments @ motion
    d[9] = (m1 + (inertia[1] - inertia[2]) * q * r) / inertia[0] + aero[0]
    d[10] = (m2 + (inertia[2] - inertia[0]) * p * r) / inertia[1] + aero[1]
    d[11] = (m3 + (inertia[0] - inertia[1]) * p * q) / inertia[2] + aero[2]
    d[12:16] = (rotor_command - x[12:16]) / lag
    return d


@numba.njit(cache=True)
def _advance(x, rotor_command, wind, torque, dt, steps, mass, inertia, drag, moments, lever, kf, kt, lag):
    for _ in range(steps):
        k1 = _derivative(x, rotor_command, wind, torque, mass, inertia, drag, moments, lever, kf, kt, lag)
        k2 = _derivative(
            x + 0.5 * dt * k1, rotor_command, wind, torque, mass, inertia, drag, moments, lever, kf, kt, lag
        )
        k3 = _derivative(
            x + 0.5 * dt * k2, rotor_command, wind, torque, mass, inertia, drag, moments, lever, kf, kt, lag
        )
        k4 = _derivative(x + dt * k3, rotor_command, wind, torque, mass, inertia, drag, moments, lever, kf, kt, lag)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return x


def rotor_speeds(thrust_n: float, torque_n_m: np.ndarray, p: QuadrotorParameters) -> np.ndarray:
    """Rotor speeds (4,) of the X mixer, yaw shed first, then thrust moved to keep roll and pitch."""
    lever, yaw_lever = p.arm_m / math.sqrt(2.0), p.rotor_torque_coefficient_n_m_s2 / p.rotor_force_coefficient_n_s2
    least, most = p.rotor_force_coefficient_n_s2 * p.rotor_min_speed_rad_s**2, p.rotor_max_force_n
    tilt = np.array([1, -1, -1, 1]) * torque_n_m[0] / (4 * lever) + np.array([1, 1, -1, -1]) * torque_n_m[1] / (
        4 * lever
    )
    tilt *= min(1.0, (most - least) / max(np.ptp(tilt), 1e-9))
    mean = np.clip(thrust_n / 4, least - tilt.min(), most - tilt.max())
    yaw = np.array([1, -1, 1, -1]) * torque_n_m[2] / (4 * yaw_lever)
    share = 1.0
    for base, part in zip(mean + tilt, yaw, strict=True):
        if part > 0:
            share = min(share, (most - base) / part)
        elif part < 0:
            share = min(share, (least - base) / part)
    return np.sqrt((mean + tilt + max(share, 0.0) * yaw) / p.rotor_force_coefficient_n_s2)


@dataclass
class Rig:
    """Truth state (16,), wind [m/s], disturbance torque [N m], commands late by whole steps, a log of every step."""

    wind_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    disturbance_n_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -2.0)
    yaw_rad: float = 0.0
    parameters: QuadrotorParameters = field(default_factory=lambda: PARAMETERS)
    transport_steps: int = 0
    time_s: float = 0.0

    def __post_init__(self) -> None:
        self.state = np.zeros(16)
        self.state[0:3] = self.position_ned_m
        self.state[8] = self.yaw_rad
        self.state[12:16] = math.sqrt(
            self.parameters.mass_kg * GRAVITY / 4 / self.parameters.rotor_force_coefficient_n_s2
        )
        self.log: list[np.ndarray] = []
        self.commands: list[np.ndarray] = []

    def estimate(self) -> Estimate:
        x = self.state.tolist()
        return Estimate(
            time_s=self.time_s,
            position_ned_m=(x[0], x[1], x[2]),
            velocity_ned_m_s=(x[3], x[4], x[5]),
            ned_from_body=tuple(quaternion_from_euler(x[6], x[7], x[8])),
            euler_rad=(x[6], x[7], math.remainder(x[8], 2 * math.pi)),
            rates_body_rad_s=(x[9], x[10], x[11]),
            gyro_bias_rad_s=(0.0, 0.0, 0.0),
            accel_bias_m_s2=(0.0, 0.0, 0.0),
            covariance=NO_COVARIANCE,
            position_valid=True,
            attitude_valid=True,
        )

    def apply(self, thrust_n: float, torque_n_m: tuple[float, float, float]) -> None:
        p = self.parameters
        self.commands.append(np.array([thrust_n, *torque_n_m]))
        acting = self.commands[max(len(self.commands) - 1 - self.transport_steps, 0)]
        self.state = _advance(
            self.state,
            rotor_speeds(acting[0], acting[1:], p),
            np.array(self.wind_ned_m_s),
            np.array(self.disturbance_n_m),
            CONTROL_S / SUBSTEPS,
            SUBSTEPS,
            p.mass_kg,
            np.array(p.inertia_kg_m2),
            p.linear_drag_1_s,
            p.aerodynamic_moments,
            p.arm_m / math.sqrt(2.0),
            p.rotor_force_coefficient_n_s2,
            p.rotor_torque_coefficient_n_m_s2,
            p.rotor_lag_s,
        )
        self.time_s += CONTROL_S
        self.log.append(self.state.copy())

    def fly(
        self,
        controller: FlightControllerState,
        reference: Callable[[float], Reference],
        duration_s: float,
        tilt: Callable[[float], tuple[float, float]] | None = None,
    ) -> FlightControllerState:
        """Control for a while; ``reference`` and ``tilt`` are functions of the time since this call."""
        begin_s = self.time_s
        for _ in range(round(duration_s / CONTROL_S)):
            t_s = self.time_s - begin_s
            controller, ladder = flight_controller.step(
                controller,
                self.estimate(),
                reference(t_s),
                limits=CascadeLimits(),
                tilt_reference_rad=None if tilt is None else tilt(t_s),
            )
            self.apply(ladder.thrust_n, ladder.torque_body_n_m)
        return controller

    def engaged(self, gain_set: GainSet, reference: Reference) -> FlightControllerState:
        law = flight_controller.prepare(gain_set, self.parameters)
        return flight_controller.engage(law, self.estimate(), reference, gain_set_number=1)


def step_figures(time_s: np.ndarray, response: np.ndarray, size: float) -> tuple[float, float]:
    """Overshoot [%] and 10-90 % rise time [s] of a step response that starts at zero."""
    y = response / size
    rise = np.interp(0.9, *_first_rise(y, time_s)) - np.interp(0.1, *_first_rise(y, time_s))
    return 100.0 * max(0.0, float(y.max()) - 1.0), float(rise)


def _first_rise(y: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    end = int(np.argmax(y >= 0.9)) + 1
    return np.maximum.accumulate(y[:end]), time_s[:end]
