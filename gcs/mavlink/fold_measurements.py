"""The fold of measurements: inertial, magnetic, pressure, range, satellite and motion-capture messages to samples."""

from __future__ import annotations

import math

from gcs.mavlink import messages as wire
from gcs.mavlink.modes import AUTOPILOT_ARDUPILOT, AUTOPILOT_UNKNOWN
from gcs.mavlink.sources import FoldPart, RepeatFilter, SourceChoice, boot_time_s, euler_to_quaternion
from models.frames import STANDARD_GRAVITY_M_S2, Quaternion, Vec3
from models.samples import (
    AirspeedSample,
    AnySample,
    BarometerSample,
    GnssSample,
    ImuSample,
    MagnetometerSample,
    PoseSample,
    RangeSample,
)

S_PER_US = 1e-6
S_PER_MS = 1e-3
RAD_PER_DEGE7 = math.radians(1e-7)
RAD_PER_CDEG = math.radians(1e-2)
RAD_S_PER_MRAD_S = 1e-3
M_PER_MM = 1e-3
M_PER_CM = 1e-2
M_S2_PER_MG = STANDARD_GRAVITY_M_S2 * 1e-3
T_PER_GAUSS = 1e-4
T_PER_MGAUSS = 1e-7
PA_PER_HPA = 100.0
KELVIN_AT_0_DEGC = 273.15

UINT16_UNKNOWN = 65535
SATELLITES_UNKNOWN = 255
FIX_2D = 2
ORIENTATION_DOWN = 25
SIGNAL_INVALID = 1

# HIGHRES_IMU.fields_updated
UPDATED_IMU = 0x003F
UPDATED_MAGNETOMETER = 0x01C0
UPDATED_PRESSURE = 0x0200
UPDATED_DIFFERENTIAL_PRESSURE = 0x0400

# ArduPilot sends HIGHRES_IMU's field in micro-gauss; no field a vehicle can meet exceeds this many gauss.
MAX_FIELD_GAUSS = 50.0
T_PER_MICROGAUSS = 1e-10


