"""What leaves the flight process: events, tick frames for the recorder, and the slow status for people."""

from __future__ import annotations

from typing import Literal

import msgspec

from gcs.commands import Answer, Request
from models.samples import AnySample

Level = Literal["advisory", "caution", "warning"]


class Event(msgspec.Struct, frozen=True):
    """Something that happened, worded for an operator: thing, state, number with unit, remedy."""

    t_s: float
    level: Level
    text: str
    source: str
    who: str = ""


class TickInputs(msgspec.Struct, frozen=True, array_like=True):
    """Everything that arrived since the previous tick, in arrival order. THE recording is the stream of these."""

    samples: tuple[AnySample, ...]
    requests: tuple[Request, ...] = ()
    link_alive: bool = True
    rebooted: bool = False
    link_latency_s: float = float("nan")
    link_received: float = float("nan")
    link_rate_hz: float = float("nan")
    overflow: int = 0


class ActionRequest(msgspec.Struct, frozen=True):
    """Work for the actions process (MAVSDK): accepted by the flight process on behalf of ``who``."""

    number: int
    action: Literal["arm", "disarm", "force_disarm", "take_off", "land", "hold"]
    who: str
    height_m: float = 0.0


class Packet(msgspec.Struct, frozen=True, array_like=True):
    """One raw MAVLink packet for the .tlog: UTC stamp [us], from the vehicle (True) or to it."""

    utc_us: int
    inbound: bool
    raw: bytes


class ActionResult(msgspec.Struct, frozen=True):
    """How the vehicle answered an action; ``text`` is worded for the operator."""

    number: int
    done: bool
    text: str


class FlightStart(msgspec.Struct, frozen=True, tag="start"):
    """What a run starts from, sent first and again every few seconds, so that a hub that comes later learns it too.

    ``session`` names this life of the flight process (any unique text); ``vehicle_toml`` and ``parameters_toml`` are
    the files as read, ``settings`` whatever else the first tick depends on, such as the gain sets loaded.
    """

    session: str
    utc_s: float
    vehicle_name: str
    vehicle_toml: str
    parameters_toml: str
    link_url: str
    settings: dict[str, float | str | dict[str, float]] = {}


class TickFrame(msgspec.Struct, frozen=True, tag="tick"):
    """One tick as the flight process reports it. ``signals`` is the float64 vector of :mod:`gcs.signals`.

    ``sequence`` counts the ticks of one ``session``, without a gap: a missing number is a tick that was not recorded.
    """

    sequence: int
    t_s: float
    utc_s: float
    inputs: TickInputs
    output_hash: bytes
    signals: bytes
    events: tuple[Event, ...] = ()
    answers: tuple[Answer, ...] = ()
    actions: tuple[ActionRequest, ...] = ()
    packets: tuple[Packet, ...] = ()
    session: str = ""


class GainRecord(msgspec.Struct, frozen=True):
    """One row of the gain history. ``gains`` is the flat {key: value} of the gain table."""

    number: int
    utc_s: float
    who: str
    why: str
    controller: Literal["lqr", "pid"]
    name: str
    gains: dict[str, float]
    changes: dict[str, tuple[float, float]]
    verdict: str = ""


class TrajectoryStatus(msgspec.Struct, frozen=True):
    """Manoeuvre being flown: its description, lap, progress 0..1 (None if endless), seconds left (None if endless)."""

    description: str
    lap: int | None
    progress: float | None
    left_s: float | None


class Status(msgspec.Struct, frozen=True, tag="status"):
    """The slow picture for people: published on change and at least twice a second."""

    t_s: float
    utc_s: float
    vehicle_name: str
    vehicle_type: str
    autopilot: str
    system_id: int
    authority: str
    link_url: str
    link_state: Literal["none", "live", "silent", "lost"]
    link_silence_s: float
    signing: str
    state: str
    vehicle_mode: str
    armed: bool
    landed: str
    failsafe: str
    estimator: str
    position_source: str
    controller: Literal["lqr", "pid"]
    gain_set: int
    gain_history: tuple[GainRecord, ...]
    last_good: int
    controls_holder: str
    controls_client: str
    battery_v: float
    battery_remaining: float
    flight_time_s: float
    trajectory: TrajectoryStatus
    origin_latitude_deg: float
    origin_longitude_deg: float
    ticks: int
    dropped_frames: int
    tick_p99_us: float


class RecordingStatus(msgspec.Struct, frozen=True, tag="recording"):
    """What the recorder does: run folder, its size and the room left [bytes], ticks written and missed."""

    state: Literal["off", "waiting", "recording", "stopped"]
    run: str = ""
    size_bytes: int = 0
    free_bytes: int = 0
    ticks: int = 0
    missing_ticks: int = 0
    reason: str = ""


FlightMessage = TickFrame | Status | FlightStart
