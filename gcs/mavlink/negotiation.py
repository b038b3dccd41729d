"""What the station asks of a vehicle once: message rates and single messages, one question at a time, politely.

COMMAND_ACK names the command but not what it was about, so the next question waits for the answer to the last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.mavlink.dialect import message_name

SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
RESULT_ACCEPTED = 0
RESULT_TEMPORARILY_REJECTED = 1
RESULT_FAILED = 4
RESULT_IN_PROGRESS = 5
RESULT_NAMES = ("accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress", "cancelled")

ANSWER_TIMEOUT_S = 0.5
RATE_TRIES = 5
# Home and origin exist only once the vehicle knows where it is: ask on, slowly, for five minutes.
MESSAGE_TRIES = 60
RETRY_S = 5.0
# A rate counts as granted, whatever the answer, when this share of it is seen.
SEEN_SHARE = 0.8


@dataclass(frozen=True, slots=True)
class Question:
    """A command the vehicle is to be sent: number and its first two parameters."""

    command: int
    parameters: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Refusal:
    """Something the vehicle did not grant: ``reason`` is the name of its answer, or ``no answer``."""

    message: str
    rate_hz: float | None
    reason: str


@dataclass(slots=True)
class _Item:
    message_id: int
    rate_hz: float | None
    tries: int = 0
    due_s: float = 0.0
    done: bool = False

    def question(self) -> Question:
        if self.rate_hz is None:
            return Question(REQUEST_MESSAGE, (float(self.message_id), 0.0))
        interval_us = 1e6 / self.rate_hz if self.rate_hz > 0.0 else -1.0
        return Question(SET_MESSAGE_INTERVAL, (float(self.message_id), interval_us))


class Negotiation:
    """Asks for ``rates_hz`` (message id to Hz, 0 is off) and for single ``messages``; times are vehicle seconds."""

    def __init__(self, rates_hz: Mapping[int, float], messages: tuple[int, ...]) -> None:
        self._items = [_Item(message_id, rate_hz) for message_id, rate_hz in rates_hz.items()]
        self._items += [_Item(message_id, None) for message_id in messages]
        self._asked: _Item | None = None
        self._answer_due_s = 0.0
        self.refusals: list[Refusal] = []

    @property
    def finished(self) -> bool:
        """True when every question is granted or given up."""
        return all(item.done for item in self._items)

    def restart(self) -> None:
        """Ask everything again: the vehicle has rebooted and forgotten."""
        for item in self._items:
            item.tries, item.due_s, item.done = 0, 0.0, False
        self._asked = None

    def seen(self, message_id: int) -> None:
        """A message has arrived: whoever asked for it once has it."""
        for item in self._items:
            if item.message_id == message_id and item.rate_hz is None:
                item.done = True
                if self._asked is item:
                    self._asked = None

    def poll(self, now_s: float, rates_seen_hz: Mapping[int, float]) -> Question | None:
        """The question to send now, None if one is unanswered or none is due."""
        if self._asked is not None:
            if now_s < self._answer_due_s:
                return None
            self._retry_or_give_up(self._asked, now_s, "no answer", rates_seen_hz)
        for item in self._items:
            if not item.done and now_s >= item.due_s:
                item.tries += 1
                self._asked, self._answer_due_s = item, now_s + ANSWER_TIMEOUT_S
                return item.question()
        return None

    def answered(self, command: int, result: int, now_s: float) -> None:
        """A COMMAND_ACK addressed to us has arrived."""
        item = self._asked
        if item is None or item.question().command != command or result == RESULT_IN_PROGRESS:
            return
        if result == RESULT_ACCEPTED and item.rate_hz is not None:
            item.done = True
            self._asked = None
        elif result == RESULT_ACCEPTED:
            # The message itself settles it; if it was lost, ask again.
            self._asked = None
            item.due_s = now_s + RETRY_S
        else:
            name = RESULT_NAMES[result] if result < len(RESULT_NAMES) else f"result {result}"
            later = result in (RESULT_TEMPORARILY_REJECTED, RESULT_FAILED)
            self._retry_or_give_up(item, now_s + (RETRY_S if later else 0.0), name, {}, final=not later)

    def _retry_or_give_up(
        self, item: _Item, due_s: float, reason: str, rates_seen_hz: Mapping[int, float], *, final: bool = False
    ) -> None:
        self._asked = None
        item.due_s = due_s
        if item.rate_hz is not None and rates_seen_hz.get(item.message_id, 0.0) >= SEEN_SHARE * item.rate_hz > 0.0:
            item.done = True
        elif final or item.tries >= (MESSAGE_TRIES if item.rate_hz is None else RATE_TRIES):
            item.done = True
            self.refusals.append(Refusal(message_name(item.message_id), item.rate_hz, reason))
        elif reason == "no answer":
            # Silence to one question must not hold up the others.
            item.due_s = due_s + ANSWER_TIMEOUT_S * item.tries
