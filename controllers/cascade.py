"""The cascade in flight: horizontal loop to tilt, height loop to thrust, attitude loop to torque.

Reference feed-forward in I-P form. The law acts on the state relative to an anchor s that the reference's own
velocity carries along, s' = v_ref. A jump of the reference leaves s where it is, so it acts through the integral alone
and gives no proportional kick, as the I-P form wants; a moving reference moves s, the states see x - x_ref, and the
error dynamics no longer see the motion: no lag. In the attitude loop the anchor of roll and pitch is the tilt that
the reference's acceleration and drag need, and their rates come from its jerk. Without feed-forward s rests, and the
law is the published one on absolute states (a constant s only shifts z).

The horizontal integral is kept as an acceleration in NED, so that it still holds the wind off after a turn. Vectors
are turned by heading less model heading, the frame (4.9) and (4.22) are written in. Yaw is unwrapped from step to step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from controllers.law import CascadeLaw, VehicleTerms
from controllers.loops import acceleration_of, attitude_direct, feed_forward_torque, horizontal_direct, tilt_of, turned
from controllers.mixer import TILT_TORQUE_CUT, achievable
from models.estimate import Estimate, Reference
from models.frames import Array, quaternion_from_euler, wrap_angle
from models.setpoints import Ladder

LONGEST_STEP_S = 0.1
LEAST_TILT_COSINE = 0.5
_NO_FEED_FORWARD = Reference((0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class CascadeLimits:
    """Greatest commanded tilt [rad], as the angle between thrust and vertical."""

    tilt_rad: float = 0.35


@dataclass(frozen=True, slots=True)
class Command:
    """What the cascade asked for last: tilt (roll, pitch) [rad], thrust [N], torque [N m]."""

    tilt_rad: tuple[float, float]
    thrust_n: float
    torque_n_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CascadeState:
    """Memory of the cascade after a step at ``time_s``. Arrays are never changed in place.

    ``*_integral`` are the contributions z of the integrals to the command and ``*_integral_rate`` their present rates
    (zero where anti-windup froze them); ``anchor_*`` is s with its rates; ``yaw_rad`` is unwrapped.
    ``outer_active`` says that the horizontal loop made the tilt, rather than a given tilt reference.
    """

    time_s: float
    horizontal_integral_ned_m_s2: Array
    height_integral_n: float
    attitude_integral_n_m: Array
    horizontal_integral_rate: Array
    height_integral_rate: float
    attitude_integral_rate: Array
    anchor_ned_m: Array
    anchor_velocity_m_s: Array
    anchor_acceleration_m_s2: Array
    anchor_yaw_rad: float
    anchor_yaw_rate_rad_s: float
    yaw_rad: float
    outer_active: bool
    command: Command


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Estimate and reference as arrays, the reference's motion zeroed where the law does not feed it forward."""

    euler: Array
    rates: Array
    position: Array
    velocity: Array
    yaw_rad: float
    position_reference: Array
    velocity_ff: Array
    acceleration_ff: Array
    jerk_ff: Array
    yaw_rate_ff: float
    yaw_error_rad: float


def _inputs(law: CascadeLaw, estimate: Estimate, reference: Reference, unwrapped_from_rad: float) -> _Inputs:
    moving = reference if law.feed_forward else _NO_FEED_FORWARD
    yaw_rad = unwrapped_from_rad + wrap_angle(estimate.euler_rad[2] - unwrapped_from_rad)
    return _Inputs(
        euler=np.array(estimate.euler_rad),
        rates=np.array(estimate.rates_body_rad_s),
        position=np.array(estimate.position_ned_m),
        velocity=np.array(estimate.velocity_ned_m_s),
        yaw_rad=yaw_rad,
        position_reference=np.array(reference.position_ned_m),
        velocity_ff=np.array(moving.velocity_ned_m_s),
        acceleration_ff=np.array(moving.acceleration_ned_m_s2),
        jerk_ff=np.array(moving.jerk_ned_m_s3),
        yaw_rate_ff=moving.yaw_rate_rad_s,
        yaw_error_rad=wrap_angle(reference.yaw_rad - yaw_rad),
    )


