"""The vehicle's MAVLink face: what it answers to each message, on several links at once.

Sans I/O. :meth:`Face.receive` takes bytes, packets to send collect in ``outbox``. Behaviour follows PX4 1.13 as MAVSDK
and MAVProxy expect it. Commands and setpoints are decoded by pymavlink's parser, one per link.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from models.frames import Geodetic, Vec3, ned_from_geodetic
from sitl import parameter_protocol
from sitl.autopilot import Autopilot
from sitl.mission_protocol import MissionProtocol
from sitl.modes import Mode, Result, Severity
from sitl.schedule import REPORT, Schedule
from sitl.setpoint_messages import decode_setpoint
from sitl.telemetry import MOCAP_COMPONENT, STREAMS, ImuCursor, Stream, Telemetry
from sitl.vehicle import TICK_US, QuadrotorVehicle
from sitl.wire import Layout, Sender, layout

SYSTEM, COMPONENT = 1, 1
_FORCE_MAGIC = 21196
_GLOBAL_AMSL_FRAMES = (0, 5)
_GLOBAL_RELATIVE_FRAMES = (3, 6)
_FTP_NAK, _FTP_UNKNOWN_COMMAND = 129, 7
_CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_FIRMWARE_VERSION = 1 << 24 | 13 << 16 | 3 << 8 | 255  # 1.13.3, the last series that takes actuator setpoints
_BY_ID: dict[int, Stream] = {stream.message.message_id: stream for stream in STREAMS}


class Packet(NamedTuple):
    """One MAVLink packet on its way out on a link."""

    link: int
    data: bytes


class FaceLink:
    """One link: parser, sequence numbers, and the streams its peer gets. ``packets_in`` counts good packets."""

    def __init__(self, index: int, vehicle: QuadrotorVehicle) -> None:
        self.index = index
        self.parser = dialect.MAVLink(None)
        self.parser.robust_parsing = True
        self.senders = {
            COMPONENT: Sender(SYSTEM, COMPONENT),
            MOCAP_COMPONENT: Sender(SYSTEM, MOCAP_COMPONENT),
        }
        self.cursor = ImuCursor(vehicle)
        self.interval_us: dict[int, int] = {}
        self.due_us: dict[int, int] = {}
        self.generation: dict[int, int] = {}
        self.packets_in = 0
        self.bad_packets_in = 0


class Face:
    """The vehicle's end of every link. Needs the parts it reports on and acts on."""

    def __init__(
        self,
        vehicle: QuadrotorVehicle,
        autopilot: Autopilot,
        telemetry: Telemetry,
        schedule: Schedule,
        origin: Geodetic,
        link_count: int,
        *,
        imu_delay_us: int,
        imu_rate_hz: float,
    ) -> None:
        self.outbox: list[Packet] = []
        self._vehicle = vehicle
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._schedule = schedule
        self._origin = origin
        self._imu_delay_us = imu_delay_us
        self._imu_rate_hz = imu_rate_hz
        self.links = [FaceLink(index, vehicle) for index in range(link_count)]
        self._missions = [
            MissionProtocol(autopilot.mission, vehicle, self._replier(link), autopilot.mission.replace)
            for link in self.links
        ]
        self._by_sensor: dict[str, list[Stream]] = {}
        for stream in STREAMS:
            if stream.sensor is not None:
                self._by_sensor.setdefault(stream.sensor, []).append(stream)
        for link in self.links:
            for stream in STREAMS:
                self._set_rate(link, stream, self._default_hz(stream))
        schedule.add(100_000, REPORT, self._report_slowly)

    # Out

    def send(self, link: FaceLink, message: Layout, payload: bytes, component: int = COMPONENT) -> None:
        """Put a packet into the outbox."""
        self.outbox.append(Packet(link.index, link.senders[component].frame(message, payload)))

    def _replier(self, link: FaceLink) -> Callable[[str, dict[str, Any]], None]:
        def reply(name: str, fields: dict[str, Any]) -> None:
            message = layout(name)
            self.send(link, message, message.payload(**fields))

        return reply

    def announce(self, severity: Severity, text: str) -> None:
        """STATUSTEXT on every link."""
        message = layout("STATUSTEXT")
        for link in self.links:
            self.send(link, message, message.payload(severity=severity.value, text=text[:50]))

    def _report_slowly(self, time_us: int) -> int:
        """Mission progress, and mission uploads that wait for a lost item."""
        mission = self._autopilot.mission
        if mission.reached is not None:
            message = layout("MISSION_ITEM_REACHED")
            for link in self.links:
                self.send(link, message, message.payload(seq=mission.reached))
            mission.reached = None
        for protocol in self._missions:
            protocol.poll(time_us)
        return time_us + 100_000

    def _default_hz(self, stream: Stream) -> float:
        return self._imu_rate_hz if stream.message.name == "HIGHRES_IMU" else stream.default_hz

    def _set_rate(self, link: FaceLink, stream: Stream, rate_hz: float) -> None:
        """Stream a message at a rate from now on (0: not at all), aligned to whole multiples of its interval."""
        message_id = stream.message.message_id
        interval_us = max(round(1e6 / rate_hz), TICK_US) if rate_hz > 0.0 else 0
        link.interval_us[message_id] = interval_us
        link.due_us[message_id] = self._vehicle.time_us
        link.generation[message_id] = link.generation.get(message_id, 0) + 1
        if interval_us > 0 and stream.sensor is None:
            first_us = (self._vehicle.time_us // interval_us + 1) * interval_us
            self._schedule.add(first_us, REPORT, self._streamer(link, stream, interval_us, first_us))

    def _streamer(self, link: FaceLink, stream: Stream, interval_us: int, first_us: int) -> Callable[[int], int | None]:
        message_id, build = stream.message.message_id, stream.build
        generation = link.generation[message_id]
        is_imu = stream.message.name == "HIGHRES_IMU"
        delay_us = self._imu_delay_us if is_imu else 0
        due_us = first_us
        if is_imu:
            link.cursor = ImuCursor(self._vehicle)

        def run(time_us: int) -> int | None:
            nonlocal due_us
            if link.generation[message_id] != generation:
                return None
            payload = build(self._telemetry, link.cursor)
            if payload and delay_us:
                self._schedule.add(time_us + delay_us, REPORT, lambda _: self.send(link, stream.message, payload))
            elif payload:
                self.send(link, stream.message, payload)
            due_us += interval_us
            return due_us

        return run

    def sensor_ready(self, sensor: str, time_us: int) -> None:
        """A sensor has handed over a reading: send it to the links that stream it and are due."""
        for stream in self._by_sensor.get(sensor, ()):
            message_id = stream.message.message_id
            payload: bytes | None = None
            for link in self.links:
                interval_us = link.interval_us[message_id]
                # Half a tick of slack: readings and intervals are both on the grid.
                if interval_us <= 0 or time_us + TICK_US // 2 < link.due_us[message_id]:
                    continue
                link.due_us[message_id] = max(link.due_us[message_id] + interval_us, time_us)
                payload = stream.build(self._telemetry, link.cursor) if payload is None else payload
                if payload:
                    self.send(link, stream.message, payload, stream.component)

    # In

    def receive(self, link_index: int, datagram: bytes) -> None:
        """Act on bytes from a peer. Damaged packets are counted, and those for another system left alone."""
        link = self.links[link_index]
        for message in link.parser.parse_buffer(datagram) or ():
            kind = message.get_type()
            if kind == "BAD_DATA":
                link.bad_packets_in += 1
                continue
            link.packets_in += 1
            if getattr(message, "target_system", SYSTEM) not in (0, SYSTEM):
                continue
            if getattr(message, "target_component", COMPONENT) not in (0, COMPONENT):
                continue
            self._act(link, kind, message)

    def _act(self, link: FaceLink, kind: str, message: Any) -> None:
        match kind:
            case (
                "SET_ATTITUDE_TARGET"
                | "SET_POSITION_TARGET_LOCAL_NED"
                | "SET_POSITION_TARGET_GLOBAL_INT"
                | "SET_ACTUATOR_CONTROL_TARGET"
            ):
                setpoint = decode_setpoint(kind, message, self._origin)
                if setpoint is not None:
                    self._autopilot.receive_setpoint(setpoint)
            case "MANUAL_CONTROL":
                if message.target == SYSTEM:
                    self._autopilot.receive_sticks(
                        message.x / 1000.0, message.y / 1000.0, message.z / 1000.0, message.r / 1000.0
                    )
            case "COMMAND_LONG":
                self._command(link, message, [getattr(message, f"param{i}") for i in range(1, 8)])
            case "COMMAND_INT":
                self._command_int(link, message)
            case "SET_MODE":
                mode = _mode_of(message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF)
                if mode is not None:
                    self._autopilot.set_mode(mode)
            case "PARAM_REQUEST_READ" | "PARAM_REQUEST_LIST" | "PARAM_SET":
                self._parameter(link, kind, message)
            case "PING":
                if message.target_system == 0:
                    self._reply(
                        link,
                        "PING",
                        time_usec=message.time_usec,
                        seq=message.seq,
                        target_system=message.get_srcSystem(),
                        target_component=message.get_srcComponent(),
                    )
            case "TIMESYNC":
                if message.tc1 == 0:
                    self._reply(link, "TIMESYNC", tc1=self._vehicle.time_us * 1000, ts1=message.ts1)
            case "FILE_TRANSFER_PROTOCOL":
                self._refuse_file_transfer(link, message)
            case _ if kind.startswith("MISSION_"):
                self._missions[link.index].receive(kind, message)

    def _reply(self, link: FaceLink, name: str, **fields: Any) -> None:
        message = layout(name)
        self.send(link, message, message.payload(**fields))

    def _acknowledge(self, link: FaceLink, request: Any, result: Result) -> None:
        self._reply(
            link,
            "COMMAND_ACK",
            command=request.command,
            result=result.value,
            progress=255,
            target_system=request.get_srcSystem(),
            target_component=request.get_srcComponent(),
        )

    def _command(self, link: FaceLink, request: Any, p: list[float]) -> None:
        """COMMAND_LONG, and COMMAND_INT whose coordinates are not needed."""
        autopilot = self._autopilot
        match request.command:
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                force = p[1] == _FORCE_MAGIC
                result = autopilot.arm(force=force) if p[0] > 0.5 else autopilot.disarm(force=force)
            case dialect.MAV_CMD_NAV_TAKEOFF:
                result = autopilot.take_off(self._origin.height_m - p[6])
            case dialect.MAV_CMD_NAV_LAND:
                result = autopilot.set_mode(Mode.LAND)
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                result = autopilot.set_mode(Mode.RTL)
            case dialect.MAV_CMD_DO_SET_MODE:
                mode = _mode_of(int(p[1]), int(p[2])) if int(p[0]) & 1 else None
                result = autopilot.set_mode(mode) if mode is not None else Result.DENIED
            case dialect.MAV_CMD_MISSION_START:
                result = Result.ACCEPTED if autopilot.mission.go_to(int(p[0])) else Result.DENIED
                result = autopilot.set_mode(Mode.MISSION) if result is Result.ACCEPTED else result
            case dialect.MAV_CMD_DO_CHANGE_SPEED:
                valid = math.isfinite(p[1]) and 0.0 < p[1] <= autopilot.parameters["MPC_XY_VEL_MAX"]
                autopilot.cruise_m_s = p[1] if valid else autopilot.cruise_m_s
                result = Result.ACCEPTED if valid else Result.DENIED
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                result = self._set_interval(link, int(p[0]), p[1])
            case dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
                interval = link.interval_us.get(int(p[0]))
                shown = 0 if interval is None else interval or -1
                self._reply(link, "MESSAGE_INTERVAL", message_id=int(p[0]), interval_us=shown)
                result = Result.ACCEPTED
            case dialect.MAV_CMD_REQUEST_MESSAGE:
                result = self._request_message(link, request, int(p[0]))
                if result is Result.ACCEPTED:
                    return
            case dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
                self._send_version(link)
                result = Result.ACCEPTED
            case _:
                result = Result.UNSUPPORTED
        self._acknowledge(link, request, result)

    def _command_int(self, link: FaceLink, request: Any) -> None:
        p = [request.param1, request.param2, request.param3, request.param4, math.nan, math.nan, request.z]
        if request.command == dialect.MAV_CMD_DO_REPOSITION:
            position = self._position(request.frame, request.x, request.y, request.z)
            if position is None:
                result = Result.DENIED
            else:
                result = self._autopilot.reposition(position, request.param4, request.param1)
            self._acknowledge(link, request, result)
        else:
            self._command(link, request, p)

    def _position(self, frame: int, x: int, y: int, z: float) -> Vec3 | None:
        """Local position of degE7 coordinates in a global frame; None for a frame this vehicle does not take."""
        if frame not in (*_GLOBAL_AMSL_FRAMES, *_GLOBAL_RELATIVE_FRAMES):
            return None
        height = z if frame in _GLOBAL_AMSL_FRAMES else z + self._origin.height_m - self._autopilot.home_ned_m[2]
        point = Geodetic(math.radians(x * 1e-7), math.radians(y * 1e-7), height)
        north, east, down = ned_from_geodetic(point, self._origin)
        return (math.nan, math.nan, down) if x == 2**31 - 1 or y == 2**31 - 1 else (north, east, down)

    def _set_interval(self, link: FaceLink, message_id: int, interval_us: float) -> Result:
        stream = _BY_ID.get(message_id)
        if stream is None:
            return Result.UNSUPPORTED
        if interval_us == 0.0:
            rate_hz = self._default_hz(stream)
        elif interval_us > 0.0:
            rate_hz = 1e6 / interval_us
        else:
            rate_hz = 0.0
        self._set_rate(link, stream, rate_hz)
        return Result.ACCEPTED

    def _request_message(self, link: FaceLink, request: Any, message_id: int) -> Result:
        """Acknowledge first, then the message, as PX4 does."""
        stream = _BY_ID.get(message_id)
        if message_id == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self._acknowledge(link, request, Result.ACCEPTED)
            self._send_version(link)
            return Result.ACCEPTED
        if stream is None or stream.message.name == "HIGHRES_IMU":
            return Result.UNSUPPORTED
        payload = stream.build(self._telemetry, link.cursor)
        if not payload:
            return Result.TEMPORARILY_REJECTED
        self._acknowledge(link, request, Result.ACCEPTED)
        self.send(link, stream.message, payload, stream.component)
        return Result.ACCEPTED

    def _send_version(self, link: FaceLink) -> None:
        uid = 0x526F746F724C6162
        self._reply(
            link,
            "AUTOPILOT_VERSION",
            capabilities=_CAPABILITIES,
            uid=uid,
            flight_sw_version=_FIRMWARE_VERSION,
            flight_custom_version=list(b"rotorlab"),
            uid2=list(uid.to_bytes(8, "little")),
        )

    def _parameter(self, link: FaceLink, kind: str, message: Any) -> None:
        values, complaint = parameter_protocol.answer(self._autopilot.parameters, kind, message)
        if complaint is not None:
            self.announce(Severity.WARNING, complaint)
        for fields in values:
            self._reply(link, "PARAM_VALUE", **fields)

    def _refuse_file_transfer(self, link: FaceLink, message: Any) -> None:
        sequence = (message.payload[0] | message.payload[1] << 8) + 1 & 0xFFFF
        asked = message.payload[3]
        answer = [sequence & 0xFF, sequence >> 8, message.payload[2], _FTP_NAK, 1, asked, 0, 0, 0, 0, 0, 0]
        self._reply(
            link,
            "FILE_TRANSFER_PROTOCOL",
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
            payload=[*answer, _FTP_UNKNOWN_COMMAND],
        )


def _mode_of(main: int, sub: int) -> Mode | None:
    for mode in Mode:
        if mode.value == (main, sub if main == 4 else 0):
            return mode
    return None
