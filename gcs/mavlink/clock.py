"""The vehicle's clock as the ground knows it: last stamp plus elapsed ground time times the rate between the two.

Messages come late by different amounts, so the clock follows the least delayed of them: a stamp ahead of the clock sets
it at once, one behind it is taken for delay, and only a slow slide lets the clock down again. It goes on while the
vehicle is silent, which is when timeouts matter.
"""

from __future__ import annotations

# Stamps that jump back by more than this come from a vehicle that started anew.
REBOOT_JUMP_S = 1.0
# Stamps this far behind (times the rate): the vehicle's time stood still, as that of a paused simulation does.
MAX_LAG_S = 0.5
# How fast the clock may be let down towards late stamps [s/s]; crystals differ by 1e-4 at most.
SLIDE = 1e-3
RATE_WINDOW_S = 1.0
# Between these the two clocks are both real time and the rate is 1; delays would only add noise to it.
REAL_TIME_RATES = (0.9, 1.1)
RATE_LIMITS = (1e-3, 1e4)
SAME_RATE = 0.05


class VehicleClock:
    """Vehicle time from stamps and any monotonic ground clock [s]; ``rate`` fixes the rate instead of estimating it."""

    def __init__(self, rate: float | None = None) -> None:
        self._fixed = rate is not None
        self.rate = 1.0 if rate is None else rate
        self._stamp_s: float | None = None
        self._ground_s = 0.0
        self._newest_s = 0.0
        self._window: tuple[float, float] | None = None
        self._elapsed_s = 0.0
        self._elapsed_ground_s: float | None = None

    @property
    def is_set(self) -> bool:
        """True once a stamp has been seen."""
        return self._stamp_s is not None

    def time_s(self, ground_s: float) -> float:
        """Vehicle time now [s]; before the first stamp, time since this clock was first asked."""
        if self._stamp_s is None:
            return self.elapsed_s(ground_s)
        return self._stamp_s + (ground_s - self._ground_s) * self.rate

    def elapsed_s(self, ground_s: float) -> float:
        """Vehicle time passed since the clock was first asked [s]: never jumps, whatever stamps do. Timeouts use it."""
        if self._elapsed_ground_s is None:
            self._elapsed_ground_s = ground_s
        passed_s = ground_s - self._elapsed_ground_s
        if passed_s > 0.0:
            self._elapsed_s += passed_s * self.rate
            self._elapsed_ground_s = ground_s
        return self._elapsed_s

    def observe(self, stamp_s: float, ground_s: float) -> float | None:
        """Take in the stamp of a message that arrived now. Returns the previous newest stamp if this is a reboot."""
        self.elapsed_s(ground_s)
        if self._stamp_s is None:
            self._restart(stamp_s, ground_s)
            return None
        if stamp_s < self._newest_s - REBOOT_JUMP_S:
            before_s = self._newest_s
            self._restart(stamp_s, ground_s)
            return before_s
        lag_s = self.time_s(ground_s) - stamp_s
        if lag_s <= 0.0 or lag_s > MAX_LAG_S * max(1.0, self.rate):
            self._stamp_s, self._ground_s = stamp_s, ground_s
        elif stamp_s > self._newest_s:
            slide_s = min(lag_s, SLIDE * (stamp_s - self._newest_s))
            self._stamp_s, self._ground_s = self.time_s(ground_s) - slide_s, ground_s
        self._newest_s = max(self._newest_s, stamp_s)
        self._estimate_rate(ground_s)
        return None

    def _restart(self, stamp_s: float, ground_s: float) -> None:
        self._stamp_s, self._ground_s, self._newest_s = stamp_s, ground_s, stamp_s
        self._window = (stamp_s, ground_s)

    def _estimate_rate(self, ground_s: float) -> None:
        if self._fixed or self._window is None:
            return
        stamp_begin_s, ground_begin_s = self._window
        if ground_s - ground_begin_s < RATE_WINDOW_S:
            return
        measured = (self._newest_s - stamp_begin_s) / (ground_s - ground_begin_s)
        slowest, fastest = REAL_TIME_RATES
        low, high = RATE_LIMITS
        rate = 1.0 if slowest <= measured <= fastest else min(max(measured, low), high)
        # Time gained at a wrong rate is no delay of messages: begin again from the stamp.
        same = abs(rate - self.rate) <= SAME_RATE * self.rate
        self._stamp_s, self._ground_s = (self.time_s(ground_s) if same else self._newest_s), ground_s
        self.rate = rate
        self._window = (self._newest_s, ground_s)