def _tilt_direct(law: CascadeLaw, x: _Inputs, anchor_ned_m: Array) -> Array:
    """Roll and pitch (2,) without the integral; the feed-forward acceleration includes the drag of the motion."""
    return horizontal_direct(
        x.yaw_rad,
        law.vehicle.model_yaw_rad,
        x.position - anchor_ned_m,
        x.velocity - x.velocity_ff,
        x.position_reference - anchor_ned_m,
        x.acceleration_ff + law.vehicle.linear_drag_1_s * x.velocity_ff,
        law.gains.horizontal_k,
        law.gains.horizontal_kr,
    )


def _force_direct(law: CascadeLaw, x: _Inputs, anchor_ned_m: Array) -> float:
    """Vertical force [N], positive up, without the integral: m (g - a_ref - drag) - K (x - x_ref) + K_r (r - s)."""
    k, vehicle, anchor = law.gains.height_k, law.vehicle, float(anchor_ned_m[2])
    acceleration_ff = float(x.acceleration_ff[2] + vehicle.linear_drag_1_s * x.velocity_ff[2])
    return (
        vehicle.weight_n
        - vehicle.mass_kg * acceleration_ff
        - float(k[0]) * (float(x.position[2]) - anchor)
        - float(k[1]) * float(x.velocity[2] - x.velocity_ff[2])
        + law.gains.height_kr * (float(x.position_reference[2]) - anchor)
    )


def _moving_attitude(law: CascadeLaw, x: _Inputs, outer_active: bool) -> tuple[Array, Array]:
    """Roll and pitch (2,) that the reference's motion needs, and the body rates (3,) of that and of its yaw."""
    rates = np.array([0.0, 0.0, x.yaw_rate_ff])
    if not (law.feed_forward and outer_active):
        return np.zeros(2), rates
    drag = law.vehicle.linear_drag_1_s
    tilt = tilt_of(x.yaw_rad, x.acceleration_ff + drag * x.velocity_ff)
    tilt_rate = tilt_of(x.yaw_rad, x.jerk_ff + drag * x.acceleration_ff)
    rates[0] = tilt_rate[0] + x.yaw_rate_ff * tilt[1]
    rates[1] = tilt_rate[1] - x.yaw_rate_ff * tilt[0]
    return tilt, rates


def _torque_direct(law: CascadeLaw, x: _Inputs, anchor_yaw_rad: float, tilt_rad: Array, outer_active: bool) -> Array:
    """Torque (3,) without the integral."""
    vehicle = law.vehicle
    anchor, rates_ff = _moving_attitude(law, x, outer_active)
    state = np.empty(8)
    state[0:2] = x.euler[0:2] - anchor
    state[2] = x.yaw_rad - anchor_yaw_rad
    state[3:6] = x.rates - rates_ff
    state[6:8] = turned(x.yaw_rad - vehicle.model_yaw_rad, x.velocity - x.velocity_ff)
    reference = np.empty(3)
    reference[0:2] = tilt_rad - anchor
    reference[2] = state[2] + x.yaw_error_rad
    torque_ff = feed_forward_torque(
        x.yaw_rad, x.velocity_ff, rates_ff, vehicle.inertia_kg_m2, vehicle.aerodynamic_moments
    )
    return attitude_direct(state, reference, torque_ff, law.gains.attitude_k, law.gains.attitude_kr)


def _tilt_cosine(law: CascadeLaw, x: _Inputs) -> float:
    """cos(roll) cos(pitch): thrust is force over it, so that a tilt does not cost height; 1 without feed-forward."""
    if not law.feed_forward:
        return 1.0
    return max(LEAST_TILT_COSINE, math.cos(x.euler[0]) * math.cos(x.euler[1]))


def hover_command(vehicle: VehicleTerms) -> Command:
    """Level, weight, no torque: the last command to assume when nothing better is known."""
    return Command((0.0, 0.0), vehicle.weight_n, (0.0, 0.0, 0.0))


