"""Replay of a recorded .tlog: re-tick it from its stamps through our own fold and filter, and score the result.

Any .tlog will do: no vehicle file is asked for. The autopilot's HEARTBEAT chooses the sensor profile, the first fix
tells the Earth's magnetic field, and what differs from one airframe to the next (hard iron, GNSS latency, IMU biases)
is estimated in flight. Where the log holds simulation truth (SIM_STATE) our estimate and the autopilot's own are both
compared with it at its stamps; elsewhere ours is compared with the autopilot's. Truth is never fused, and calibrates
nothing but the one constant by which its own stamps are late.

Scored window: from 10 s after the filter first had a position until the end of the log, on the ground and in the air.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimators.ekf_model import GNSS_DELAY, MAGNETIC_BIAS
from estimators.ekf_parameters import ImuSampling
from estimators.full_state_ekf import EkfOutput, EkfParameters, Reset, initial, step
from gcs.mavlink.codec import Decoder, Frame, decode
from gcs.mavlink.dialect import message_name
from gcs.mavlink.messages import Heartbeat, SimState
from gcs.mavlink.tlog import TlogReader
from gcs.replay_score import Errors, Track, errors, euler_of_quaternions, fit_time_offset
from gcs.telemetry import Telemetry, vehicle_stamp_s
from models.frames import Array, Geodetic, Vec3, ned_from_geodetic
from models.samples import (
    AnySample,
    AutopilotAttitudeSample,
    AutopilotPositionSample,
    ImuSample,
    OriginSample,
)

SETTLE_S = 10.0
AUTOPILOT_INVALID = 8
AUTOPILOT_ARDUPILOT = 3
REBOOT_S = 1.0
RAD_PER_DEGE7 = math.radians(1e-7)


class ReplayError(ValueError):
    """A log that cannot be replayed; the message names the file and what it lacks."""


def recorded_parameters(autopilot: int) -> EkfParameters:
    """Filter parameters for a vehicle known only by its log.

    A small MEMS IMU on a vibrating airframe, sampled at 50-250 Hz behind the autopilot's own low-pass: 3e-3 rad/s and
    .1 m/s^2 per root hertz cover what vibration and resampling add to 1e-3 and 1e-2. GNSS receivers report position
    accuracy but rarely speed: .3 m/s. Fixes are .1-.2 s old at their stamp; .1 +- .05 s is where the search starts.
    Hard iron of some 4 uT (40 mG) is what a compass calibration typically leaves near motor leads. ArduPilot reads its
    compasses at 10 Hz and hands out the mean since the last reading, so a reading is half an interval old, 50 ms.
    """
    params = EkfParameters(
        gyro_noise=3e-3,
        accel_noise=0.1,
        gyro_bias_walk=1e-4,
        accel_bias_walk=1e-3,
        gnss_speed_std_m_s=0.3,
        gnss_delay_s=0.1,
        gnss_delay_std_s=0.05,
        magnetic_bias_std_t=4e-6,
        barometer_std_m=1.0,
    )
    if autopilot == AUTOPILOT_ARDUPILOT:
        params = replace(params, magnetometer_delay_s=0.05, imu_sampling=ImuSampling.INSTANT)
    return params


@dataclass(frozen=True, slots=True)
class ReplayReport:
    """Result of a replay. :meth:`to_json` gives the flat keys a machine reads."""

    path: str
    messages_total: int
    messages_bad: int
    ours: Errors
    autopilot: Errors
    reference: str
    time_offset_s: float | None
    duration_s: float
    scored_from_s: float | None
    scored_to_s: float | None
    origin_deg_m: tuple[float, float, float] | None
    vehicle: tuple[int, int]
    autopilot_id: int
    vehicle_type: int
    accounted: dict[str, int]
    messages: dict[str, int]
    updates: dict[str, int]
    rejected: dict[str, int]
    resets: tuple[str, ...]
    samples_dropped: int
    gnss_delay_s: float
    magnetic_bias_t: Vec3

    def to_json(self) -> dict[str, Any]:
        """Plain values: roll_rms_deg, pitch_rms_deg, heading_rms_deg, position_rms_m, autopilot_ ones, extras."""
        flat: dict[str, Any] = {"messages_total": self.messages_total, "messages_bad": self.messages_bad}
        flat.update(asdict(self.ours))
        flat.update({f"autopilot_{key}": value for key, value in asdict(self.autopilot).items()})
        rest = asdict(self)
        for used in ("messages_total", "messages_bad", "ours", "autopilot"):
            del rest[used]
        return flat | rest


@dataclass(slots=True)
class _Recording:
    """What one pass over a log collects; times on the vehicle's clock unless named otherwise."""

    estimates: list[tuple[float, ...]] = field(default_factory=list)
    origin_moves: list[tuple[float, Vec3]] = field(default_factory=list)
    attitudes: list[tuple[float, ...]] = field(default_factory=list)
    positions: list[tuple[float, ...]] = field(default_factory=list)
    gyro: list[tuple[float, ...]] = field(default_factory=list)
    truth: list[tuple[float, ...]] = field(default_factory=list)
    updates: Counter[str] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)
    resets: list[str] = field(default_factory=list)
    positioned_s: float | None = None
    dropped: int = 0

    def forget_motion(self) -> None:
        """A reboot: stamps start over, so only what follows can be scored."""
        for rows in (self.estimates, self.origin_moves, self.attitudes, self.positions, self.gyro, self.truth):
            rows.clear()
        self.positioned_s = None

    def take_sample(self, sample: AnySample) -> None:
        match sample:
            case ImuSample():
                self.gyro.append((sample.time_s, *sample.gyro_body_rad_s))
            case AutopilotAttitudeSample():
                self.attitudes.append((sample.time_s, *sample.ned_from_body))
            case AutopilotPositionSample():
                self.positions.append((sample.time_s, *sample.position_ned_m))
            case _:
                pass

    def take_output(self, output: EkfOutput) -> None:
        self.dropped += output.dropped
        for innovation in output.innovations:
            self.updates[innovation.source] += 1
            self.rejected[innovation.source] += not innovation.accepted
        for reset in output.resets:
            self.resets.append(_reset_text(reset))
            if reset.source == "origin":
                self.origin_moves.append((reset.time_s, reset.position_delta_ned_m))
        estimate = output.estimate
        if estimate is None:
            return
        if estimate.position_valid and self.positioned_s is None:
            self.positioned_s = estimate.time_s
        self.estimates.append((estimate.time_s, *estimate.position_ned_m, *estimate.ned_from_body))


