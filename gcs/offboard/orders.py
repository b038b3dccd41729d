"""Operators' commands, one by one: checked, applied between two ticks or refused with cause and remedy."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec.structs import replace

from controllers.gains import GainError, kind_of
from gcs import commands as c
from gcs.commands import Answer, Request
from gcs.offboard import gain_ledger, permissions
from gcs.offboard.gain_ledger import GainLedger
from gcs.offboard.modes import Event
from gcs.offboard.state import Manoeuvre, OffboardConfig, OffboardState, Turn
from gcs.offboard.steering import relawed
from gcs.offboard.trajectories import (
    Circle,
    FigureEight,
    GoTo,
    StepResponse,
    Trajectory,
    TrajectoryError,
    describe,
    validate,
)
from gcs.offboard.transitions import transition
from gcs.records import ActionRequest
from models.frames import euler_from_quaternion, wrap_angle

# Preflight: our attitude and the autopilot's have to agree this well before we steer.
LARGEST_ATTITUDE_DIFFERENCE_RAD = math.radians(5.0)


class Refused(Exception):
    """A command that is not carried out; the text says why and what to do."""


def obey(state: OffboardState, request: Request, turn: Turn) -> OffboardState:
    """Carry out one request or refuse it; either way it is answered and nothing is half applied."""
    state = replace(state, lease=permissions.heard(state.lease, request.identity, turn.t_s))
    reason = permissions.refusal(request.command, request.identity, state.lease, state.state)
    if not reason:
        try:
            state = _carry_out(state, request, turn)
        except (Refused, GainError, TrajectoryError) as error:
            reason = str(error)
    turn.answers.append(Answer(request.number, not reason, reason))
    if reason:
        verb = type(request.command).__name__
        turn.say("advisory", f"{verb} refused: {reason}", "commands", request.identity.name)
    return state


def _carry_out(state: OffboardState, request: Request, turn: Turn) -> OffboardState:
    who = request.identity
    match request.command:
        case c.TakeControls():
            return _take(state, who, turn)
        case c.ReleaseControls():
            if state.state in permissions.STEERING:
                state = transition(state, Event.HOLD, turn, who.name)
            turn.say("advisory", f"Controls released by {who.name}.", "controls", who.name)
            return replace(state, lease=permissions.Lease())
        case c.KeepControls():
            if not state.lease.held_by(who):
                raise Refused("You do not hold the controls.")
            return state
        case c.Arm():
            return _act(state, turn, who, "arm")
        case c.Disarm(force=force, confirmed=confirmed):
            return _disarm(state, turn, who, force, confirmed)
        case c.TakeOff(height_m=height_m):
            return _take_off(state, turn, who, height_m)
        case c.StartOffboard():
            _preflight(state)
            return transition(state, Event.START, turn, who.name)
        case c.Hold():
            return transition(state, Event.HOLD, turn, who.name)
        case c.Land():
            return transition(state, Event.LAND, turn, who.name)
        case c.FlyTrajectory(trajectory=trajectory):
            return _fly(state, trajectory, turn, who)
        case c.MarkEvent(note=note):
            turn.say("advisory", f"Mark: {note}", "mark", who.name)
            return state
        case command:
            return _change_gains(state, command, request, turn)


def _take(state: OffboardState, who: c.Identity, turn: Turn) -> OffboardState:
    if state.lease.held and not state.lease.held_by(who):
        raise Refused(f"{state.lease.name} holds the controls. Ask for them first.")
    if not state.lease.held:
        turn.say("advisory", f"Controls taken by {who.name}.", "controls", who.name)
    return replace(state, lease=permissions.Lease(who.name, who.client, turn.t_s))


def _act(
    state: OffboardState,
    turn: Turn,
    who: c.Identity,
    action: Literal["arm", "disarm", "force_disarm", "take_off"],
    height_m: float = 0.0,
) -> OffboardState:
    number = state.actions_issued + 1
    turn.actions.append(ActionRequest(number=number, action=action, who=who.name, height_m=height_m))
    return replace(state, actions_issued=number)


def _disarm(state: OffboardState, turn: Turn, who: c.Identity, force: bool, confirmed: bool) -> OffboardState:
    if state.view.in_air and not force:
        raise Refused("The vehicle is in the air. Land first.")
    if state.view.in_air and not confirmed:
        raise Refused("A forced disarm in the air drops the vehicle. Send it again with confirmed.")
    return _act(state, turn, who, "force_disarm" if force else "disarm")


def _take_off(state: OffboardState, turn: Turn, who: c.Identity, height_m: float) -> OffboardState:
    if state.view.in_air:
        raise Refused("The vehicle is already in the air.")
    limit_m = turn.config.vehicle.limits.height_max_m
    if height_m > limit_m:
        raise Refused(f"Height {height_m:.1f} m is above the limit of {limit_m:.1f} m.")
    return _act(state, turn, who, "take_off", height_m)


def _preflight(state: OffboardState) -> None:
    estimate, view = state.estimate, state.view
    if not view.in_air:
        raise Refused("The vehicle is not in the air. Take off first.")
    if estimate is None or not estimate.attitude_valid:
        raise Refused("No attitude estimate yet. Keep the vehicle still for a few seconds.")
    if not estimate.position_valid:
        raise Refused("No position estimate. Check GNSS or motion capture.")
    if view.autopilot_ned_from_body is not None:
        theirs = euler_from_quaternion(np.array(view.autopilot_ned_from_body))
        for name, ours_rad, theirs_rad in zip(("Roll", "Pitch", "Heading"), estimate.euler_rad, theirs, strict=True):
            difference = wrap_angle(ours_rad - theirs_rad)
            if abs(difference) > LARGEST_ATTITUDE_DIFFERENCE_RAD:
                raise Refused(
                    f"{name} differs from the autopilot's by {math.degrees(difference):.1f}°, limit 5°. "
                    "Check compass and declination."
                )


def _fly(state: OffboardState, trajectory: Trajectory, turn: Turn, who: c.Identity) -> OffboardState:
    validate(trajectory)
    limits, reference = turn.config.vehicle.limits, state.reference
    if reference is None:
        raise Refused("No reference yet. Wait for offboard to start.")
    height_m, reach_m = -reference.position_ned_m[2], 0.0
    match trajectory:
        case GoTo():
            height_m, reach_m = trajectory.height_m, math.hypot(trajectory.north_m, trajectory.east_m)
        case Circle() | FigureEight():
            height_m = trajectory.height_m
            reach_m = math.hypot(trajectory.centre_north_m, trajectory.centre_east_m) + trajectory.radius_m
        case StepResponse(axis="height"):
            height_m += trajectory.size
        case _:
            pass
    if height_m > limits.height_max_m:
        raise Refused(f"Height {height_m:.1f} m is above the limit of {limits.height_max_m:.1f} m.")
    if height_m <= 0.0:
        raise Refused(f"Height {height_m:.1f} m is below the ground.")
    if reach_m > limits.radius_max_m:
        raise Refused(f"Distance {reach_m:.1f} m from home is beyond the limit of {limits.radius_max_m:.1f} m.")
    turn.say("advisory", f"{describe(trajectory)} started by {who.name}.", "manoeuvre", who.name)
    return replace(state, manoeuvre=Manoeuvre(trajectory=trajectory, start=reference, started_s=turn.t_s))


def _change_gains(state: OffboardState, command: c.AnyCommand, request: Request, turn: Turn) -> OffboardState:
    ledger = _changed_ledger(state.ledger, command, request, turn.config)
    record = ledger.live.record
    turn.say("advisory", f"{_title(ledger)} set {record.number} applied by {record.who}.", "gains", record.who)
    return relawed(replace(state, ledger=ledger), turn.config)


def _title(ledger: GainLedger) -> str:
    return "LQR+I" if ledger.live.record.controller == "lqr" else "PI"


def _changed_ledger(ledger: GainLedger, command: c.AnyCommand, request: Request, config: OffboardConfig) -> GainLedger:
    who, utc_s, live = request.identity.name, request.utc_s, ledger.live
    match command:
        case c.ApplyGains(changes=changes, why=why):
            if not changes:
                raise Refused("Nothing to apply: no gain differs from the live set.")
            return gain_ledger.with_edits(ledger, changes, who=who, why=why, utc_s=utc_s)
        case c.SelectController(controller=kind, why=why):
            if kind == live.record.controller:
                raise Refused(f"{_title(ledger)} flies already.")
            newest = ledger.newest_of(kind)
            named = config.vehicle.controller.lqr_gains if kind == "lqr" else config.vehicle.controller.pid_gains
            gain_set = config.gain_sets[kind, named] if newest is None else newest.gain_set
            name = named if newest is None else newest.record.name
            reason = why or f"Change to {'LQR+I' if kind == 'lqr' else 'PI'}"
            return gain_ledger.appended(ledger, gain_set, name=name, who=who, why=reason, utc_s=utc_s)
        case c.SelectGainSet(name=name, why=why):
            kind = kind_of(live.gain_set)
            names = sorted(n for k, n in config.gain_sets if k == kind)
            if name not in names:
                raise Refused(f"No gain set '{name}' for {kind}. There are {', '.join(names)}.")
            reason = why or f"Load gain set {name}"
            return gain_ledger.appended(
                ledger, config.gain_sets[kind, name], name=name, who=who, why=reason, utc_s=utc_s
            )
        case c.UndoGains(why=why):
            back = gain_ledger.undone(ledger, who=who, why=why, utc_s=utc_s)
            if back is None:
                raise Refused("Nothing to undo: this is the first gain set.")
            return back
        case c.LastGoodGains():
            if ledger.last_good is None:
                raise Refused("No gain set has flown long enough yet to count as good.")
            good = ledger.entries[ledger.last_good]
            if good.gain_set == live.gain_set:
                raise Refused(f"Set {live.record.number} is the last good one and flies already.")
            reason = f"Last good gains, set {good.record.number}"
            return gain_ledger.appended(ledger, good.gain_set, name=good.record.name, who=who, why=reason, utc_s=utc_s)
        case _:
            raise AssertionError(f"{type(command).__name__} has a rule but no order")
