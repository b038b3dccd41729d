"""Gain history: who changed what, when and why; undo and last good are one command away. Nothing is ever lost."""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from controllers.gains import GainSet, edited, kind_of, values
from gcs.commands import ControllerKind
from gcs.records import GainRecord

# A set that steered this long without tripping a limit counts as good.
GOOD_AFTER_S = 5.0


class LedgerEntry(msgspec.Struct, frozen=True):
    """One row of the history with the gain set itself."""

    record: GainRecord
    gain_set: GainSet


class GainLedger(msgspec.Struct, frozen=True):
    """All gain sets of a run, oldest first; the last entry is live. ``undo_stack`` holds indices to go back to."""

    entries: tuple[LedgerEntry, ...]
    undo_stack: tuple[int, ...] = ()
    last_good: int | None = None
    steering_since_s: float | None = None

    @property
    def live(self) -> LedgerEntry:
        return self.entries[-1]

    def newest_of(self, kind: ControllerKind) -> LedgerEntry | None:
        """The newest entry for a controller, or None if it never flew in this run."""
        return next((e for e in reversed(self.entries) if e.record.controller == kind), None)


def opened(gain_set: GainSet, name: str, utc_s: float) -> GainLedger:
    """A new ledger whose first row is the set of the vehicle file."""
    record = GainRecord(
        number=1,
        utc_s=utc_s,
        who="vehicle file",
        why="Start of session",
        controller=kind_of(gain_set),
        name=name,
        gains=values(gain_set),
        changes={},
    )
    return GainLedger((LedgerEntry(record, gain_set),))


def appended(
    ledger: GainLedger, gain_set: GainSet, *, name: str, who: str, why: str, utc_s: float, undoable: bool = True
) -> GainLedger:
    """The ledger with one more live set; ``undoable`` puts the present one on the undo stack."""
    before, after = ledger.live.record.gains, values(gain_set)
    same_kind = kind_of(gain_set) == ledger.live.record.controller
    record = GainRecord(
        number=ledger.live.record.number + 1,
        utc_s=utc_s,
        who=who,
        why=why,
        controller=kind_of(gain_set),
        name=name,
        gains=after,
        changes={k: (before[k], v) for k, v in after.items() if before.get(k) != v} if same_kind else {},
    )
    stack = (*ledger.undo_stack, len(ledger.entries) - 1) if undoable else ledger.undo_stack
    return replace(
        ledger, entries=(*ledger.entries, LedgerEntry(record, gain_set)), undo_stack=stack, steering_since_s=None
    )


def with_edits(ledger: GainLedger, changes: dict[str, float], *, who: str, why: str, utc_s: float) -> GainLedger:
    """The ledger with the live set edited; raises controllers.gains.GainError, and then nothing has changed."""
    live = ledger.live
    name = live.record.name.removesuffix(", edited") + ", edited"
    return appended(ledger, edited(live.gain_set, changes), name=name, who=who, why=why, utc_s=utc_s)


def undone(ledger: GainLedger, *, who: str, why: str, utc_s: float) -> GainLedger | None:
    """The ledger with the set before the last change live again, or None when there is nothing to undo."""
    if not ledger.undo_stack:
        return None
    target = ledger.entries[ledger.undo_stack[-1]]
    reason = why or f"Undo set {ledger.live.record.number}, back to set {target.record.number}"
    back = appended(ledger, target.gain_set, name=target.record.name, who=who, why=reason, utc_s=utc_s, undoable=False)
    return replace(back, undo_stack=ledger.undo_stack[:-1])


def steered(ledger: GainLedger, t_s: float, active: bool) -> GainLedger:
    """Keep the clock of the live set: after GOOD_AFTER_S of steering without a trip it is the last good one."""
    if not active:
        return replace(ledger, steering_since_s=None) if ledger.steering_since_s is not None else ledger
    if ledger.steering_since_s is None:
        return replace(ledger, steering_since_s=t_s)
    live = len(ledger.entries) - 1
    if t_s - ledger.steering_since_s < GOOD_AFTER_S or ledger.last_good == live:
        return ledger
    record = replace(ledger.live.record, verdict=f"Flown {GOOD_AFTER_S:.0f} s within limits")
    entries = (*ledger.entries[:-1], replace(ledger.live, record=record))
    return replace(ledger, entries=entries, last_good=live)