def replay_log(
    path: Path,
    *,
    parameters: EkfParameters | None = None,
    declination_rad: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> ReplayReport:
    """Run the full-state filter over a .tlog and score it; ``progress`` hears the done fraction, 0 to 1.

    ``parameters`` replace the profile the HEARTBEAT would choose; ``declination_rad`` overrides the World Magnetic
    Model. The result depends on the file alone. Raises ReplayError if the log holds no vehicle or no IMU samples,
    OSError if it cannot be read.
    """
    vehicle, autopilot_id = _find_vehicle(path)
    params = recorded_parameters(autopilot_id) if parameters is None else parameters
    if declination_rad is not None:
        params = replace(params, declination_rad=declination_rad)
    size = max(path.stat().st_size, 1)
    reader = TlogReader(path)
    decoder = Decoder()
    player = _Player(vehicle, params)
    read_bytes = 0
    for utc_us, frame in _frames(reader, decoder):
        read_bytes += len(frame.raw) + 8
        if progress is not None and reader.records % 2000 == 0:
            progress(min(1.0, read_bytes / size))
        player.take(1e-6 * utc_us, frame)
    recording = player.recording
    if not recording.gyro:
        raise ReplayError(
            f"{path}: no IMU messages of vehicle {vehicle[0]}/{vehicle[1]}; "
            "record HIGHRES_IMU, or RAW_IMU of an ArduPilot vehicle, at 50 Hz or more"
        )
    telemetry, state = player.telemetry, player.state
    ours, theirs, reference, offset_s, window = _score(recording, state.origin, player.origin, player.clock_s)
    bias = state.nominal[MAGNETIC_BIAS].tolist()
    return ReplayReport(
        path=str(path),
        messages_total=player.counts.total() + decoder.bad_crc,
        messages_bad=decoder.bad_crc + telemetry.bad.total(),
        ours=ours,
        autopilot=theirs,
        reference=reference,
        time_offset_s=offset_s,
        duration_s=recording.gyro[-1][0] - recording.gyro[0][0],
        scored_from_s=window[0],
        scored_to_s=window[1],
        origin_deg_m=_degrees(state.origin),
        vehicle=vehicle,
        autopilot_id=autopilot_id,
        vehicle_type=telemetry.vehicle_type,
        accounted=player.accounted(),
        messages=dict(sorted(player.counts.items())),
        updates=dict(recording.updates),
        rejected=dict(recording.rejected),
        resets=tuple(recording.resets),
        samples_dropped=recording.dropped,
        gnss_delay_s=params.gnss_delay_s + float(state.nominal[GNSS_DELAY]),
        magnetic_bias_t=(bias[0], bias[1], bias[2]),
    )


class _Player:
    """One pass over a log: frames in, estimates into the recording.

    The vehicle's clock is that of its stamps; a packet arrived at its UTC stamp less the smallest lag of both so far.
    """

    def __init__(self, vehicle: tuple[int, int], params: EkfParameters) -> None:
        self.vehicle = vehicle
        self.params = params
        self.telemetry = Telemetry()
        self.recording = _Recording()
        self.counts: Counter[str] = Counter()
        self.truth_messages = 0
        self.state = initial(params)
        self.origin: Geodetic | None = None
        self.clock_s = math.inf
        self._newest_s = -math.inf
        self._waiting: list[AnySample] = []

    def take(self, utc_s: float, frame: Frame) -> None:
        """Fold one frame and run the filter when it brought an IMU sample."""
        self.counts[message_name(frame.message_id)] += 1
        if (frame.system, frame.component) != self.vehicle:
            return
        message = decode(frame)
        stamp_s = vehicle_stamp_s(message)
        if stamp_s is not None:
            self._set_clock(utc_s, stamp_s)
        if isinstance(message, SimState):
            self.truth_messages += 1
            self.recording.truth.append(_truth_row(utc_s, message))
            return
        arrival_s = utc_s - self.clock_s if self.clock_s < math.inf else 0.0
        for sample in self.telemetry.fold_message(frame.message_id, message, arrival_s):
            self._take_sample(sample)

    def accounted(self) -> dict[str, int]:
        """What became of every message."""
        fold = self.telemetry
        return {
            "folded": fold.folded.total(),
            "repeated": fold.repeated.total(),
            "unused": fold.unused.total(),
            "bad": fold.bad.total(),
            "truth": self.truth_messages,
            "not_of_the_vehicle": self.counts.total() - fold.messages_total - self.truth_messages,
        }

    def _set_clock(self, utc_s: float, stamp_s: float) -> None:
        if stamp_s < self._newest_s - REBOOT_S:
            self.recording.forget_motion()
            self.clock_s, self._newest_s, self.origin = math.inf, -math.inf, None
        self.clock_s = min(self.clock_s, utc_s - stamp_s)
        self._newest_s = max(self._newest_s, stamp_s)

    def _take_sample(self, sample: AnySample) -> None:
        self.recording.take_sample(sample)
        self._waiting.append(sample)
        if isinstance(sample, OriginSample):
            self.origin = Geodetic(sample.latitude_rad, sample.longitude_rad, sample.height_m)
        elif isinstance(sample, ImuSample):
            self.state, output = step(self.state, self._waiting, params=self.params)
            self.recording.take_output(output)
            self._waiting = []


def _frames(reader: TlogReader, decoder: Decoder) -> Iterator[tuple[int, Frame]]:
    """Whole frames of a log with their UTC stamps [us]; what does not decode is counted by the decoder."""
    for utc_us, packet in reader:
        for frame in decoder.feed(packet):
            yield utc_us, frame
        decoder.flush()


def _find_vehicle(path: Path) -> tuple[tuple[int, int], int]:
    """(system, component) and MAV_AUTOPILOT of the first autopilot that says HEARTBEAT."""
    for _, frame in _frames(TlogReader(path), Decoder()):
        if frame.message_id == 0:
            message = decode(frame)
            if isinstance(message, Heartbeat) and message.autopilot != AUTOPILOT_INVALID:
                return (frame.system, frame.component), message.autopilot
    raise ReplayError(f"{path}: no HEARTBEAT of a vehicle in it; is this a .tlog of a flight?")


def _truth_row(utc_s: float, m: SimState) -> tuple[float, ...]:
    """Time, rates, quaternion, geodetic position; lat and lon of this message are float32 and too coarse to use."""
    where = (m.lat_int * RAD_PER_DEGE7, m.lon_int * RAD_PER_DEGE7, m.alt)
    return (utc_s, m.xgyro, m.ygyro, m.zgyro, m.q1, m.q2, m.q3, m.q4, *where)


def _score(
    recording: _Recording, origin: Geodetic | None, autopilot_origin: Geodetic | None, clock_s: float
) -> tuple[Errors, Errors, str, float | None, tuple[float | None, float | None]]:
    """Errors of ours and of the autopilot's, what they were measured against, time offset of truth, scored window."""
    nothing = Errors(None, None, None, None)
    ours = _our_track(recording)
    autopilot = _autopilot_track(recording, origin, autopilot_origin)
    if ours is None or recording.positioned_s is None:
        return nothing, nothing, "no position estimate", None, (None, None)
    window = (recording.positioned_s + SETTLE_S, float(ours.time_s[-1]))
    if len(recording.truth) > 1 and origin is not None:
        truth_rows = np.array(recording.truth)
        gyro = np.array(recording.gyro)
        truth_s = truth_rows[:, 0] - clock_s
        offset_s = fit_time_offset(gyro[:, 0], gyro[:, 1:4], truth_s, truth_rows[:, 1:4])
        truth = Track(
            truth_s - offset_s,
            euler_of_quaternions(truth_rows[:, 4:8]),
            np.array([ned_from_geodetic(Geodetic(*row), origin) for row in truth_rows[:, 8:11].tolist()]),
        )
        theirs = nothing if autopilot is None else errors(autopilot, truth, *window)
        return errors(ours, truth, *window), theirs, "SIM_STATE", offset_s, window
    if autopilot is None:
        return nothing, nothing, "nothing to compare with", None, window
    return errors(ours, autopilot, *window), nothing, "autopilot", None, window


def _our_track(recording: _Recording) -> Track | None:
    """Our estimates, all about the last local origin."""
    if not recording.estimates:
        return None
    rows = np.array(recording.estimates)
    position = rows[:, 1:4].copy()
    for moved_s, delta in recording.origin_moves:
        position[rows[:, 0] < moved_s] += delta
    if recording.positioned_s is not None:
        position[rows[:, 0] < recording.positioned_s] = np.nan
    return Track(rows[:, 0], euler_of_quaternions(rows[:, 4:8]), position)


def _autopilot_track(recording: _Recording, origin: Geodetic | None, autopilot_origin: Geodetic | None) -> Track | None:
    """The autopilot's own attitude, and its position about our origin, on the stamps of its attitude."""
    if len(recording.attitudes) < 2:
        return None
    attitude = np.array(recording.attitudes)
    _, keep = np.unique(attitude[:, 0], return_index=True)
    attitude = attitude[keep]
    position = np.full((attitude.shape[0], 3), np.nan)
    if len(recording.positions) > 1:
        rows = np.array(recording.positions)
        shift: Array = np.zeros(3)
        if origin is not None and autopilot_origin is not None:
            shift = np.array(ned_from_geodetic(autopilot_origin, origin))
        inside = (attitude[:, 0] >= rows[0, 0]) & (attitude[:, 0] <= rows[-1, 0])
        for axis in range(3):
            position[inside, axis] = np.interp(attitude[inside, 0], rows[:, 0], rows[:, 1 + axis]) + shift[axis]
    return Track(attitude[:, 0], euler_of_quaternions(attitude[:, 1:5]), position)


def _reset_text(reset: Reset) -> str:
    moved = math.hypot(*reset.position_delta_ned_m)
    turned = math.degrees(reset.yaw_delta_rad)
    return f"{reset.time_s:.2f} s {reset.source}: {reset.reason} ({moved:.2f} m, {turned:.1f} deg)"


def _degrees(origin: Geodetic | None) -> tuple[float, float, float] | None:
    if origin is None:
        return None
    return math.degrees(origin.latitude_rad), math.degrees(origin.longitude_rad), origin.height_m
