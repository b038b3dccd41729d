"""Typed commands: one path for browser, command line and scripts; the flight process accepts each or says why not."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from gcs.offboard.trajectories import Trajectory

ControllerKind = Literal["lqr", "pid"]
Why = Annotated[str, msgspec.Meta(max_length=200)]


class Command(msgspec.Struct, frozen=True, tag_field="type", forbid_unknown_fields=True):
    """Base of all commands."""


class TakeControls(Command, frozen=True, tag="take_controls"):
    """Ask for the lease; granted when nobody else holds it."""


class ReleaseControls(Command, frozen=True, tag="release_controls"):
    """Give the lease back; the vehicle is told to hold first if we fly it."""


class KeepControls(Command, frozen=True, tag="keep_controls"):
    """Heartbeat of the holder: five silent seconds lose the lease."""


class Arm(Command, frozen=True, tag="arm"):
    """Arm the motors, through the actions process."""


class Disarm(Command, frozen=True, tag="disarm"):
    """Disarm; in the air only with ``force`` and a second confirmation."""

    force: bool = False
    confirmed: bool = False


class TakeOff(Command, frozen=True, tag="take_off"):
    """Arm if needed and let the vehicle's own autopilot climb to a height [m]."""

    height_m: Annotated[float, msgspec.Meta(ge=0.5, le=100.0)] = 2.5


class StartOffboard(Command, frozen=True, tag="start_offboard"):
    """Stream setpoints, then ask the vehicle for OFFBOARD."""


class Hold(Command, frozen=True, tag="hold"):
    """Stop steering and let the vehicle hold where it is. Open to every operator without the lease."""


class Land(Command, frozen=True, tag="land"):
    """Land where it is. Open to every operator without the lease."""


class FlyTrajectory(Command, frozen=True, tag="fly_trajectory"):
    """Replace the trajectory; it starts at the present reference."""

    trajectory: Trajectory


class SelectController(Command, frozen=True, tag="select_controller"):
    """Change between the LQR and the PI/PID cascade, bumpless."""

    controller: ControllerKind
    why: Why = ""


class ApplyGains(Command, frozen=True, tag="apply_gains"):
    """Change entries of the gain set in use, by key of the gain table; bumpless, all or nothing."""

    changes: dict[str, float]
    why: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]


class SelectGainSet(Command, frozen=True, tag="select_gain_set"):
    """Load a named gain set, such as ``published``."""

    name: str
    why: Why = ""


class UndoGains(Command, frozen=True, tag="undo_gains"):
    """Go back to the gain set before the last change."""

    why: Why = ""


class LastGoodGains(Command, frozen=True, tag="last_good_gains"):
    """Go back to the newest gain set that flew without tripping a limit."""


class MarkEvent(Command, frozen=True, tag="mark_event"):
    """Write a note into the recording."""

    note: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]


AnyCommand = (
    TakeControls
    | ReleaseControls
    | KeepControls
    | Arm
    | Disarm
    | TakeOff
    | StartOffboard
    | Hold
    | Land
    | FlyTrajectory
    | SelectController
    | ApplyGains
    | SelectGainSet
    | UndoGains
    | LastGoodGains
    | MarkEvent
)


class Identity(msgspec.Struct, frozen=True):
    """Who asks: name shown to others, role, and the client (a browser session, ``cli``, a script)."""

    name: str
    role: Literal["observer", "operator"]
    client: str


class Request(msgspec.Struct, frozen=True):
    """A command on its way in; ``number`` comes back in the answer, ``utc_s`` is when it was given."""

    number: int
    identity: Identity
    command: AnyCommand
    utc_s: float


class Answer(msgspec.Struct, frozen=True):
    """Accepted, or refused with cause and remedy."""

    number: int
    accepted: bool
    reason: str = ""
