"""From reference to setpoint: the trajectory, the cascade and the authority, in one place."""

from __future__ import annotations

from msgspec.structs import replace

from controllers import flight_controller
from controllers.authority import project
from controllers.cascade import CascadeLimits, Command, hover_command
from controllers.law import CascadeLaw
from gcs.offboard.modes import State
from gcs.offboard.state import Manoeuvre, OffboardConfig, OffboardState, Turn
from gcs.offboard.trajectories import Hover, describe, evaluate
from models.estimate import Estimate, Reference
from models.setpoints import Setpoint

TILT_LIMITS = CascadeLimits()


def relawed(state: OffboardState, config: OffboardConfig) -> OffboardState:
    """The live gain set put to work, bumpless: the new law is seeded so that it asks for what was asked last."""
    live = state.ledger.live
    law = flight_controller.prepare(live.gain_set, config.parameters)
    if state.flight is None or state.estimate is None or state.reference is None:
        return replace(state, law=law)
    flight = flight_controller.switch_to(
        state.flight, law, state.estimate, state.reference, gain_set_number=live.record.number
    )
    return replace(state, law=law, flight=flight)


def steer(state: OffboardState, turn: Turn) -> tuple[OffboardState, Setpoint | None]:
    """One step of trajectory and controller, if we steer; None when nothing may be sent."""
    if state.state not in (State.STREAMING, State.ACTIVE) or state.estimate is None:
        return state, None
    estimate, config = state.estimate, turn.config
    manoeuvre, reference = _advanced(state.manoeuvre, turn)
    flight = state.flight
    if flight is None or state.state is State.STREAMING:
        # The vehicle does not follow us yet: integrals must not wind up on its own controller's errors.
        number = state.ledger.live.record.number
        last = _present_command(state.law, estimate)
        flight = flight_controller.engage(state.law, estimate, reference, gain_set_number=number, last=last)
    flight, ladder = flight_controller.step(flight, estimate, reference, limits=TILT_LIMITS)
    setpoint = project(ladder, estimate, config.vehicle.authority, config.scales)
    return replace(state, manoeuvre=manoeuvre, reference=reference, flight=flight, ladder=ladder), setpoint


def _present_command(law: CascadeLaw, estimate: Estimate) -> Command:
    """What holds the vehicle as it is: its present tilt, which leans against the wind, and its weight."""
    hover = hover_command(law.vehicle)
    roll, pitch, _ = estimate.euler_rad
    return Command((roll, pitch), hover.thrust_n, hover.torque_n_m)


def _advanced(manoeuvre: Manoeuvre, turn: Turn) -> tuple[Manoeuvre, Reference]:
    """The manoeuvre with its progress, and the reference, now; a manoeuvre that is complete turns into hover."""
    reference, progress, lap = evaluate(manoeuvre.trajectory, turn.t_s - manoeuvre.started_s, manoeuvre.start)
    if progress is not None and progress >= 1.0:
        turn.say("advisory", f"{describe(manoeuvre.trajectory)} complete.", "manoeuvre")
        at_rest = Reference(position_ned_m=reference.position_ned_m, yaw_rad=reference.yaw_rad)
        return Manoeuvre(trajectory=Hover(), start=at_rest, started_s=turn.t_s), reference
    if progress == manoeuvre.progress and lap == manoeuvre.lap:
        return manoeuvre, reference
    return replace(manoeuvre, progress=progress, lap=lap), reference
