"""The controller in flight: LQR or PI/PID with its gain set, and the bumpless change between any two of them."""

from __future__ import annotations

from dataclasses import dataclass

from controllers import cascade
from controllers.cascade import CascadeLimits, CascadeState, Command, hover_command
from controllers.gains import GainSet, LqrWeights
from controllers.law import CascadeLaw
from controllers.lqr import lqr_law
from controllers.pi import pid_law
from models.estimate import Estimate, Reference
from models.parameters import QuadrotorParameters
from models.setpoints import Ladder


@dataclass(frozen=True, slots=True)
class FlightControllerState:
    """Law in use, the number of its gain set in the history, and the memory of the cascade."""

    law: CascadeLaw
    gain_set_number: int
    cascade: CascadeState


def prepare(gain_set: GainSet, parameters: QuadrotorParameters) -> CascadeLaw:
    """Design a gain set for a vehicle: the costly part (Riccati equations), to be done away from the flight thread.

    Raises numpy.linalg.LinAlgError if an LQR loop cannot be designed.
    """
    if isinstance(gain_set, LqrWeights):
        return lqr_law(gain_set, parameters)
    return pid_law(gain_set, parameters)


def engage(
    law: CascadeLaw,
    estimate: Estimate,
    reference: Reference,
    *,
    gain_set_number: int,
    last: Command | None = None,
) -> FlightControllerState:
    """Take over from somebody else, who last commanded ``last`` (hover if unknown), without a jump."""
    memory = cascade.seed(law, estimate, reference, last or hover_command(law.vehicle))
    return FlightControllerState(law, gain_set_number, memory)


def switch_to(
    state: FlightControllerState,
    law: CascadeLaw,
    estimate: Estimate,
    reference: Reference,
    *,
    gain_set_number: int,
) -> FlightControllerState:
    """Change controller or gains in flight: the next step at this estimate asks for exactly the last command."""
    memory = cascade.seed(law, estimate, reference, state.cascade.command, outer_active=state.cascade.outer_active)
    return FlightControllerState(law, gain_set_number, memory)


def step(
    state: FlightControllerState,
    estimate: Estimate,
    reference: Reference,
    *,
    limits: CascadeLimits,
    tilt_reference_rad: tuple[float, float] | None = None,
) -> tuple[FlightControllerState, Ladder]:
    """One step of the law in use; see :func:`controllers.cascade.step`."""
    memory, ladder = cascade.step(
        state.cascade, estimate, reference, law=state.law, limits=limits, tilt_reference_rad=tilt_reference_rad
    )
    return FlightControllerState(state.law, state.gain_set_number, memory), ladder
