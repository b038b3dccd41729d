"""Role x command x state: the permission table as a test."""

from __future__ import annotations

import pytest

from gcs import commands as c
from gcs.offboard.modes import State
from gcs.offboard.permissions import LEASE_TIMEOUT_S, RULES, Lease, expired, heard, refusal
from gcs.offboard.trajectories import Hover

OPERATOR = c.Identity(name="operator 1", role="operator", client="browser-1")
SECOND = c.Identity(name="operator 2", role="operator", client="browser-2")
OBSERVER = c.Identity(name="guest", role="observer", client="browser-3")
HELD = Lease(OPERATOR.name, OPERATOR.client, 0.0)

COMMANDS: tuple[c.AnyCommand, ...] = (
    c.TakeControls(),
    c.ReleaseControls(),
    c.KeepControls(),
    c.Arm(),
    c.Disarm(),
    c.TakeOff(),
    c.StartOffboard(),
    c.Hold(),
    c.Land(),
    c.FlyTrajectory(Hover()),
    c.SelectController("pid"),
    c.ApplyGains({"a": 1.0}, "why"),
    c.SelectGainSet("published"),
    c.UndoGains(),
    c.LastGoodGains(),
    c.MarkEvent("note"),
)


def test_every_command_has_a_rule() -> None:
    assert {type(command) for command in COMMANDS} == set(RULES)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: type(command).__name__)
@pytest.mark.parametrize("state", State)
def test_observers_command_nothing(command: c.AnyCommand, state: State) -> None:
    assert "operator" in refusal(command, OBSERVER, Lease(), state)


@pytest.mark.parametrize("state", [s for s in State if s is not State.DISCONNECTED])
def test_hold_and_land_need_no_lease(state: State) -> None:
    for command in (c.Hold(), c.Land()):
        assert refusal(command, SECOND, HELD, state) == ""


@pytest.mark.parametrize("command", [k for k in COMMANDS if RULES[type(k)].needs_lease], ids=lambda k: type(k).__name__)
@pytest.mark.parametrize("state", State)
def test_the_lease_is_needed(command: c.AnyCommand, state: State) -> None:
    assert refusal(command, SECOND, HELD, state) != ""
    assert refusal(command, SECOND, Lease(), state) != ""
    allowed = state in RULES[type(command)].states
    assert (refusal(command, OPERATOR, HELD, state) == "") == allowed


def test_a_refusal_names_who_holds_the_controls() -> None:
    assert OPERATOR.name in refusal(c.Arm(), SECOND, HELD, State.STANDBY)


def test_steering_starts_from_rest_states_only() -> None:
    assert RULES[c.StartOffboard].states == {State.STANDBY, State.RELEASED, State.DEGRADED}


def test_lease_expires_only_for_a_silent_holder() -> None:
    kept = heard(HELD, OPERATOR, 10.0)
    assert not expired(kept, 10.0 + LEASE_TIMEOUT_S)
    assert expired(kept, 10.1 + LEASE_TIMEOUT_S)
    assert heard(HELD, SECOND, 10.0) == HELD
    assert not expired(Lease(), 1e9)
