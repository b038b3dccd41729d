"""The link to one vehicle, without input or output: datagrams and the ground's clock in, samples and packets out.

It locks to the first autopilot it hears, keeps its clock, keeps itself alive with heartbeats, measures the round trip,
asks for the messages the station needs, and says how good the link is. Every timeout runs on vehicle time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gcs.mavlink import messages as wire
from gcs.mavlink.clock import VehicleClock
from gcs.mavlink.codec import Decoder, Frame, decode
from gcs.mavlink.encoder import Encoder
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
from gcs.mavlink.link_quality import LinkQuality, LinkStatus
from gcs.mavlink.modes import AUTOPILOT_INVALID, TYPE_GCS, mode_command
from gcs.mavlink.negotiation import Negotiation
from gcs.mavlink.setpoints import encode_setpoint
from gcs.telemetry import Telemetry, vehicle_stamp_s
from models.samples import AnySample
from models.setpoints import Setpoint

AUTOPILOT_COMPONENT = 1
MOCAP_COMPONENT = 197
MOCAP_MESSAGES = (102, 138)
HOME_POSITION, GPS_GLOBAL_ORIGIN, AUTOPILOT_VERSION = 242, 49, 148
DO_SET_MODE = 176
HEARTBEAT_PERIOD_S = 1.0
TIMESYNC_PERIOD_S = 1.0
DISCARDED_PERIOD_S = 1.0
NS_PER_S = 1e9
TIMESYNC_MEMORY = 16


class NoVehicleError(RuntimeError):
    """Something was to be sent to the vehicle before one was heard."""


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """Who we are and what we ask for: ``rates_hz`` maps message id to Hz (0 is off), ``requests`` are wanted once.

    ``clock_rate`` fixes vehicle seconds per ground second (1 in lockstep); None estimates it. ``keep_packets`` makes
    :meth:`Link.take_packets` return what went in and out, for the log.
    """

    system: int = 255
    component: int = 191
    rates_hz: Mapping[int, float] = field(default_factory=dict)
    requests: tuple[int, ...] = (HOME_POSITION, GPS_GLOBAL_ORIGIN, AUTOPILOT_VERSION)
    heartbeat_timeout_s: float = 3.0
    clock_rate: float | None = None
    keep_packets: bool = False
    packet_memory: int = 8192


@dataclass(frozen=True, slots=True)
class LinkPacket:
    """One raw packet that came in or was handed out to be sent."""

    inbound: bool
    raw: bytes


class Link:
    """One vehicle on one link. ``receive`` and ``poll`` are all it takes to run it."""

    def __init__(self, config: LinkConfig | None = None) -> None:
        self.config = config or LinkConfig()
        self.decoder = Decoder()
        self.encoder = Encoder(self.config.system, self.config.component)
        self.telemetry = Telemetry()
        self.clock = VehicleClock(self.config.clock_rate)
        self.vehicle: tuple[int, int] | None = None
        self.armed = False
        self.alive = False
        self.foreign = 0
        self.packets_forgotten = 0
        self.autopilot_version: wire.AutopilotVersion | None = None
        self._quality = LinkQuality()
        self._negotiation = Negotiation(self.config.rates_hz, self.config.requests)
        self._events: list[AnyLinkEvent] = []
        self._packets: deque[LinkPacket] = deque(maxlen=self.config.packet_memory)
        self._replies: list[bytes] = []
        self._timesync_sent: deque[int] = deque(maxlen=TIMESYNC_MEMORY)
        self._heartbeat_s = 0.0
        self._heartbeat_due_s = 0.0
        self._timesync_due_s = 0.0
        self._discarded_due_s = 0.0
        self._discarded = (0, 0)
        self._clash_told = False

    # In

    def receive(self, data: bytes, ground_s: float) -> list[AnySample]:
        """Fold bytes that arrived at ``ground_s`` (any monotonic clock of the caller, [s]) into samples."""
        samples: list[AnySample] = []
        for frame in self.decoder.feed(data):
            if self.config.keep_packets:
                self._keep(inbound=True, raw=frame.raw)
            samples += self._take(frame, ground_s)
        return samples

    def _take(self, frame: Frame, ground_s: float) -> list[AnySample]:
        source = (frame.system, frame.component)
        if source == (self.config.system, self.config.component):
            self._tell_clash(ground_s)
            return []
        if self.vehicle is None and frame.message_id == 0:
            self._lock(frame, ground_s)
        if source != self.vehicle:
            return self._take_from_other(frame, ground_s)
        message = decode(frame)
        stamp_s = vehicle_stamp_s(message)
        if stamp_s is not None:
            before_s = self.clock.observe(stamp_s, ground_s)
            if before_s is not None:
                self._reboot(before_s, ground_s)
        self._quality.count(frame.message_id)
        if frame.message_id in self._own_messages and not self._take_own(message, ground_s):
            return []
        return self.telemetry.fold_message(frame.message_id, message, self.clock.time_s(ground_s))

    # Heartbeat, command answers, time and version concern the link itself.
    _own_messages = frozenset((0, 77, 111, HOME_POSITION, GPS_GLOBAL_ORIGIN, AUTOPILOT_VERSION))

    def _take_own(self, message: wire.Message | None, ground_s: float) -> bool:
        """What the link does with messages that concern it; False if the message is not for the fold."""
        now_s = self.clock.elapsed_s(ground_s)
        match message:
            case wire.Heartbeat():
                self._heartbeat(message, ground_s)
            case wire.CommandAck(target_system=system, target_component=component):
                # Broadcast answers and those of MAVLink 1, which has no target, are taken for ours.
                if system not in (0, self.config.system) or component not in (0, self.config.component):
                    self.foreign += 1
                    return False
                self._negotiation.answered(message.command, message.result, now_s)
            case wire.Timesync():
                self._timesync(message, ground_s)
            case wire.HomePosition():
                self._negotiation.seen(HOME_POSITION)
            case wire.GpsGlobalOrigin():
                self._negotiation.seen(GPS_GLOBAL_ORIGIN)
            case wire.AutopilotVersion():
                self.autopilot_version = message
                self._negotiation.seen(AUTOPILOT_VERSION)
            case _:
                pass
        return True

    def _take_from_other(self, frame: Frame, ground_s: float) -> list[AnySample]:
        """Another sender: only motion capture on behalf of our vehicle counts; the rest is counted as foreign."""
        if (
            self.vehicle is not None
            and frame.system == self.vehicle[0]
            and frame.component == MOCAP_COMPONENT
            and frame.message_id in MOCAP_MESSAGES
        ):
            return self.telemetry.fold(frame, self.clock.time_s(ground_s))
        self.foreign += 1
        return []

    def _lock(self, frame: Frame, ground_s: float) -> None:
        message = decode(frame)
        if not isinstance(message, wire.Heartbeat) or frame.component != AUTOPILOT_COMPONENT:
            return
        if message.type == TYPE_GCS or message.autopilot == AUTOPILOT_INVALID:
            return
        self.vehicle = (frame.system, frame.component)
        self.alive = True
        self._event(
            VehicleFound(
                time_s=self.clock.time_s(ground_s),
                system=frame.system,
                component=frame.component,
                autopilot=message.autopilot,
                vehicle_type=message.type,
            )
        )

    def _heartbeat(self, message: wire.Heartbeat, ground_s: float) -> None:
        self._heartbeat_s = self.clock.elapsed_s(ground_s)
        self.armed = bool(message.base_mode & 128)
        time_s = self.clock.time_s(ground_s)
        if not self.alive:
            self.alive = True
            self._event(VehicleReturned(time_s=time_s))
        known = (self.telemetry.autopilot, self.telemetry.vehicle_type)
        if known != (0, 0) and known != (message.autopilot, message.type):
            self._event(AutopilotChanged(time_s=time_s, autopilot=message.autopilot, vehicle_type=message.type))

    def _timesync(self, message: wire.Timesync, ground_s: float) -> None:
        now_ns = round(ground_s * NS_PER_S)
        if message.tc1 == 0:
            self._replies.append(self.encoder.timesync(now_ns, message.ts1))
        elif message.ts1 in self._timesync_sent:
            self._timesync_sent.remove(message.ts1)
            self._quality.round_trip_s = (now_ns - message.ts1) / NS_PER_S

    def _reboot(self, before_s: float, ground_s: float) -> None:
        self.telemetry.reset()
        self._negotiation.restart()
        self._event(VehicleRebooted(time_s=self.clock.time_s(ground_s), before_s=before_s))

    def _tell_clash(self, ground_s: float) -> None:
        self.foreign += 1
        if not self._clash_told:
            self._clash_told = True
            self._event(
                IdentityClash(
                    time_s=self.clock.time_s(ground_s), system=self.config.system, component=self.config.component
                )
            )

    # Out

    def poll(self, ground_s: float) -> list[bytes]:
        """Packets to send now: heartbeat, time, questions and answers. Call it at least ten times a second."""
        now_s = self.clock.elapsed_s(ground_s)
        self._quality.advance(now_s, self.decoder.source(*self.vehicle) if self.vehicle else None)
        packets, self._replies = self._replies, []
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + HEARTBEAT_PERIOD_S
            packets.append(self.encoder.heartbeat())
        if self.vehicle is not None:
            self._watch(self.vehicle, now_s, ground_s)
            if now_s >= self._timesync_due_s:
                self._timesync_due_s = now_s + TIMESYNC_PERIOD_S
                stamp_ns = round(ground_s * NS_PER_S)
                self._timesync_sent.append(stamp_ns)
                packets.append(self.encoder.timesync(0, stamp_ns))
            question = self._negotiation.poll(now_s, self._quality.rates_hz) if self.alive else None
            if question is not None:
                packets.append(self.encoder.command_long(self.vehicle, question.command, question.parameters))
        self._tell_discarded(now_s, ground_s)
        for packet in packets:
            self._sent(packet)
        return packets

    def _watch(self, vehicle: tuple[int, int], now_s: float, ground_s: float) -> None:
        """Notice silence, and pass on what the vehicle did not grant."""
        time_s = self.clock.time_s(ground_s)
        age_s = now_s - self._heartbeat_s
        if self.alive and age_s > self.config.heartbeat_timeout_s:
            self.alive = False
            self._event(VehicleLost(time_s=time_s, age_s=age_s))
        for refusal in self._negotiation.refusals:
            self._event(
                NotGranted(time_s=time_s, message=refusal.message, rate_hz=refusal.rate_hz, reason=refusal.reason)
            )
        self._negotiation.refusals.clear()

    def _tell_discarded(self, now_s: float, ground_s: float) -> None:
        counts = (self.decoder.bad_bytes, self.decoder.bad_crc)
        if counts == self._discarded or now_s < self._discarded_due_s:
            return
        self._event(
            BytesDiscarded(
                time_s=self.clock.time_s(ground_s),
                bad_bytes=counts[0] - self._discarded[0],
                bad_checksums=counts[1] - self._discarded[1],
            )
        )
        self._discarded, self._discarded_due_s = counts, now_s + DISCARDED_PERIOD_S

    def encode_setpoint(self, setpoint: Setpoint, time_s: float) -> bytes:
        """Packet of a setpoint, stamped with the time of its estimate [s]. Raises NoVehicleError."""
        return self._sent(encode_setpoint(self.encoder, self._target(), setpoint, time_s))

    def encode_command(self, command: int, parameters: Sequence[float] = ()) -> bytes:
        """COMMAND_LONG to the vehicle with up to seven parameters. Raises NoVehicleError."""
        return self._sent(self.encoder.command_long(self._target(), command, parameters))

    def encode_set_mode(self, name: str) -> bytes:
        """Command of a flight mode by its name in the autopilot's words. Raises NoVehicleError, ModeError."""
        target = self._target()
        mode = mode_command(self.telemetry.autopilot, self.telemetry.vehicle_type, name, armed=self.armed)
        parameters = (float(mode.base_mode), float(mode.main), float(mode.sub))
        return self._sent(self.encoder.command_long(target, DO_SET_MODE, parameters))

    def encode_any(self, message: Any) -> bytes:
        """Any other message of the dialect, as a pymavlink message whose targets the caller has set."""
        return self._sent(self.encoder.any_message(message))

    def _target(self) -> tuple[int, int]:
        if self.vehicle is None:
            raise NoVehicleError("no vehicle has been heard on this link yet")
        return self.vehicle

    # State

    def vehicle_time_s(self, ground_s: float) -> float:
        """Time on the vehicle clock [s]; it goes on while the vehicle is silent."""
        return self.clock.time_s(ground_s)

    def status(self, ground_s: float) -> LinkStatus:
        """How the link is doing, over the last full second of vehicle time."""
        age_s = self.clock.elapsed_s(ground_s) - self._heartbeat_s
        source = self.decoder.source(*self.vehicle) if self.vehicle else None
        return self._quality.status(self.alive, age_s if self.vehicle else None, source, self.decoder)

    @property
    def negotiated(self) -> bool:
        """True when every rate and message asked for has been granted or given up."""
        return self._negotiation.finished

    def take_events(self) -> list[AnyLinkEvent]:
        """Events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def take_packets(self) -> list[LinkPacket]:
        """Raw packets in and out since the last call; empty unless ``keep_packets``; the oldest are forgotten first."""
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def _event(self, event: AnyLinkEvent) -> None:
        self._events.append(event)

    def _sent(self, packet: bytes) -> bytes:
        if self.config.keep_packets:
            self._keep(inbound=False, raw=packet)
        return packet

    def _keep(self, *, inbound: bool, raw: bytes) -> None:
        self.packets_forgotten += len(self._packets) == self._packets.maxlen
        self._packets.append(LinkPacket(inbound, raw))
