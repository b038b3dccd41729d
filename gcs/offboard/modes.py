"""Modes and failsafes of the offboard controller: one table, state x event -> state and actions.

Every cell is written out, so that every cell can be read and tested. Actions are carried out by
:mod:`gcs.offboard.tick`; the vehicle's own failsafes act when we fall silent.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple


class State(IntEnum):
    """Where we stand towards the vehicle; the number is the signal ``mode.state``."""

    DISCONNECTED = 0  # no vehicle on the link
    STANDBY = 1  # connected, no setpoints
    STREAMING = 2  # setpoints flow, the vehicle is not yet in OFFBOARD
    ACTIVE = 3  # the vehicle follows our setpoints
    DEGRADED = 4  # position lost in flight: the vehicle was told to land, no setpoints
    RELEASED = 5  # the pilot took over; OFFBOARD only after a new command


class Event(Enum):
    """What can happen, from the link, the vehicle, the estimator, the limits or an operator."""

    LINK_UP = "link up"
    LINK_LOST = "link lost"
    REBOOT = "vehicle clock jumped back"
    START = "start offboard"
    OFFBOARD_ENTERED = "vehicle entered OFFBOARD"
    OFFBOARD_REFUSED = "vehicle refused OFFBOARD"
    OFFBOARD_LEFT = "vehicle left OFFBOARD"
    DISARMED = "vehicle disarmed"
    POSITION_LOST = "position lost"
    ESTIMATE_STALE = "estimate older than 100 ms"
    LIMIT_BREACHED = "flight limit breached"
    HOLD = "hold commanded"
    LAND = "land commanded"


class Action(Enum):
    """What the tick does on a transition, in this order."""

    PREPARE = "seed controller and reference for hover where we are"
    RESET_ESTIMATOR = "forget the estimate"
    SEND_HOLD = "command the vehicle's own hold mode"
    SEND_LAND = "command the vehicle's own land mode, once"


class Cell(NamedTuple):
    """Where an event leads from a state, and what to do about it."""

    state: State
    actions: tuple[Action, ...] = ()


_D, _B, _S, _A, _G, _R = (
    State.DISCONNECTED,
    State.STANDBY,
    State.STREAMING,
    State.ACTIVE,
    State.DEGRADED,
    State.RELEASED,
)

TABLE: dict[tuple[State, Event], Cell] = {
    # The link. Silence is our only answer to a dead link: the vehicle's own failsafe acts.
    (_D, Event.LINK_UP): Cell(_B, (Action.RESET_ESTIMATOR,)),
    (_B, Event.LINK_UP): Cell(_B),
    (_S, Event.LINK_UP): Cell(_S),
    (_A, Event.LINK_UP): Cell(_A),
    (_G, Event.LINK_UP): Cell(_G),
    (_R, Event.LINK_UP): Cell(_R),
    (_D, Event.LINK_LOST): Cell(_D),
    (_B, Event.LINK_LOST): Cell(_D),
    (_S, Event.LINK_LOST): Cell(_D),
    (_A, Event.LINK_LOST): Cell(_D),
    (_G, Event.LINK_LOST): Cell(_D),
    (_R, Event.LINK_LOST): Cell(_D),
    (_D, Event.REBOOT): Cell(_D, (Action.RESET_ESTIMATOR,)),
    (_B, Event.REBOOT): Cell(_B, (Action.RESET_ESTIMATOR,)),
    (_S, Event.REBOOT): Cell(_B, (Action.RESET_ESTIMATOR,)),
    (_A, Event.REBOOT): Cell(_B, (Action.RESET_ESTIMATOR,)),
    (_G, Event.REBOOT): Cell(_B, (Action.RESET_ESTIMATOR,)),
    (_R, Event.REBOOT): Cell(_B, (Action.RESET_ESTIMATOR,)),
    # Into OFFBOARD: only by command, only over STREAMING.
    (_D, Event.START): Cell(_D),
    (_B, Event.START): Cell(_S, (Action.PREPARE,)),
    (_S, Event.START): Cell(_S),
    (_A, Event.START): Cell(_A),
    (_G, Event.START): Cell(_S, (Action.PREPARE,)),
    (_R, Event.START): Cell(_S, (Action.PREPARE,)),
    (_D, Event.OFFBOARD_ENTERED): Cell(_D),
    (_B, Event.OFFBOARD_ENTERED): Cell(_B),
    (_S, Event.OFFBOARD_ENTERED): Cell(_A, (Action.PREPARE,)),
    (_A, Event.OFFBOARD_ENTERED): Cell(_A),
    (_G, Event.OFFBOARD_ENTERED): Cell(_G),
    (_R, Event.OFFBOARD_ENTERED): Cell(_R),
    (_D, Event.OFFBOARD_REFUSED): Cell(_D),
    (_B, Event.OFFBOARD_REFUSED): Cell(_B),
    (_S, Event.OFFBOARD_REFUSED): Cell(_B),
    (_A, Event.OFFBOARD_REFUSED): Cell(_A),
    (_G, Event.OFFBOARD_REFUSED): Cell(_G),
    (_R, Event.OFFBOARD_REFUSED): Cell(_R),
    # Out of OFFBOARD without our doing: the pilot, or the vehicle, has it.
    (_D, Event.OFFBOARD_LEFT): Cell(_D),
    (_B, Event.OFFBOARD_LEFT): Cell(_B),
    (_S, Event.OFFBOARD_LEFT): Cell(_S),
    (_A, Event.OFFBOARD_LEFT): Cell(_R),
    (_G, Event.OFFBOARD_LEFT): Cell(_G),
    (_R, Event.OFFBOARD_LEFT): Cell(_R),
    (_D, Event.DISARMED): Cell(_D),
    (_B, Event.DISARMED): Cell(_B),
    (_S, Event.DISARMED): Cell(_B),
    (_A, Event.DISARMED): Cell(_B),
    (_G, Event.DISARMED): Cell(_B),
    (_R, Event.DISARMED): Cell(_B),
    # What we know of the vehicle.
    (_D, Event.POSITION_LOST): Cell(_D),
    (_B, Event.POSITION_LOST): Cell(_B),
    (_S, Event.POSITION_LOST): Cell(_B),
    (_A, Event.POSITION_LOST): Cell(_G, (Action.SEND_LAND,)),
    (_G, Event.POSITION_LOST): Cell(_G),
    (_R, Event.POSITION_LOST): Cell(_R),
    (_D, Event.ESTIMATE_STALE): Cell(_D),
    (_B, Event.ESTIMATE_STALE): Cell(_B),
    (_S, Event.ESTIMATE_STALE): Cell(_B),
    (_A, Event.ESTIMATE_STALE): Cell(_G, (Action.SEND_LAND,)),
    (_G, Event.ESTIMATE_STALE): Cell(_G),
    (_R, Event.ESTIMATE_STALE): Cell(_R),
    # Limits: first hold by the vehicle itself; a breach that lasts lands (see gcs.offboard.limits).
    (_D, Event.LIMIT_BREACHED): Cell(_D),
    (_B, Event.LIMIT_BREACHED): Cell(_B),
    (_S, Event.LIMIT_BREACHED): Cell(_B),
    (_A, Event.LIMIT_BREACHED): Cell(_B, (Action.SEND_HOLD,)),
    (_G, Event.LIMIT_BREACHED): Cell(_G),
    (_R, Event.LIMIT_BREACHED): Cell(_R),
    # Operators. Hold and Land go out whenever there is a link to carry them.
    (_D, Event.HOLD): Cell(_D, (Action.SEND_HOLD,)),
    (_B, Event.HOLD): Cell(_B, (Action.SEND_HOLD,)),
    (_S, Event.HOLD): Cell(_B, (Action.SEND_HOLD,)),
    (_A, Event.HOLD): Cell(_B, (Action.SEND_HOLD,)),
    (_G, Event.HOLD): Cell(_B, (Action.SEND_HOLD,)),
    (_R, Event.HOLD): Cell(_R, (Action.SEND_HOLD,)),
    (_D, Event.LAND): Cell(_D, (Action.SEND_LAND,)),
    (_B, Event.LAND): Cell(_B, (Action.SEND_LAND,)),
    (_S, Event.LAND): Cell(_B, (Action.SEND_LAND,)),
    (_A, Event.LAND): Cell(_B, (Action.SEND_LAND,)),
    (_G, Event.LAND): Cell(_G, (Action.SEND_LAND,)),
    (_R, Event.LAND): Cell(_R, (Action.SEND_LAND,)),
}


def after(state: State, event: Event) -> Cell:
    """The cell of the table for an event in a state."""
    return TABLE[state, event]
