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

from dataclasses import dataclass

import numpy as np

from controllers import loops
from controllers.law import CascadeLaw, VehicleTerms
from models.estimate import Estimate, Reference
from models.frames import Array
from models.setpoints import Ladder


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
    """Memory of the cascade after a step: the numbers (MEMORY_SIZE,) of :mod:`controllers.loops`, never changed.

    They hold the anchor s with its rates; the contributions z of the integrals to the command and their present rates
    (zero where anti-windup froze them); the heading, unwrapped; whether the horizontal loop made the tilt, rather than
    a given tilt reference; and the command.
    """

    memory: Array

    @property
    def time_s(self) -> float:
        """Time of the step, on the vehicle clock [s]."""
        return float(self.memory[loops.LAST_TIME])

    @property
    def horizontal_integral_ned_m_s2(self) -> Array:
        """Contribution (2,) of the horizontal integral, as acceleration north and east."""
        return self.memory[loops.HORIZONTAL_Z : loops.HEIGHT_Z]

    @property
    def outer_active(self) -> bool:
        """Whether the horizontal loop made the tilt."""
        return bool(self.memory[loops.OUTER_ACTIVE])

    @property
    def command(self) -> Command:
        """What this step asked for."""
        roll, pitch, thrust_n, x, y, z = self.memory[loops.TILT : loops.NED_FROM_BODY].tolist()
        return Command((roll, pitch), thrust_n, (x, y, z))


def _inputs(
    estimate: Estimate,
    reference: Reference,
    *,
    outer: bool,
    given_tilt_rad: tuple[float, float] = (0.0, 0.0),
    tilt_limit_rad: float = 0.0,
) -> Array:
    """Inputs (INPUT_SIZE,) of the kernels, in their order."""
    return np.array(
        (
            estimate.time_s,
            *estimate.euler_rad,
            *estimate.rates_body_rad_s,
            *estimate.position_ned_m,
            *estimate.velocity_ned_m_s,
            *reference.position_ned_m,
            *reference.velocity_ned_m_s,
            *reference.acceleration_ned_m_s2,
            *reference.jerk_ned_m_s3,
            reference.yaw_rad,
            reference.yaw_rate_rad_s,
            tilt_limit_rad,
            outer,
            *given_tilt_rad,
            0.0,
            0.0,
        ),
        dtype=np.float64,
    )


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
    command = np.array((*last.tilt_rad, last.thrust_n, *last.torque_n_m), dtype=np.float64)
    return CascadeState(loops.seeded(law.packed, _inputs(estimate, reference, outer=outer_active), command))


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
    x = _inputs(
        estimate,
        reference,
        outer=tilt_reference_rad is None,
        given_tilt_rad=tilt_reference_rad or (0.0, 0.0),
        tilt_limit_rad=limits.tilt_rad,
    )
    memory = loops.stepped(law.packed, state.memory, x)
    return CascadeState(memory), _ladder(memory, reference)


def _ladder(memory: Array, reference: Reference) -> Ladder:
    thrust_n, x, y, z, q_w, q_x, q_y, q_z, p, q, r, saturated = memory[loops.THRUST :].tolist()
    return Ladder(
        position_ned_m=reference.position_ned_m,
        velocity_ned_m_s=reference.velocity_ned_m_s,
        acceleration_ned_m_s2=reference.acceleration_ned_m_s2,
        yaw_rad=reference.yaw_rad,
        ned_from_body=(q_w, q_x, q_y, q_z),
        rates_body_rad_s=(p, q, r),
        torque_body_n_m=(x, y, z),
        thrust_n=thrust_n,
        saturated=saturated != 0.0,
    )
