"""The station without input or output: datagrams and requests in, packets and frames out, around one pure tick.

Live flight, lockstep and tests all drive this class; the caller owns sockets and clocks.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from gcs.commands import Request
from gcs.mavlink.link import Link, NoVehicleError
from gcs.mavlink.link_events import (
    AnyLinkEvent,
    AutopilotChanged,
    BytesDiscarded,
    IdentityClash,
    NotGranted,
    VehicleFound,
    VehicleLost,
    VehicleRebooted,
    VehicleReturned,
)
from gcs.mavlink.modes import AUTOPILOT_ARDUPILOT, ModeError
from gcs.offboard import tick as offboard
from gcs.offboard.configure import link_config
from gcs.offboard.state import ModeName, OffboardConfig, Output
from gcs.offboard.status import station_status
from gcs.records import Event, Packet, Status, TickFrame, TickInputs
from gcs.signals import SLICES
from models.samples import AnySample, ImuSample

MOST_INPUTS = 512
DURATIONS_KEPT = 1024
# How often the figures of the link are looked up; they change once a second.
QUALITY_PERIOD_S = 0.2
PX4_MODES: dict[ModeName, str] = {"offboard": "OFFBOARD", "hold": "LOITER", "land": "LAND"}
ARDUPILOT_MODES: dict[ModeName, str] = {"offboard": "GUIDED", "hold": "BRAKE", "land": "LAND"}


@dataclass(frozen=True, slots=True)
class Turnout:
    """What one tick sends (packets to the vehicle, in order) and reports; the frame is made by ``Station.frame``."""

    packets: tuple[bytes, ...]
    inputs: TickInputs
    output: Output
    t_s: float


class Station:
    """One vehicle, one link, one tick. ``ground_s`` is any monotonic clock of the caller [s].

    ``session`` names this life of the station in its frames; ``clock_rate`` 1 is for lockstep, None measures it.
    """

    def __init__(
        self, config: OffboardConfig, utc_s: float, *, session: str = "", clock_rate: float | None = None
    ) -> None:
        self.config = config
        self.session = session
        self.link = Link(link_config(config.vehicle, clock_rate=clock_rate))
        self.state = offboard.initial(config, utc_s)
        self.ticks = 0
        self._samples: list[AnySample] = []
        self._requests: list[Request] = []
        self._link_events: list[Event] = []
        self._rebooted = False
        self._overflow = 0
        self._imu_waiting = False
        self._heard_s = 0.0
        self._quality = self.link.status(0.0)
        self._quality_due_s = 0.0
        self._durations_s: deque[float] = deque(maxlen=DURATIONS_KEPT)

    def receive(self, data: bytes, ground_s: float) -> None:
        """Take in bytes from the vehicle."""
        self._heard_s = self.link.clock.elapsed_s(ground_s)
        for sample in self.link.receive(data, ground_s):
            if len(self._samples) >= MOST_INPUTS:
                self._overflow += 1
                continue
            self._samples.append(sample)
            self._imu_waiting = self._imu_waiting or isinstance(sample, ImuSample)

    def submit(self, request: Request) -> None:
        """Take in an operator's request; it is answered by the next tick."""
        self._requests.append(request)

    @property
    def due(self) -> bool:
        """True when an IMU sample waits: time to tick."""
        return self._imu_waiting

    def tick(self, ground_s: float) -> Turnout:
        """One tick on all that has arrived; the first packet is the setpoint, if there is one."""
        chores = self.link.poll(ground_s)
        self._word_link_events()
        inputs, t_s = self._take_inputs(ground_s)
        self.state, output = offboard.tick(self.state, inputs, t_s, config=self.config)
        self.ticks += 1
        packets: list[bytes] = []
        if output.setpoint is not None and self.state.estimate is not None:
            packets.append(self.link.encode_setpoint(output.setpoint, self.state.estimate.time_s))
        for mode in output.modes:
            packets += self._mode_packet(mode, t_s)
        return Turnout(packets=(*packets, *chores), inputs=inputs, output=output, t_s=t_s)

    def frame(self, turnout: Turnout, utc_s: float, duration_s: float) -> TickFrame:
        """The tick as the recorder gets it; ``duration_s`` is its processor time, shown with the next frame."""
        signals = turnout.output.signals
        signals[SLICES["tick.duration"]] = duration_s
        self._durations_s.append(duration_s)
        utc_us = int(utc_s * 1e6)
        events, self._link_events = self._link_events, []
        return TickFrame(
            sequence=self.ticks,
            t_s=turnout.t_s,
            utc_s=utc_s,
            inputs=turnout.inputs,
            output_hash=turnout.output.hash,
            signals=signals.tobytes(),
            events=(*events, *turnout.output.events),
            answers=turnout.output.answers,
            actions=turnout.output.actions,
            session=self.session,
            packets=tuple(Packet(utc_us, p.inbound, p.raw) for p in self.link.take_packets()),
        )

    def status(self, ground_s: float, utc_s: float, *, link_url: str, dropped_frames: int) -> Status:
        """The slow picture of now."""
        durations = np.fromiter(self._durations_s, float)
        return station_status(
            self.state,
            self.link.status(ground_s),
            self.config,
            t_s=self.link.vehicle_time_s(ground_s),
            utc_s=utc_s,
            silence_s=self.link.clock.elapsed_s(ground_s) - self._heard_s,
            link_url=link_url,
            system_id=0 if self.link.vehicle is None else self.link.vehicle[0],
            dropped_frames=dropped_frames,
            ticks=self.ticks,
            tick_p99_us=float(np.quantile(durations, 0.99)) * 1e6 if durations.size else 0.0,
        )

    def hold_packets(self) -> list[bytes]:
        """What tells the vehicle to hold by itself, for a station that is about to leave."""
        return self._mode_packet("hold", self.state.t_s)

    def _take_inputs(self, ground_s: float) -> tuple[TickInputs, float]:
        if ground_s >= self._quality_due_s:
            self._quality_due_s = ground_s + QUALITY_PERIOD_S
            self._quality = self.link.status(ground_s)
        link = self._quality
        inputs = TickInputs(
            samples=tuple(self._samples),
            requests=tuple(self._requests),
            link_alive=self.link.alive,
            rebooted=self._rebooted,
            link_latency_s=link.round_trip_s,
            link_received=link.received_fraction,
            link_rate_hz=link.messages_per_s,
            overflow=self._overflow,
        )
        self._samples, self._requests = [], []
        self._rebooted, self._overflow, self._imu_waiting = False, 0, False
        return inputs, self.link.vehicle_time_s(ground_s)

    def _mode_packet(self, mode: ModeName, t_s: float) -> list[bytes]:
        names = ARDUPILOT_MODES if self.link.telemetry.autopilot == AUTOPILOT_ARDUPILOT else PX4_MODES
        try:
            return [self.link.encode_set_mode(names[mode])]
        except (ModeError, NoVehicleError) as error:
            self._link_events.append(Event(t_s=t_s, level="warning", text=f"{mode}: {error}", source="link"))
            return []

    def _word_link_events(self) -> None:
        for event in self.link.take_events():
            self._rebooted = self._rebooted or isinstance(event, VehicleRebooted)
            worded = _worded(event)
            if worded is not None:
                self._link_events.append(worded)


def _worded(event: AnyLinkEvent) -> Event | None:
    """A link event as a sentence; None where the mode table says it already."""
    match event:
        case VehicleFound(system=system):
            return Event(event.time_s, "advisory", f"Vehicle {system} found on the link.", "link")
        case VehicleReturned():
            return Event(event.time_s, "advisory", "Heartbeat is back.", "link")
        case AutopilotChanged():
            return Event(
                event.time_s, "caution", "Vehicle says it is another type now. Check the vehicle file.", "link"
            )
        case NotGranted(message=message, rate_hz=rate_hz, reason=reason):
            wanted = message if rate_hz is None else f"{message} at {rate_hz:g} Hz"
            return Event(event.time_s, "caution", f"{wanted} not granted: {reason}.", "link")
        case IdentityClash(system=system, component=component):
            text = f"Another station uses id {system}/{component}. Change one of them."
            return Event(event.time_s, "caution", text, "link")
        case BytesDiscarded(bad_bytes=bad_bytes, bad_checksums=bad_checksums):
            return Event(event.time_s, "advisory", f"{bad_bytes} bad bytes, {bad_checksums} bad checksums.", "link")
        case VehicleLost() | VehicleRebooted():
            return None
