"""How good a link is: share of packets received, message rates, round trip, over windows of one vehicle second."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from gcs.mavlink.codec import Decoder, SourceCount
from gcs.mavlink.dialect import message_name

WINDOW_S = 1.0


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """State of a link. Rates and ``received_fraction`` are of the last full window; NaN before there is one.

    ``heartbeat_age_s`` is None before a vehicle is found; ``round_trip_s`` is NaN before the first answer.
    """

    alive: bool
    heartbeat_age_s: float | None
    received_fraction: float
    messages_per_s: float
    round_trip_s: float
    rates_hz: dict[str, float]
    received: int
    lost: int
    bad_bytes: int
    bad_checksums: int


class LinkQuality:
    """Counts the messages of one vehicle in windows."""

    def __init__(self) -> None:
        self.round_trip_s = math.nan
        self.rates_hz: dict[int, float] = {}
        self._messages_per_s = math.nan
        self._received_fraction = math.nan
        self._counts: Counter[int] = Counter()
        self._begin_s: float | None = None
        self._begin_received = 0
        self._begin_lost = 0

    def count(self, message_id: int) -> None:
        """One message of the vehicle has arrived."""
        self._counts[message_id] += 1

    def advance(self, now_s: float, source: SourceCount | None) -> None:
        """Close the window if it is over; ``now_s`` is vehicle time, ``source`` the vehicle's sequence count."""
        if source is None:
            return
        if self._begin_s is None:
            self._open(now_s, source)
            return
        length_s = now_s - self._begin_s
        if length_s < WINDOW_S:
            return
        received, lost = source.received - self._begin_received, source.lost - self._begin_lost
        self.rates_hz = {message_id: count / length_s for message_id, count in self._counts.items()}
        self._messages_per_s = received / length_s
        self._received_fraction = received / (received + lost) if received else 0.0
        self._open(now_s, source)

    def _open(self, now_s: float, source: SourceCount) -> None:
        self._begin_s = now_s
        self._begin_received, self._begin_lost = source.received, source.lost
        self._counts.clear()

    def status(
        self, alive: bool, heartbeat_age_s: float | None, source: SourceCount | None, decoder: Decoder
    ) -> LinkStatus:
        """The whole of it."""
        return LinkStatus(
            alive=alive,
            heartbeat_age_s=heartbeat_age_s,
            received_fraction=self._received_fraction,
            messages_per_s=self._messages_per_s,
            round_trip_s=self.round_trip_s,
            rates_hz={message_name(message_id): rate for message_id, rate in self.rates_hz.items()},
            received=source.received if source else 0,
            lost=source.lost if source else 0,
            bad_bytes=decoder.bad_bytes,
            bad_checksums=decoder.bad_crc,
        )
