"""Carrying out the mode table: the one place where the state changes."""

from __future__ import annotations

import math

from msgspec.structs import replace

from estimators import full_state_ekf
from gcs.offboard.modes import Action, Event, State, after
from gcs.offboard.state import Manoeuvre, OffboardState, Turn
from gcs.records import Level
from models.estimate import Reference

# How loud an event is that changes the state, and the sentence for it.
SENTENCES: dict[Event, tuple[Level, str]] = {
    Event.LINK_UP: ("advisory", "Vehicle on the link."),
    Event.LINK_LOST: ("warning", "Link lost. The vehicle acts by its own failsafe."),
    Event.REBOOT: ("warning", "Vehicle clock jumped back: rebooted. Estimate reset."),
    Event.START: ("advisory", "Setpoints stream, asking for offboard."),
    Event.OFFBOARD_ENTERED: ("advisory", "Offboard: the vehicle follows our setpoints."),
    Event.OFFBOARD_REFUSED: ("caution", "Offboard refused by the vehicle. See its message above."),
    Event.OFFBOARD_LEFT: ("warning", "Vehicle left offboard: released to the pilot."),
    Event.DISARMED: ("advisory", "Vehicle disarmed."),
    Event.POSITION_LOST: ("warning", "Position lost. Vehicle told to land."),
    Event.ESTIMATE_STALE: ("warning", "No estimate for 0.1 s. Vehicle told to land."),
    Event.LIMIT_BREACHED: ("warning", "Flight limit passed. Vehicle told to hold."),
    Event.HOLD: ("advisory", "Hold commanded."),
    Event.LAND: ("advisory", "Land commanded."),
}


# What the strip shows as the failsafe that acts, until the state changes again.
FAILSAFES: dict[Event, str] = {
    Event.LINK_LOST: "Failsafe expected: hold",
    Event.POSITION_LOST: "Position lost: landing",
    Event.ESTIMATE_STALE: "No estimate: landing",
    Event.LIMIT_BREACHED: "Limit passed: hold",
}


def transition(state: OffboardState, event: Event, turn: Turn, who: str = "", detail: str = "") -> OffboardState:
    """The state after an event: table cell, its actions, and one sentence if anything changed."""
    cell = after(state.state, event)
    changed = cell.state is not state.state
    if changed or cell.actions:
        level, sentence = SENTENCES[event]
        turn.say(level if changed else "advisory", detail + " " + sentence if detail else sentence, "modes", who)
    for action in cell.actions:
        state = _act(state, action, turn)
    if not changed:
        return state
    steers = cell.state in (State.STREAMING, State.ACTIVE)
    return replace(
        state,
        state=cell.state,
        state_since_s=turn.t_s,
        failsafe=FAILSAFES.get(event, ""),
        offboard_asked_s=math.nan,
        offboard_tries=0,
        reference=state.reference if steers else None,
        flight=state.flight if steers else None,
        ladder=state.ladder if steers else None,
    )


def _act(state: OffboardState, action: Action, turn: Turn) -> OffboardState:
    match action:
        case Action.PREPARE:
            return prepared(state, turn.t_s)
        case Action.RESET_ESTIMATOR:
            return replace(state, ekf=full_state_ekf.initial(turn.config.ekf), estimate=None)
        case Action.SEND_HOLD:
            turn.modes.append("hold")
            return state
        case Action.SEND_LAND:
            turn.modes.append("land")
            return state


def prepared(state: OffboardState, t_s: float) -> OffboardState:
    """Reference at the present estimate, coming to rest from the present velocity; the controller is seeded there."""
    estimate = state.estimate
    assert estimate is not None, "offboard starts only with an estimate (preflight)"
    start = Reference(
        position_ned_m=estimate.position_ned_m,
        velocity_ned_m_s=estimate.velocity_ned_m_s,
        yaw_rad=estimate.euler_rad[2],
    )
    return replace(state, manoeuvre=Manoeuvre(start=start, started_s=t_s), reference=start, flight=None, ladder=None)
