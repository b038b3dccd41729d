"""Every cell of the mode table, against the rules it has to keep."""

from __future__ import annotations

import itertools

import pytest

from gcs.offboard.modes import TABLE, Action, Event, State, after

STEERING = {State.STREAMING, State.ACTIVE}


def test_table_is_complete() -> None:
    assert set(TABLE) == set(itertools.product(State, Event))


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("event", Event)
def test_no_cell_steers_without_a_command(state: State, event: Event) -> None:
    cell = after(state, event)
    if cell.state in STEERING and state not in STEERING:
        assert event is Event.START
    if cell.state is State.ACTIVE and state is not State.ACTIVE:
        assert (state, event) == (State.STREAMING, Event.OFFBOARD_ENTERED)


@pytest.mark.parametrize("state", [s for s in State if s is not State.DISCONNECTED])
def test_a_dead_link_is_silence(state: State) -> None:
    assert after(state, Event.LINK_LOST) == (State.DISCONNECTED, ())


@pytest.mark.parametrize("state", State)
def test_hold_and_land_always_go_out(state: State) -> None:
    assert Action.SEND_HOLD in after(state, Event.HOLD).actions
    assert Action.SEND_LAND in after(state, Event.LAND).actions
    assert after(state, Event.HOLD).state not in STEERING
    assert after(state, Event.LAND).state not in STEERING


@pytest.mark.parametrize("state", State)
def test_land_on_lost_knowledge_only_when_we_steered(state: State) -> None:
    for event in (Event.POSITION_LOST, Event.ESTIMATE_STALE):
        assert (Action.SEND_LAND in after(state, event).actions) == (state is State.ACTIVE)
        assert after(state, event).state not in STEERING


def test_pilot_takeover_releases_and_stays_released() -> None:
    assert after(State.ACTIVE, Event.OFFBOARD_LEFT).state is State.RELEASED
    for event in set(Event) - {Event.START, Event.LINK_LOST, Event.REBOOT, Event.DISARMED}:
        assert after(State.RELEASED, event).state is State.RELEASED


@pytest.mark.parametrize("state", State)
def test_reboot_forgets(state: State) -> None:
    cell = after(state, Event.REBOOT)
    assert Action.RESET_ESTIMATOR in cell.actions
    assert cell.state in (State.STANDBY, State.DISCONNECTED)


def test_a_limit_breach_hands_over_to_the_vehicle() -> None:
    assert after(State.ACTIVE, Event.LIMIT_BREACHED) == (State.STANDBY, (Action.SEND_HOLD,))
