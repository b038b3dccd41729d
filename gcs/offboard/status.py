"""The slow picture for people, from the state of the offboard controller and of the link."""

from __future__ import annotations

import math
from typing import Literal

from gcs.mavlink.link_quality import LinkStatus
from gcs.offboard.modes import State
from gcs.offboard.state import OffboardConfig, OffboardState
from gcs.offboard.trajectories import GoTo, StepResponse, describe
from gcs.records import Status, TrajectoryStatus

AUTOPILOT_WORDS = {3: "ArduPilot", 12: "PX4"}
LINK_SILENT_S = 1.0
LINK_LOST_S = 3.0
STATE_WORDS = {
    State.DISCONNECTED: "Disconnected",
    State.STANDBY: "Standby",
    State.STREAMING: "Streaming",
    State.ACTIVE: "Offboard",
    State.DEGRADED: "Degraded",
    State.RELEASED: "Released",
}


def link_state(link: LinkStatus, silence_s: float) -> Literal["none", "live", "silent", "lost"]:
    """In words: no vehicle yet, live, silent for a second, lost for three."""
    if link.heartbeat_age_s is None:
        return "none"
    if silence_s >= LINK_LOST_S or not link.alive:
        return "lost"
    return "silent" if silence_s >= LINK_SILENT_S else "live"


def station_status(
    state: OffboardState,
    link: LinkStatus,
    config: OffboardConfig,
    *,
    t_s: float,
    utc_s: float,
    silence_s: float,
    link_url: str,
    system_id: int,
    dropped_frames: int,
    ticks: int,
    tick_p99_us: float,
) -> Status:
    """Status of this moment; raises nothing."""
    view, ledger, origin = state.view, state.ledger, state.view.origin
    estimate = state.estimate
    autopilot = 0 if view.heartbeat is None else view.heartbeat.autopilot
    return Status(
        t_s=t_s,
        utc_s=utc_s,
        vehicle_name=config.vehicle.name,
        vehicle_type=config.vehicle.type,
        autopilot=AUTOPILOT_WORDS.get(autopilot, "none" if view.heartbeat is None else f"autopilot {autopilot}"),
        system_id=system_id,
        authority=config.vehicle.authority,
        link_url=link_url,
        link_state=link_state(link, silence_s),
        link_silence_s=silence_s,
        signing="Unsigned",
        state=STATE_WORDS[state.state],
        vehicle_mode=view.mode,
        armed=view.armed,
        landed=view.landed,
        failsafe=state.failsafe,
        estimator="none" if estimate is None else "Full EKF",
        position_source=_position_source(state, config),
        controller=ledger.live.record.controller,
        gain_set=ledger.live.record.number,
        gain_history=tuple(entry.record for entry in ledger.entries),
        last_good=0 if ledger.last_good is None else ledger.entries[ledger.last_good].record.number,
        controls_holder=state.lease.name,
        controls_client=state.lease.client,
        battery_v=view.battery_v,
        battery_remaining=view.battery_remaining,
        flight_time_s=0.0 if math.isnan(view.armed_since_s) else max(0.0, t_s - view.armed_since_s),
        trajectory=_trajectory_status(state),
        origin_latitude_deg=math.nan if origin is None else math.degrees(origin.latitude_rad),
        origin_longitude_deg=math.nan if origin is None else math.degrees(origin.longitude_rad),
        ticks=ticks,
        dropped_frames=dropped_frames,
        tick_p99_us=tick_p99_us,
    )


def _position_source(state: OffboardState, config: OffboardConfig) -> str:
    if state.estimate is None or not state.estimate.position_valid:
        return "none"
    return config.vehicle.estimator.position_source


def _trajectory_status(state: OffboardState) -> TrajectoryStatus:
    manoeuvre = state.manoeuvre
    if state.reference is None:
        return TrajectoryStatus(description="", lap=None, progress=None, left_s=None)
    left_s = None
    if (
        manoeuvre.progress is not None
        and manoeuvre.progress > 0.0
        and isinstance(manoeuvre.trajectory, GoTo | StepResponse)
    ):
        elapsed_s = state.t_s - manoeuvre.started_s
        left_s = elapsed_s * (1.0 - manoeuvre.progress) / manoeuvre.progress
    return TrajectoryStatus(
        description=describe(manoeuvre.trajectory),
        lap=manoeuvre.lap or None,
        progress=manoeuvre.progress,
        left_s=left_s,
    )