class MeasurementFold(FoldPart):
    """Measurements of one vehicle; ``autopilot`` and ``has_pitot`` say how to read its messages."""

    def __init__(self, autopilot: int, has_pitot: bool) -> None:
        super().__init__()
        self.autopilot = autopilot
        self.has_pitot = has_pitot
        self._imu_source = SourceChoice()
        self._imu_time_s = -math.inf
        self._gnss_stamp_us = -1
        self._magnetometer_source = SourceChoice()
        self._magnetometer_repeat = RepeatFilter()
        self._barometer_source = SourceChoice()
        self._barometer_repeat = RepeatFilter()
        self._airspeed_source = SourceChoice()

    # Inertial, magnetic and pressure measurements

    def highres_imu(self, m: wire.HighresImu, arrival_s: float) -> list[AnySample]:
        if m.id != 0:
            return []
        time_s = boot_time_s(m.time_usec * S_PER_US, arrival_s)
        updated = m.fields_updated
        samples: list[AnySample] = []
        if updated & UPDATED_IMU == UPDATED_IMU:
            gyro, accel = (m.xgyro, m.ygyro, m.zgyro), (m.xacc, m.yacc, m.zacc)
            samples += self._imu(0, time_s, arrival_s, gyro, accel)
        if updated & UPDATED_MAGNETOMETER == UPDATED_MAGNETOMETER:
            field = (m.xmag, m.ymag, m.zmag)
            scale = T_PER_GAUSS if max(map(abs, field)) <= MAX_FIELD_GAUSS else T_PER_MICROGAUSS
            samples += self._magnetometer(0, time_s, arrival_s, field, scale)
        if updated & UPDATED_PRESSURE:
            samples += self._barometer(0, time_s, arrival_s, m.abs_pressure, m.temperature)
        # ArduPilot leaves garbage in diff_pressure and sends the pitot's value in SCALED_PRESSURE.
        if updated & UPDATED_DIFFERENTIAL_PRESSURE and self.autopilot not in (AUTOPILOT_UNKNOWN, AUTOPILOT_ARDUPILOT):
            samples += self._airspeed(0, time_s, arrival_s, m.diff_pressure)
        return samples

    def raw_imu(self, m: wire.RawImu, arrival_s: float) -> list[AnySample]:
        # The message has no units of its own; ArduPilot's are those of SCALED_IMU.
        if self.autopilot != AUTOPILOT_ARDUPILOT or m.id != 0:
            return []
        return self._integer_imu(1, boot_time_s(m.time_usec * S_PER_US, arrival_s), arrival_s, m)

    def scaled_imu(self, m: wire.ScaledImu, arrival_s: float) -> list[AnySample]:
        return self._integer_imu(2, m.time_boot_ms * S_PER_MS, arrival_s, m)

    def scaled_imu2(self, m: wire.ScaledImu2, arrival_s: float) -> list[AnySample]:
        return self._integer_imu(3, m.time_boot_ms * S_PER_MS, arrival_s, m)

    def _integer_imu(
        self, rank: int, time_s: float, arrival_s: float, m: wire.RawImu | wire.ScaledImu | wire.ScaledImu2
    ) -> list[AnySample]:
        gyro = (m.xgyro * RAD_S_PER_MRAD_S, m.ygyro * RAD_S_PER_MRAD_S, m.zgyro * RAD_S_PER_MRAD_S)
        accel = (m.xacc * M_S2_PER_MG, m.yacc * M_S2_PER_MG, m.zacc * M_S2_PER_MG)
        samples = self._imu(rank, time_s, arrival_s, gyro, accel)
        if m.xmag or m.ymag or m.zmag:
            samples += self._magnetometer(rank, time_s, arrival_s, (m.xmag, m.ymag, m.zmag), T_PER_MGAUSS)
        return samples

    def _imu(self, rank: int, time_s: float, arrival_s: float, gyro: Vec3, accel: Vec3) -> list[AnySample]:
        if not self.all_finite(*gyro, *accel) or not self._imu_source.takes(rank, arrival_s):
            return []
        if time_s == self._imu_time_s:
            return []
        self._imu_time_s = time_s
        return [ImuSample(time_s=time_s, arrival_s=arrival_s, gyro_body_rad_s=gyro, accel_body_m_s2=accel)]

    def _magnetometer(
        self, rank: int, time_s: float, arrival_s: float, field: Vec3, tesla_per_unit: float
    ) -> list[AnySample]:
        if not self.all_finite(*field) or not self._magnetometer_source.takes(rank, arrival_s):
            return []
        if not self._magnetometer_repeat.is_new(field, time_s):
            return []
        field_t = (field[0] * tesla_per_unit, field[1] * tesla_per_unit, field[2] * tesla_per_unit)
        return [MagnetometerSample(time_s=time_s, arrival_s=arrival_s, field_body_t=field_t)]

    def _barometer(
        self, rank: int, time_s: float, arrival_s: float, pressure_hpa: float, temperature_degc: float
    ) -> list[AnySample]:
        if not self.all_finite(pressure_hpa, temperature_degc) or not self._barometer_source.takes(rank, arrival_s):
            return []
        if pressure_hpa <= 0.0 or not self._barometer_repeat.is_new((pressure_hpa,), time_s):
            return []
        return [
            BarometerSample(
                time_s=time_s,
                arrival_s=arrival_s,
                pressure_pa=pressure_hpa * PA_PER_HPA,
                temperature_k=temperature_degc + KELVIN_AT_0_DEGC,
            )
        ]

    def _airspeed(self, rank: int, time_s: float, arrival_s: float, pressure_hpa: float) -> list[AnySample]:
        if not self.all_finite(pressure_hpa) or not self._airspeed_source.takes(rank, arrival_s):
            return []
        pressure_pa = pressure_hpa * PA_PER_HPA
        return [AirspeedSample(time_s=time_s, arrival_s=arrival_s, differential_pressure_pa=pressure_pa)]

    def scaled_pressure(self, m: wire.ScaledPressure, arrival_s: float) -> list[AnySample]:
        time_s = m.time_boot_ms * S_PER_MS
        samples = self._barometer(1, time_s, arrival_s, m.press_abs, m.temperature * 0.01)
        if self.has_pitot:
            samples += self._airspeed(1, time_s, arrival_s, m.press_diff)
        return samples

    def distance_sensor(self, m: wire.DistanceSensor, arrival_s: float) -> list[AnySample]:
        if m.orientation != ORIENTATION_DOWN or m.signal_quality == SIGNAL_INVALID:
            return []
        return [
            RangeSample(
                time_s=m.time_boot_ms * S_PER_MS,
                arrival_s=arrival_s,
                distance_m=m.current_distance * M_PER_CM,
                min_m=m.min_distance * M_PER_CM,
                max_m=m.max_distance * M_PER_CM,
            )
        ]

    # Position sources

    def gps_raw_int(self, m: wire.GpsRawInt, arrival_s: float) -> list[AnySample]:
        if m.fix_type < FIX_2D or m.time_usec == self._gnss_stamp_us:
            return []
        self._gnss_stamp_us = m.time_usec
        velocity: Vec3 | None = None
        if UINT16_UNKNOWN not in (m.vel, m.cog):
            speed_m_s, course_rad = m.vel * M_PER_CM, m.cog * RAD_PER_CDEG
            # The receiver's climb rate is not in this message; NaN says that a component was not measured.
            velocity = (speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad), math.nan)
        return [
            GnssSample(
                time_s=boot_time_s(m.time_usec * S_PER_US, arrival_s),
                arrival_s=arrival_s,
                latitude_rad=m.lat * RAD_PER_DEGE7,
                longitude_rad=m.lon * RAD_PER_DEGE7,
                height_m=m.alt * M_PER_MM,
                velocity_ned_m_s=velocity,
                fix_type=m.fix_type,
                satellites=0 if m.satellites_visible == SATELLITES_UNKNOWN else m.satellites_visible,
                horizontal_std_m=m.h_acc * M_PER_MM,
                vertical_std_m=m.v_acc * M_PER_MM,
                speed_std_m_s=m.vel_acc * M_PER_MM,
                yaw_rad=None if m.yaw in (0, UINT16_UNKNOWN) else m.yaw * RAD_PER_CDEG,
            )
        ]

    def vision_position_estimate(self, m: wire.VisionPositionEstimate, arrival_s: float) -> list[AnySample]:
        return self._pose(m.usec, arrival_s, (m.x, m.y, m.z), euler_to_quaternion(m.roll, m.pitch, m.yaw))

    def att_pos_mocap(self, m: wire.AttPosMocap, arrival_s: float) -> list[AnySample]:
        return self._pose(m.time_usec, arrival_s, (m.x, m.y, m.z), (m.q[0], m.q[1], m.q[2], m.q[3]))

    def _pose(self, stamp_us: int, arrival_s: float, position: Vec3, quaternion: Quaternion) -> list[AnySample]:
        if not self.all_finite(*position, *quaternion):
            return []
        time_s = boot_time_s(stamp_us * S_PER_US, arrival_s)
        return [PoseSample(time_s=time_s, arrival_s=arrival_s, position_ned_m=position, ned_from_body=quaternion)]
