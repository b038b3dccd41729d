"""Gain history: numbered, undone one by one, nothing lost, nothing half applied."""

from __future__ import annotations

import pytest

from controllers.gains import GainError, load_gain_set, values
from gcs.offboard import gain_ledger as g

LQR = load_gain_set("lqr", "default")
PID = load_gain_set("pid", "default")
KEY = "attitude.q_roll"


def opened() -> g.GainLedger:
    return g.opened(LQR, "default", 0.0)


def edited(ledger: g.GainLedger, value: float) -> g.GainLedger:
    return g.with_edits(ledger, {KEY: value}, who="operator 1", why="test", utc_s=1.0)


def test_an_edit_is_a_new_numbered_set_with_who_when_why_old_and_new() -> None:
    before = values(LQR)[KEY]
    record = edited(opened(), before * 2).live.record
    assert (record.number, record.who, record.why, record.utc_s) == (2, "operator 1", "test", 1.0)
    assert record.changes == {KEY: (before, before * 2)}
    assert record.gains[KEY] == before * 2


def test_undo_goes_back_one_change_at_a_time_and_keeps_every_row() -> None:
    start = opened()
    first = values(LQR)[KEY]
    ledger = edited(edited(start, first * 2), first * 3)
    once = g.undone(ledger, who="operator 1", why="", utc_s=2.0)
    assert once is not None
    assert once.live.record.gains[KEY] == first * 2
    twice = g.undone(once, who="operator 1", why="", utc_s=3.0)
    assert twice is not None
    assert twice.live.gain_set == LQR
    assert g.undone(twice, who="operator 1", why="", utc_s=4.0) is None
    assert [entry.record.number for entry in twice.entries] == [1, 2, 3, 4, 5]


def test_undo_of_a_controller_switch_brings_the_controller_back() -> None:
    switched = g.appended(opened(), PID, name="default", who="operator 1", why="try", utc_s=1.0)
    assert switched.live.record.controller == "pid"
    assert switched.live.record.changes == {}
    back = g.undone(switched, who="operator 1", why="", utc_s=2.0)
    assert back is not None
    assert back.live.gain_set == LQR
    newest = back.newest_of("pid")
    assert newest is not None
    assert newest.gain_set == PID


@pytest.mark.parametrize("changes", [{KEY: -1.0}, {"attitude.q_wobble": 1.0}, {KEY: 2.0, "height.r_thrust": 1e9}])
def test_a_bad_change_applies_nothing(changes: dict[str, float]) -> None:
    ledger = opened()
    with pytest.raises(GainError):
        g.with_edits(ledger, changes, who="operator 1", why="test", utc_s=1.0)
    assert ledger == opened()


def test_a_set_is_good_only_after_it_has_flown() -> None:
    ledger = g.steered(opened(), 10.0, active=True)
    ledger = g.steered(ledger, 10.0 + 0.9 * g.GOOD_AFTER_S, active=True)
    assert ledger.last_good is None
    ledger = g.steered(ledger, 10.0 + 1.1 * g.GOOD_AFTER_S, active=True)
    assert ledger.last_good == 0
    worse = edited(ledger, 3.0)
    assert worse.last_good == 0
    interrupted = g.steered(g.steered(worse, 20.0, active=True), 22.0, active=False)
    assert interrupted.last_good == 0
    assert g.steered(interrupted, 40.0, active=True).last_good == 0
