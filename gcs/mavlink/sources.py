"""Rules of the fold: which of several messages carries a quantity, what is a repeat, whose clock a stamp is from."""

from __future__ import annotations

import math

from models.frames import Quaternion, quaternion_from_euler

# A stamp this large counts from 1970, not from boot (3 years of uptime).
UNIX_STAMP_S = 1e8
# Slow sensors are repeated in every HIGHRES_IMU; an unchanged value counts as measured again only after this long.
REPEAT_S = 0.15
# A better source is taken for dead, and the next best heard, after this long.
SOURCE_ALIVE_S = 1.0


def boot_time_s(stamp_s: float, arrival_s: float) -> float:
    """Measurement time on the vehicle's boot clock [s]; the arrival where a stamp is missing or counts from 1970."""
    return stamp_s if 0.0 < stamp_s < UNIX_STAMP_S else arrival_s


def euler_to_quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Attitude quaternion w, x, y, z of 3-2-1 Euler angles [rad]."""
    w, x, y, z = quaternion_from_euler(roll_rad, pitch_rad, yaw_rad).tolist()
    return (w, x, y, z)


class SourceChoice:
    """Which of several messages carries a quantity: the one ranked lowest that has been heard lately."""

    __slots__ = ("_alive_s", "_heard_s", "_rank")

    def __init__(self, alive_s: float = SOURCE_ALIVE_S) -> None:
        self._alive_s = alive_s
        self._rank = 255
        self._heard_s = -math.inf

    def takes(self, rank: int, arrival_s: float) -> bool:
        """True if a message of this rank is the one to use now."""
        if rank > self._rank and arrival_s - self._heard_s <= self._alive_s:
            return False
        self._rank = rank
        self._heard_s = arrival_s
        return True


class RepeatFilter:
    """Tells a new measurement from a value that is merely sent again."""

    __slots__ = ("_time_s", "_values")

    def __init__(self) -> None:
        self._values: tuple[float, ...] = ()
        self._time_s = -math.inf

    def is_new(self, values: tuple[float, ...], time_s: float) -> bool:
        """True if ``values`` changed, or were last taken more than REPEAT_S ago."""
        if values == self._values and abs(time_s - self._time_s) < REPEAT_S:
            return False
        self._values = values
        self._time_s = time_s
        return True


class FoldPart:
    """Base of the parts of the fold: remembers whether the message in hand held a value no sensor can give."""

    def __init__(self) -> None:
        self.found_bad = False

    def all_finite(self, *values: float) -> bool:
        """True if every value is a number; otherwise the message in hand counts as bad."""
        if math.isfinite(sum(values)):
            return True
        self.found_bad = True
        return False


class TextAssembly:
    """Puts together the chunks of long STATUSTEXT messages; a lost chunk shows as an ellipsis, never as silence."""

    __slots__ = ("_chunks", "_id", "_severity")

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._chunks: dict[int, str] = {}

    def add(self, severity: int, text: bytes, text_id: int, chunk: int) -> list[tuple[int, str]]:
        """The (severity, text) pairs completed by one message, oldest first."""
        part, terminator, _ = text.partition(b"\0")
        decoded = part.decode("utf-8", errors="replace")
        if text_id == 0:
            return [*self._finish(), (severity, decoded)]
        done = self._finish() if text_id != self._id or chunk in self._chunks else []
        self._id, self._severity = text_id, severity
        self._chunks[chunk] = decoded
        if terminator:
            done += self._finish()
        return done

    def _finish(self) -> list[tuple[int, str]]:
        if not self._chunks:
            return []
        text = "".join(self._chunks.get(chunk, "…") for chunk in range(max(self._chunks) + 1))
        self._chunks = {}
        return [(self._severity, text)]
