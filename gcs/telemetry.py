"""The fold of a vehicle's messages into samples: the one place where wire units become SI and radians.

A fold belongs to one vehicle and one autopilot. Every frame is accounted for by message name: folded into samples, a
repeat or without a value, not used, or bad (not finite). Where a vehicle sends the same quantity in several messages,
the best source wins while it is alive.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from gcs.mavlink import messages as wire
from gcs.mavlink.codec import Frame, decode
from gcs.mavlink.dialect import message_name
from gcs.mavlink.fold_measurements import S_PER_MS, S_PER_US, MeasurementFold
from gcs.mavlink.fold_states import StateFold
from gcs.mavlink.modes import AUTOPILOT_UNKNOWN
from gcs.mavlink.sources import UNIX_STAMP_S
from models.samples import AnySample

Handler = Callable[[Any, float], list[AnySample]]


class Telemetry:
    """Folds the frames of one vehicle into samples. Each message is counted once, by name, in one of four:

    ``folded``    gave samples
    ``repeated``  said nothing new: same stamp, no fix, a better source in use, value not provided, text not complete
    ``unused``    the station has no use for it
    ``bad``       holds values no sensor can give
    """

    def __init__(self) -> None:
        self.folded: Counter[str] = Counter()
        self.repeated: Counter[str] = Counter()
        self.unused: Counter[str] = Counter()
        self.bad: Counter[str] = Counter()
        self._begin(AUTOPILOT_UNKNOWN, vehicle_type=0, has_pitot=False)

    def reset(self) -> None:
        """Forget stamps and sources from before a reboot; what the vehicle is, and the counters, stay."""
        self._begin(self.autopilot, self.vehicle_type, self._states.has_pitot)

    def _begin(self, autopilot: int, vehicle_type: int, has_pitot: bool) -> None:
        self._measurements = MeasurementFold(autopilot, has_pitot)
        self._states = StateFold(autopilot, vehicle_type, has_pitot)
        self._measurement_handlers = _measurement_handlers(self._measurements)
        self._state_handlers = _state_handlers(self._states)

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT of the last heartbeat, 0 before the first."""
        return self._states.autopilot

    @property
    def vehicle_type(self) -> int:
        """MAV_TYPE of the last heartbeat, 0 before the first."""
        return self._states.vehicle_type

    def fold(self, frame: Frame, arrival_s: float) -> list[AnySample]:
        """Samples of one frame that arrived at ``arrival_s`` on the vehicle clock; empty if it gives none."""
        return self.fold_message(frame.message_id, decode(frame), arrival_s)

    def fold_message(self, message_id: int, message: wire.Message | None, arrival_s: float) -> list[AnySample]:
        """As :meth:`fold`, for a message that has been decoded already (None if it is not on the hot path)."""
        name = message_name(message_id)
        part: MeasurementFold | StateFold = self._measurements
        handler = self._measurement_handlers.get(message_id)
        if handler is None:
            part = self._states
            handler = self._state_handlers.get(message_id)
        if handler is None or message is None:
            self.unused[name] += 1
            return []
        part.found_bad = False
        samples = handler(message, arrival_s)
        if samples:
            self.folded[name] += 1
        elif part.found_bad:
            self.bad[name] += 1
        else:
            self.repeated[name] += 1
        if part is self._states:
            self._measurements.autopilot = self._states.autopilot
            self._measurements.has_pitot = self._states.has_pitot
        return samples

    @property
    def messages_total(self) -> int:
        """All messages given to the fold."""
        return sum(counter.total() for counter in (self.folded, self.repeated, self.unused, self.bad))


def vehicle_stamp_s(message: wire.Message | None) -> float | None:
    """Time at which a vehicle sent a message, by its own boot clock [s]; None if the message does not say.

    Satellite fixes and poses are stamped with an earlier measurement time and are left out: this is for the clock.
    """
    match message:
        case wire.HighresImu(time_usec=us) | wire.RawImu(time_usec=us) | wire.ServoOutputRaw(time_usec=us):
            stamp_s = us * S_PER_US
        case (
            wire.Attitude(time_boot_ms=ms)
            | wire.AttitudeQuaternion(time_boot_ms=ms)
            | wire.LocalPositionNed(time_boot_ms=ms)
            | wire.ScaledImu(time_boot_ms=ms)
            | wire.ScaledImu2(time_boot_ms=ms)
            | wire.SystemTime(time_boot_ms=ms)
        ):
            stamp_s = ms * S_PER_MS
        case _:
            return None
    return stamp_s if 0.0 < stamp_s < UNIX_STAMP_S else None


def _measurement_handlers(fold: MeasurementFold) -> dict[int, Handler]:
    return {
        24: fold.gps_raw_int,
        26: fold.scaled_imu,
        27: fold.raw_imu,
        29: fold.scaled_pressure,
        102: fold.vision_position_estimate,
        105: fold.highres_imu,
        116: fold.scaled_imu2,
        132: fold.distance_sensor,
        138: fold.att_pos_mocap,
    }


def _state_handlers(fold: StateFold) -> dict[int, Handler]:
    return {
        0: fold.heartbeat,
        1: fold.sys_status,
        30: fold.attitude,
        31: fold.attitude_quaternion,
        32: fold.local_position_ned,
        36: fold.servo_output_raw,
        49: fold.gps_global_origin,
        77: fold.command_ack,
        147: fold.battery_status,
        242: fold.home_position,
        245: fold.extended_sys_state,
        253: fold.statustext,
        375: fold.actuator_output_status,
    }