def seed(
    law: CascadeLaw, estimate: Estimate, reference: Reference, last: Command, *, outer_active: bool = True
) -> CascadeState:
    """State from which the next :func:`step` of ``law`` at this estimate and reference asks for exactly ``last``.

    The one rule of every switch and every live gain change: z_0 = u_last - (everything but z), in all three loops; for
    the LQR that is xi_0 = -K_i^-1 (u_last + K x), for the PID I = u_last - P - D. The anchor starts at the reference.
    """
    x = _inputs(law, estimate, reference, estimate.euler_rad[2])
    anchor_yaw_rad = x.yaw_rad + x.yaw_error_rad
    tilt = np.array(last.tilt_rad)
    return CascadeState(
        time_s=estimate.time_s,
        horizontal_integral_ned_m_s2=acceleration_of(x.yaw_rad, tilt - _tilt_direct(law, x, x.position_reference)),
        height_integral_n=last.thrust_n * _tilt_cosine(law, x) - _force_direct(law, x, x.position_reference),
        attitude_integral_n_m=np.array(last.torque_n_m) - _torque_direct(law, x, anchor_yaw_rad, tilt, outer_active),
        horizontal_integral_rate=np.zeros(2),
        height_integral_rate=0.0,
        attitude_integral_rate=np.zeros(3),
        anchor_ned_m=x.position_reference,
        anchor_velocity_m_s=x.velocity_ff,
        anchor_acceleration_m_s2=x.acceleration_ff,
        anchor_yaw_rad=anchor_yaw_rad,
        anchor_yaw_rate_rad_s=x.yaw_rate_ff,
        yaw_rad=x.yaw_rad,
        outer_active=outer_active,
        command=last,
    )


def step(
    state: CascadeState,
    estimate: Estimate,
    reference: Reference,
    *,
    law: CascadeLaw,
    limits: CascadeLimits,
    tilt_reference_rad: tuple[float, float] | None = None,
) -> tuple[CascadeState, Ladder]:
    """One step of the cascade: estimate and reference to a command on every rung of the ladder.

    Time comes from the estimates: integrals and anchor advance by the time since the last one (at most .1 s, none if
    it is the same). With ``tilt_reference_rad`` (roll, pitch) the horizontal loop is bypassed, and taken up again
    without a jump when it is left out. Integrals that would push further into saturation are frozen, loop by loop.
    """
    outer = tilt_reference_rad is None
    x = _inputs(law, estimate, reference, state.yaw_rad)
    elapsed_s = min(max(estimate.time_s - state.time_s, 0.0), LONGEST_STEP_S)
    anchor, anchor_yaw_rad = _advanced_anchor(state, elapsed_s)
    horizontal_integral = state.horizontal_integral_ned_m_s2 + elapsed_s * state.horizontal_integral_rate
    height_integral = state.height_integral_n + elapsed_s * state.height_integral_rate
    attitude_integral = state.attitude_integral_n_m + elapsed_s * state.attitude_integral_rate

    if tilt_reference_rad is None:
        direct = _tilt_direct(law, x, anchor)
        if not state.outer_active:
            horizontal_integral = acceleration_of(x.yaw_rad, np.array(state.command.tilt_rad) - direct)
        wanted_tilt = direct + tilt_of(x.yaw_rad, horizontal_integral)
    else:
        wanted_tilt = np.array(tilt_reference_rad)
    tilt_scale = min(1.0, limits.tilt_rad / max(math.hypot(wanted_tilt[0], wanted_tilt[1]), 1e-9))
    tilt = wanted_tilt * tilt_scale

    force_n = _force_direct(law, x, anchor) + height_integral
    wanted = np.empty(4)
    wanted[0] = force_n / _tilt_cosine(law, x)
    wanted[1:] = _torque_direct(law, x, anchor_yaw_rad, tilt, outer) + attitude_integral
    given = np.empty(4)
    cut = achievable(wanted, law.vehicle.mixer, given)
    command, lost = _command(tilt, wanted), wanted - given
    tilt_limited = tilt_scale < 1.0 or bool(cut & TILT_TORQUE_CUT)
    next_state = CascadeState(
        time_s=estimate.time_s,
        horizontal_integral_ned_m_s2=horizontal_integral,
        height_integral_n=height_integral,
        attitude_integral_n_m=attitude_integral,
        horizontal_integral_rate=_horizontal_rate(law, x, wanted_tilt, tilt_limited) if outer else np.zeros(2),
        height_integral_rate=_height_rate(law, x, float(lost[0])),
        attitude_integral_rate=_attitude_rate(law, x, tilt, lost[1:]),
        anchor_ned_m=anchor,
        anchor_velocity_m_s=x.velocity_ff,
        anchor_acceleration_m_s2=x.acceleration_ff,
        anchor_yaw_rad=anchor_yaw_rad,
        anchor_yaw_rate_rad_s=x.yaw_rate_ff,
        yaw_rad=x.yaw_rad,
        outer_active=outer,
        command=command,
    )
    return next_state, _ladder(law, x, reference, command, saturated=tilt_scale < 1.0 or cut != 0)


