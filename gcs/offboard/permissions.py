"""Who may do what, and when: the permission table and the lease of the controls, checked in the flight process."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
from msgspec.structs import replace

from gcs import commands as c
from gcs.offboard.modes import State

# A holder who is silent this long (vehicle time) loses the controls.
LEASE_TIMEOUT_S = 5.0

CONNECTED = frozenset(State) - {State.DISCONNECTED}
ANY = frozenset(State)
READY = frozenset({State.STANDBY, State.RELEASED, State.DEGRADED})
STEERING = frozenset({State.STREAMING, State.ACTIVE})


@dataclass(frozen=True, slots=True)
class Rule:
    """What a command needs: the lease or not, the states it is allowed in, and what to say outside of them."""

    needs_lease: bool
    states: frozenset[State]
    otherwise: str = ""


_NO_VEHICLE = "No vehicle on the link. Check the link URL and that the vehicle is powered."

RULES: dict[type[c.Command], Rule] = {
    c.TakeControls: Rule(False, ANY),
    c.KeepControls: Rule(False, ANY),
    c.ReleaseControls: Rule(True, ANY),
    c.Arm: Rule(True, READY, "Arming goes through the vehicle's own modes. Press Hold first."),
    c.Disarm: Rule(True, CONNECTED, _NO_VEHICLE),
    c.TakeOff: Rule(True, READY, "Take-off is flown by the vehicle. Press Hold first."),
    c.StartOffboard: Rule(True, READY, "Already streaming setpoints."),
    c.Hold: Rule(False, CONNECTED, _NO_VEHICLE),
    c.Land: Rule(False, CONNECTED, _NO_VEHICLE),
    c.FlyTrajectory: Rule(True, STEERING, "Manoeuvres are flown in offboard. Start offboard first."),
    c.SelectController: Rule(True, ANY),
    c.ApplyGains: Rule(True, ANY),
    c.SelectGainSet: Rule(True, ANY),
    c.UndoGains: Rule(True, ANY),
    c.LastGoodGains: Rule(True, ANY),
    c.MarkEvent: Rule(False, ANY),
}


class Lease(msgspec.Struct, frozen=True):
    """Who holds the controls: name and client, and when they were last heard (vehicle time)."""

    name: str = ""
    client: str = ""
    heard_s: float = 0.0

    @property
    def held(self) -> bool:
        return self.client != ""

    def held_by(self, identity: c.Identity) -> bool:
        return self.client == identity.client and self.name == identity.name


def refusal(command: c.AnyCommand, identity: c.Identity, lease: Lease, state: State) -> str:
    """Why this command is refused, or an empty string. Order: role, state, lease."""
    rule = RULES[type(command)]
    if identity.role != "operator":
        return "Observers may only watch. Sign in as operator."
    if state not in rule.states:
        return _NO_VEHICLE if state is State.DISCONNECTED else rule.otherwise
    if rule.needs_lease and not lease.held_by(identity):
        return f"{lease.name} holds the controls. Ask for them first." if lease.held else "Take controls first."
    return ""


def heard(lease: Lease, identity: c.Identity, t_s: float) -> Lease:
    """The lease after anything came from an identity: its holder is alive."""
    return replace(lease, heard_s=t_s) if lease.held_by(identity) else lease


def expired(lease: Lease, t_s: float) -> bool:
    """True when the holder has been silent for longer than the lease lasts."""
    return lease.held and t_s - lease.heard_s > LEASE_TIMEOUT_S
