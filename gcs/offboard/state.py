"""What the offboard controller carries from tick to tick, what it is configured with, and what it hands out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from controllers.authority import VehicleScales
from controllers.flight_controller import FlightControllerState
from controllers.gains import GainSet
from controllers.law import CascadeLaw
from estimators.full_state_ekf import EkfParameters, EkfState
from gcs.commands import Answer
from gcs.config import VehicleFile
from gcs.offboard.gain_ledger import GainLedger
from gcs.offboard.modes import State
from gcs.offboard.permissions import Lease
from gcs.offboard.trajectories import Hover, Trajectory
from gcs.offboard.vehicle_view import VehicleView
from gcs.records import ActionRequest, Event, Level
from models.arrays import Array
from models.estimate import Estimate, Reference
from models.parameters import QuadrotorParameters
from models.setpoints import Ladder, Setpoint

ModeName = Literal["offboard", "hold", "land"]


@dataclass(frozen=True, slots=True)
class OffboardConfig:
    """Everything fixed for a run. ``gain_sets`` holds every named set by (kind, name), read before the first tick."""

    vehicle: VehicleFile
    parameters: QuadrotorParameters
    ekf: EkfParameters
    scales: VehicleScales
    gain_sets: dict[tuple[str, str], GainSet]


class Manoeuvre(msgspec.Struct, frozen=True):
    """The trajectory being flown, where and when it began."""

    trajectory: Trajectory = Hover()
    start: Reference = Reference(position_ned_m=(0.0, 0.0, 0.0))
    started_s: float = 0.0
    lap: int = 0
    progress: float | None = None


class OffboardState(msgspec.Struct, frozen=True):
    """State of the offboard controller between two ticks. Times are vehicle time [s]; NaN means never."""

    state: State
    ekf: EkfState
    law: CascadeLaw
    ledger: GainLedger
    view: VehicleView = VehicleView()
    lease: Lease = Lease()
    manoeuvre: Manoeuvre = Manoeuvre()
    estimate: Estimate | None = None
    reference: Reference | None = None
    flight: FlightControllerState | None = None
    ladder: Ladder | None = None
    t_s: float = math.nan
    state_since_s: float = 0.0
    offboard_asked_s: float = math.nan
    offboard_tries: int = 0
    breach_since_s: float = math.nan
    failsafe: str = ""
    actions_issued: int = 0


@dataclass(frozen=True, slots=True)
class Output:
    """What one tick hands out. ``modes`` are mode changes to command, in order; ``signals`` is the signal frame."""

    setpoint: Setpoint | None
    modes: tuple[ModeName, ...]
    events: tuple[Event, ...]
    answers: tuple[Answer, ...]
    actions: tuple[ActionRequest, ...]
    signals: Array
    hash: bytes


@dataclass(slots=True)
class Turn:
    """Scratch pad of a single tick: what has been decided so far. Never outlives the tick."""

    t_s: float
    config: OffboardConfig
    events: list[Event] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    actions: list[ActionRequest] = field(default_factory=list)
    modes: list[ModeName] = field(default_factory=list)

    def say(self, level: Level, text: str, source: str, who: str = "") -> None:
        self.events.append(Event(t_s=self.t_s, level=level, text=text, source=source, who=who))
