"""The fold of what the autopilot says of itself: its estimates, mode, battery, outputs, texts, home and answers."""

from __future__ import annotations

import math

from gcs.mavlink import messages as wire
from gcs.mavlink.fold_measurements import M_PER_MM, RAD_PER_DEGE7, S_PER_MS, S_PER_US, UINT16_UNKNOWN
from gcs.mavlink.modes import is_armed, mode_name
from gcs.mavlink.sources import FoldPart, SourceChoice, TextAssembly, boot_time_s, euler_to_quaternion
from models.frames import Quaternion
from models.samples import (
    ActuatorSample,
    AnySample,
    AutopilotAttitudeSample,
    AutopilotPositionSample,
    BatterySample,
    CommandAckSample,
    HeartbeatSample,
    HomeSample,
    LandedSample,
    OriginSample,
    StatusTextSample,
)

V_PER_MV = 1e-3
A_PER_CA = 1e-2
SENSOR_DIFFERENTIAL_PRESSURE = 16
OUTPUTS = 8
# Battery messages come about once a second.
BATTERY_ALIVE_S = 5.0


class StateFold(FoldPart):
    """The autopilot's own words; ``autopilot``, ``vehicle_type`` and ``has_pitot`` are learned from them."""

    def __init__(self, autopilot: int, vehicle_type: int, has_pitot: bool) -> None:
        super().__init__()
        self.autopilot = autopilot
        self.vehicle_type = vehicle_type
        self.has_pitot = has_pitot
        self._attitude_source = SourceChoice()
        self._battery_source = SourceChoice(BATTERY_ALIVE_S)
        self._actuator_source = SourceChoice()
        self._texts = TextAssembly()

    def attitude(self, m: wire.Attitude, arrival_s: float) -> list[AnySample]:
        quaternion = euler_to_quaternion(m.roll, m.pitch, m.yaw)
        return self._autopilot_attitude(1, m.time_boot_ms, arrival_s, quaternion, m)

    def attitude_quaternion(self, m: wire.AttitudeQuaternion, arrival_s: float) -> list[AnySample]:
        return self._autopilot_attitude(0, m.time_boot_ms, arrival_s, (m.q1, m.q2, m.q3, m.q4), m)

    def _autopilot_attitude(
        self,
        rank: int,
        stamp_ms: int,
        arrival_s: float,
        quaternion: Quaternion,
        m: wire.Attitude | wire.AttitudeQuaternion,
    ) -> list[AnySample]:
        rates = (m.rollspeed, m.pitchspeed, m.yawspeed)
        if not self.all_finite(*quaternion, *rates) or not self._attitude_source.takes(rank, arrival_s):
            return []
        return [
            AutopilotAttitudeSample(
                time_s=stamp_ms * S_PER_MS, arrival_s=arrival_s, ned_from_body=quaternion, rates_body_rad_s=rates
            )
        ]

    def local_position_ned(self, m: wire.LocalPositionNed, arrival_s: float) -> list[AnySample]:
        if not self.all_finite(m.x, m.y, m.z, m.vx, m.vy, m.vz):
            return []
        return [
            AutopilotPositionSample(
                time_s=m.time_boot_ms * S_PER_MS,
                arrival_s=arrival_s,
                position_ned_m=(m.x, m.y, m.z),
                velocity_ned_m_s=(m.vx, m.vy, m.vz),
            )
        ]

    def heartbeat(self, m: wire.Heartbeat, arrival_s: float) -> list[AnySample]:
        self.autopilot, self.vehicle_type = m.autopilot, m.type
        return [
            HeartbeatSample(
                time_s=arrival_s,
                arrival_s=arrival_s,
                autopilot=m.autopilot,
                vehicle_type=m.type,
                base_mode=m.base_mode,
                custom_mode=m.custom_mode,
                system_status=m.system_status,
                armed=is_armed(m.base_mode),
                mode=mode_name(m.autopilot, m.type, m.custom_mode),
            )
        ]

    def extended_sys_state(self, m: wire.ExtendedSysState, arrival_s: float) -> list[AnySample]:
        return [LandedSample(time_s=arrival_s, arrival_s=arrival_s, landed_state=m.landed_state)]

    def sys_status(self, m: wire.SysStatus, arrival_s: float) -> list[AnySample]:
        self.has_pitot = bool(m.onboard_control_sensors_present & SENSOR_DIFFERENTIAL_PRESSURE)
        voltage_v = math.nan if m.voltage_battery == UINT16_UNKNOWN else m.voltage_battery * V_PER_MV
        return self._battery(1, arrival_s, voltage_v, m.current_battery, m.battery_remaining)

    def battery_status(self, m: wire.BatteryStatus, arrival_s: float) -> list[AnySample]:
        if m.id != 0:
            return []
        # An absent cell is 65535 in the first ten and 0 in the extension.
        cells_mv = [cell for cell in m.voltages if cell != UINT16_UNKNOWN] + list(m.voltages_ext)
        voltage_v = sum(cells_mv) * V_PER_MV if any(cells_mv) else math.nan
        return self._battery(0, arrival_s, voltage_v, m.current_battery, m.battery_remaining)

    def _battery(
        self, rank: int, arrival_s: float, voltage_v: float, current_ca: int, remaining_percent: int
    ) -> list[AnySample]:
        if not self._battery_source.takes(rank, arrival_s):
            return []
        return [
            BatterySample(
                time_s=arrival_s,
                arrival_s=arrival_s,
                voltage_v=voltage_v,
                current_a=math.nan if current_ca < 0 else current_ca * A_PER_CA,
                remaining=math.nan if remaining_percent < 0 else remaining_percent * 0.01,
            )
        ]

    def servo_output_raw(self, m: wire.ServoOutputRaw, arrival_s: float) -> list[AnySample]:
        if m.port != 0:
            return []
        outputs = (
            m.servo1_raw,
            m.servo2_raw,
            m.servo3_raw,
            m.servo4_raw,
            m.servo5_raw,
            m.servo6_raw,
            m.servo7_raw,
            m.servo8_raw,
        )
        return self._actuators(1, m.time_usec, arrival_s, outputs)

    def actuator_output_status(self, m: wire.ActuatorOutputStatus, arrival_s: float) -> list[AnySample]:
        return self._actuators(0, m.time_usec, arrival_s, m.actuator[:OUTPUTS])

    def _actuators(self, rank: int, stamp_us: int, arrival_s: float, outputs: tuple[float, ...]) -> list[AnySample]:
        if not self.all_finite(*outputs) or not self._actuator_source.takes(rank, arrival_s):
            return []
        time_s = boot_time_s(stamp_us * S_PER_US, arrival_s)
        return [ActuatorSample(time_s=time_s, arrival_s=arrival_s, outputs=tuple(map(float, outputs)))]

    def statustext(self, m: wire.Statustext, arrival_s: float) -> list[AnySample]:
        return [
            StatusTextSample(time_s=arrival_s, arrival_s=arrival_s, severity=severity, text=text)
            for severity, text in self._texts.add(m.severity, m.text, m.id, m.chunk_seq)
        ]

    def home_position(self, m: wire.HomePosition, arrival_s: float) -> list[AnySample]:
        # ArduPilot sends NaN for the local part until its own origin is set.
        return [
            HomeSample(
                time_s=boot_time_s(m.time_usec * S_PER_US, arrival_s),
                arrival_s=arrival_s,
                latitude_rad=m.latitude * RAD_PER_DEGE7,
                longitude_rad=m.longitude * RAD_PER_DEGE7,
                height_m=m.altitude * M_PER_MM,
                position_ned_m=(m.x, m.y, m.z),
            )
        ]

    def gps_global_origin(self, m: wire.GpsGlobalOrigin, arrival_s: float) -> list[AnySample]:
        return [
            OriginSample(
                time_s=boot_time_s(m.time_usec * S_PER_US, arrival_s),
                arrival_s=arrival_s,
                latitude_rad=m.latitude * RAD_PER_DEGE7,
                longitude_rad=m.longitude * RAD_PER_DEGE7,
                height_m=m.altitude * M_PER_MM,
            )
        ]

    def command_ack(self, m: wire.CommandAck, arrival_s: float) -> list[AnySample]:
        return [CommandAckSample(time_s=arrival_s, arrival_s=arrival_s, command=m.command, result=m.result)]