def _command(tilt_rad: Array, thrust_and_torque: Array) -> Command:
    roll, pitch = tilt_rad.tolist()
    thrust_n, x, y, z = thrust_and_torque.tolist()
    return Command((roll, pitch), thrust_n, (x, y, z))


def _advanced_anchor(state: CascadeState, elapsed_s: float) -> tuple[Array, float]:
    """s and its heading after ``elapsed_s`` at the reference velocity and acceleration of the last step."""
    anchor = state.anchor_ned_m + elapsed_s * (
        state.anchor_velocity_m_s + 0.5 * elapsed_s * state.anchor_acceleration_m_s2
    )
    return anchor, state.anchor_yaw_rad + elapsed_s * state.anchor_yaw_rate_rad_s


def _horizontal_rate(law: CascadeLaw, x: _Inputs, wanted_tilt: Array, limited: bool) -> Array:
    """Rate of the horizontal integral (2,) [m/s^3], 0 while it would push further into a limited tilt."""
    error = turned(x.yaw_rad - law.vehicle.model_yaw_rad, x.position_reference - x.position)
    push: Array = law.gains.horizontal_ki @ error
    if limited and float(push @ wanted_tilt) > 0.0:
        return np.zeros(2)
    return acceleration_of(x.yaw_rad, push)


def _height_rate(law: CascadeLaw, x: _Inputs, lost_n: float) -> float:
    """Rate of the height integral [N/s], 0 while it would push further into what the rotors cannot give."""
    rate = law.gains.height_ki * float(x.position_reference[2] - x.position[2])
    return 0.0 if rate * lost_n > 0.0 else rate


def _attitude_rate(law: CascadeLaw, x: _Inputs, tilt_rad: Array, lost_n_m: Array) -> Array:
    """Rates of the attitude integrals (3,) [N m/s], 0 on axes that would push further into saturation."""
    error = np.array([tilt_rad[0] - x.euler[0], tilt_rad[1] - x.euler[1], x.yaw_error_rad])
    rate = law.gains.attitude_ki @ error
    return np.where(rate * lost_n_m > 0.0, 0.0, rate)


def _ladder(law: CascadeLaw, x: _Inputs, reference: Reference, command: Command, *, saturated: bool) -> Ladder:
    roll, pitch = command.tilt_rad
    w, i, j, k = quaternion_from_euler(roll, pitch, reference.yaw_rad).tolist()
    ahead = x.rates + law.vehicle.rotor_lag_s * np.array(command.torque_n_m) / law.vehicle.inertia_kg_m2
    p, q, r = ahead.tolist()
    return Ladder(
        position_ned_m=reference.position_ned_m,
        velocity_ned_m_s=reference.velocity_ned_m_s,
        acceleration_ned_m_s2=reference.acceleration_ned_m_s2,
        yaw_rad=reference.yaw_rad,
        ned_from_body=(w, i, j, k),
        rates_body_rad_s=(p, q, r),
        torque_body_n_m=command.torque_n_m,
        thrust_n=command.thrust_n,
        saturated=saturated,
    )
