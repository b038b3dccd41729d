"""MAVLink 2 packets of the messages the station sends; every other message is packed through pymavlink.

Values go in as on the wire; setpoints and commands are SI and radians there already.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import MAGIC_V2, checksum
from gcs.mavlink.dialect import CRC_EXTRA
from gcs.mavlink.modes import AUTOPILOT_INVALID, TYPE_GCS
from models.frames import Quaternion, Vec3

HEARTBEAT = 0
SET_ATTITUDE_TARGET = 82
SET_POSITION_TARGET_LOCAL_NED = 84
COMMAND_INT = 75
COMMAND_LONG = 76
TIMESYNC = 111
SET_ACTUATOR_CONTROL_TARGET = 139

MAVLINK_VERSION = 3
STATE_ACTIVE = 4
FRAME_LOCAL_NED = 1
GROUP_FLIGHT_CONTROL = 0
# A setpoint's stamp is 32-bit milliseconds since boot and wraps after 49 days, as the vehicle's own does.
WRAP_MS = 1 << 32


class Encoder:
    """Packs messages of one sender, numbering them; each method returns one whole packet."""

    def __init__(self, system: int = 255, component: int = 191) -> None:
        self.system = system
        self.component = component
        self._sequence = 0
        self._pack = {
            message_id: dialect.mavlink_map[message_id].unpacker.pack
            for message_id in (
                HEARTBEAT,
                COMMAND_INT,
                COMMAND_LONG,
                SET_ATTITUDE_TARGET,
                SET_POSITION_TARGET_LOCAL_NED,
                TIMESYNC,
                SET_ACTUATOR_CONTROL_TARGET,
            )
        }

    def heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station."""
        return self._packet(HEARTBEAT, 0, TYPE_GCS, AUTOPILOT_INVALID, 0, STATE_ACTIVE, MAVLINK_VERSION)

    def timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        """TIMESYNC: a request has ``tc1_ns`` 0 and our clock in ``ts1_ns``; a reply our clock and the asker's stamp."""
        return self._packet(TIMESYNC, tc1_ns, ts1_ns)

    def command_long(self, target: tuple[int, int], command: int, parameters: Sequence[float]) -> bytes:
        """COMMAND_LONG to (system, component) with up to seven parameters; the rest are 0."""
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        return self._packet(COMMAND_LONG, *padded, command, *target, 0)

    def command_int(
        self,
        target: tuple[int, int],
        command: int,
        parameters: Sequence[float],
        position: tuple[int, int, float],
        frame: int,
    ) -> bytes:
        """COMMAND_INT to (system, component): four parameters, then x, y (degE7 or 1e-4 m) and z [m] in ``frame``."""
        padded = [*parameters, *[0.0] * (4 - len(parameters))]
        x, y, z = position
        return self._packet(COMMAND_INT, *padded, x, y, z, command, *target, frame, 0, 0)

    def set_attitude_target(
        self,
        target: tuple[int, int],
        time_s: float,
        type_mask: int,
        ned_from_body: Quaternion,
        rates_body_rad_s: Vec3,
        thrust: float,
    ) -> bytes:
        """SET_ATTITUDE_TARGET: attitude, body rates [rad/s], normalised thrust; ``type_mask`` says what to ignore."""
        return self._packet(
            SET_ATTITUDE_TARGET,
            _boot_ms(time_s),
            *ned_from_body,
            *rates_body_rad_s,
            thrust,
            *target,
            type_mask,
        )

    def set_position_target_local_ned(
        self,
        target: tuple[int, int],
        time_s: float,
        type_mask: int,
        position_ned_m: Vec3,
        velocity_ned_m_s: Vec3,
        acceleration_ned_m_s2: Vec3,
        yaw_rad: float,
    ) -> bytes:
        """SET_POSITION_TARGET_LOCAL_NED in the local NED frame; ``type_mask`` says what to ignore."""
        return self._packet(
            SET_POSITION_TARGET_LOCAL_NED,
            _boot_ms(time_s),
            *position_ned_m,
            *velocity_ned_m_s,
            *acceleration_ned_m_s2,
            yaw_rad,
            0.0,
            type_mask,
            *target,
            FRAME_LOCAL_NED,
        )

    def set_actuator_control_target(
        self, target: tuple[int, int], time_s: float, controls: tuple[float, float, float, float]
    ) -> bytes:
        """SET_ACTUATOR_CONTROL_TARGET, group 0: roll, pitch, yaw in -1..1 and thrust in 0..1."""
        return self._packet(
            SET_ACTUATOR_CONTROL_TARGET,
            round(time_s * 1e6),
            *controls,
            0.0,
            0.0,
            0.0,
            0.0,
            GROUP_FLIGHT_CONTROL,
            *target,
        )

    def any_message(self, message: Any) -> bytes:
        """A pymavlink message of the dialect, packed as ours."""
        packer = dialect.MAVLink(None, srcSystem=self.system, srcComponent=self.component)
        packer.seq = self._next_sequence()
        return bytes(message.pack(packer))

    def _next_sequence(self) -> int:
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        return sequence

    def _packet(self, message_id: int, *values: float) -> bytes:
        """Frame of a message from its values in wire order; trailing zeros of the payload are cut, one byte stays."""
        payload: bytes = self._pack[message_id](*values)
        payload = payload.rstrip(b"\0") or payload[:1]
        header = (len(payload), 0, 0, self._next_sequence(), self.system, self.component, message_id, 0, 0)
        covered = bytes(header) + payload
        crc = checksum(covered + CRC_EXTRA[message_id])
        return bytes((MAGIC_V2,)) + covered + crc.to_bytes(2, "little")


def _boot_ms(time_s: float) -> int:
    return round(time_s * 1e3) % WRAP_MS
