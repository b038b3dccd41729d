"""Payloads of everything the vehicle reports: its sensors' readings and its autopilot's own estimate.

Truth leaves the vehicle in SIM_STATE alone, which nobody receives unless they ask. Times are vehicle time since
power-on. Streams of a sensor go out when it hands over a reading; the others at their interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from models.frames import Geodetic, euler_from_quaternion, geodetic_from_ned
from sitl.autopilot import Autopilot
from sitl.modes import Mode
from sitl.navigation import Navigation
from sitl.sensors import SensorConfig, Sensors
from sitl.vehicle import TICK_S, QuadrotorVehicle
from sitl.wire import Layout, layout

MOCAP_COMPONENT = 197
UNIX_START_US = 1_767_225_600_000_000  # 2026-01-01: a fixed date keeps a seed's bytes the same
# Present, enabled and healthy: gyro, accel, magnetometer, pressure, all control loops, motors, AHRS, battery.
_HEALTH = 0b1111 | 0b111111 << 10 | 1 << 21 | 1 << 25 | 1 << 28
_HEALTH_GNSS, _HEALTH_VISION, _HEALTH_RANGE = 1 << 5, 1 << 7, 1 << 8
_HEALTH_FENCE = 1 << 20  # there is none, so none is breached; MAVProxy looks at this bit alone
_QUADROTOR, _PX4 = 2, 12
_UNKNOWN_COVARIANCE = (math.nan, *[0.0] * 20)


class ImuCursor:
    """Where one link's HIGHRES_IMU stream has read the inertial sensor to, and which slower readings it has sent."""

    __slots__ = ("barometer_count", "integral", "magnetometer_count", "tick")

    def __init__(self, vehicle: QuadrotorVehicle) -> None:
        self.tick = vehicle.tick
        self.integral: list[float] = vehicle.imu_integral.tolist()
        self.magnetometer_count = 0
        self.barometer_count = 0


Build = Callable[["Telemetry", ImuCursor], bytes]


class Stream(NamedTuple):
    """A message the vehicle can stream: default rate (0: on request only) and how its payload is made.

    ``sensor`` names the sensor whose readings drive it, if any.
    """

    message: Layout
    default_hz: float
    build: Build
    sensor: str | None = None
    component: int = 1


class Telemetry:
    """Builds payloads from the vehicle as it is now."""

    def __init__(
        self,
        vehicle: QuadrotorVehicle,
        navigation: Navigation,
        sensors: Sensors,
        sensor_config: SensorConfig,
        autopilot: Autopilot,
        origin: Geodetic,
    ) -> None:
        self._vehicle = vehicle
        self._navigation = navigation
        self._sensors = sensors
        self._sensor_config = sensor_config
        self._autopilot = autopilot
        self._origin = origin

    def _boot_ms(self) -> int:
        return self._vehicle.time_us // 1000

    def _geodetic(self, position: tuple[float, float, float]) -> tuple[int, int, float]:
        point = geodetic_from_ned(position, self._origin)
        return (
            round(math.degrees(point.latitude_rad) * 1e7),
            round(math.degrees(point.longitude_rad) * 1e7),
            point.height_m,
        )

    def heartbeat(self, _: ImuCursor) -> bytes:
        autopilot = self._autopilot
        base = 1 | (128 if autopilot.armed else 0)
        status = 4 if autopilot.armed else 3
        return HEARTBEAT.pack(autopilot.mode.custom_mode, _QUADROTOR, _PX4, base, status, 3)

    def highres_imu(self, cursor: ImuCursor) -> bytes:
        """Mean rates and specific force since this link's previous sample, stamped at the end of that interval."""
        vehicle = self._vehicle
        now = vehicle.imu_integral.tolist()
        rate = 1.0 / (max(1, vehicle.tick - cursor.tick) * TICK_S)
        gx, gy, gz, ax, ay, az = ((b - a) * rate for a, b in zip(cursor.integral, now, strict=True))
        cursor.integral, cursor.tick = now, vehicle.tick
        updated = 0b111111
        magnetometer, barometer = self._sensors.magnetometer, self._sensors.barometer
        mx = my = mz = pressure = height = temperature = 0.0
        if magnetometer.latest is not None:
            mx, my, mz = magnetometer.latest.field_body_t
            if magnetometer.count != cursor.magnetometer_count:
                cursor.magnetometer_count = magnetometer.count
                updated |= 0b111 << 6
        if barometer.latest is not None:
            pressure, temperature = barometer.latest.pressure_pa, barometer.latest.temperature_k - 273.15
            height = 44330.8 * (1.0 - (pressure / 101325.0) ** 0.190263)
            if barometer.count != cursor.barometer_count:
                cursor.barometer_count = barometer.count
                updated |= 0b1101 << 9
        # Gauss and hectopascal, as the message wants.
        return HIGHRES_IMU.pack(
            *(vehicle.time_us, ax, ay, az, gx, gy, gz, mx * 1e4, my * 1e4, mz * 1e4),
            *(pressure * 0.01, 0.0, height, temperature, updated, 0),
        )

    def gps_raw_int(self, _: ImuCursor) -> bytes:
        fix, config = self._sensors.gnss.latest, self._sensor_config.gnss
        if fix is None:
            return GPS_RAW_INT.pack(self._vehicle.time_us, 0, 0, 0, 65535, 65535, 65535, 65535, 1, 0, 0, 0, 0, 0, 0, 0)
        latitude, longitude, height = self._geodetic(fix.position_ned_m)
        north, east, _down = fix.velocity_ned_m_s
        course = round(math.degrees(math.atan2(east, north)) * 100.0) % 36000
        accuracy, millimetres = round(1000.0 * config.position_noise_m), round(1000.0 * height)
        return GPS_RAW_INT.pack(
            *(fix.time_us, latitude, longitude, millimetres, 80, 120, round(100.0 * math.hypot(north, east)), course),
            *(3, 14, millimetres, accuracy, accuracy, round(1000.0 * config.velocity_noise_m_s), 0, 0),
        )

    def vision_position_estimate(self, _: ImuCursor) -> bytes:
        pose, config = self._sensors.mocap.latest, self._sensor_config.mocap
        if pose is None:
            return b""
        covariance = [0.0] * 21
        for i, sigma in zip((0, 6, 11), [config.position_noise_m] * 3, strict=True):
            covariance[i] = sigma**2
        for i, sigma in zip((15, 18, 20), (*[config.roll_pitch_noise_rad] * 2, config.yaw_noise_rad), strict=True):
            covariance[i] = sigma**2
        return VISION_POSITION_ESTIMATE.pack(pose.time_us, *pose.position_ned_m, *pose.euler_rad, *covariance, 0)

    def distance_sensor(self, _: ImuCursor) -> bytes:
        reading, config = self._sensors.range.latest, self._sensor_config.range
        if reading is None:
            return b""
        low, high = round(100.0 * config.min_m), round(100.0 * config.max_m)
        covariance = round(1e4 * config.noise_m**2)
        return DISTANCE_SENSOR.pack(
            *(reading.time_us // 1000, low, high, round(100.0 * reading.distance_m), 1, 0, 25, covariance),
            *(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0),
        )

    def scaled_pressure(self, _: ImuCursor) -> bytes:
        reading = self._sensors.barometer.latest
        if reading is None:
            return b""
        centidegrees = round(100.0 * (reading.temperature_k - 273.15))
        return SCALED_PRESSURE.pack(reading.time_us // 1000, reading.pressure_pa * 0.01, 0.0, centidegrees, 0)

    def attitude(self, _: ImuCursor) -> bytes:
        nav = self._navigation.state()
        return ATTITUDE.pack(self._boot_ms(), *nav.euler_rad, *nav.rates_body_rad_s)

    def attitude_quaternion(self, _: ImuCursor) -> bytes:
        nav = self._navigation.state()
        return ATTITUDE_QUATERNION.pack(self._boot_ms(), *nav.ned_from_body, *nav.rates_body_rad_s, 0.0, 0.0, 0.0, 0.0)

    def local_position_ned(self, _: ImuCursor) -> bytes:
        nav = self._navigation.state()
        return LOCAL_POSITION_NED.pack(self._boot_ms(), *nav.position_ned_m, *nav.velocity_ned_m_s)

    def global_position_int(self, _: ImuCursor) -> bytes:
        nav = self._navigation.state()
        latitude, longitude, height = self._geodetic(nav.position_ned_m)
        relative = self._autopilot.home_ned_m[2] - nav.position_ned_m[2]
        vn, ve, vd = (round(100.0 * v) for v in nav.velocity_ned_m_s)
        heading = round(math.degrees(nav.euler_rad[2]) * 100.0) % 36000
        return GLOBAL_POSITION_INT.pack(
            *(self._boot_ms(), latitude, longitude, round(1000.0 * height), round(1000.0 * relative)),
            *(vn, ve, vd, heading),
        )

    def odometry(self, _: ImuCursor) -> bytes:
        """Pose in local NED, velocity in body axes."""
        nav = self._navigation.state()
        w, x, y, z = nav.ned_from_body
        vn, ve, vd = nav.velocity_ned_m_s
        body = (
            (w * w + x * x - y * y - z * z) * vn + 2.0 * (x * y + w * z) * ve + 2.0 * (x * z - w * y) * vd,
            2.0 * (x * y - w * z) * vn + (w * w - x * x + y * y - z * z) * ve + 2.0 * (y * z + w * x) * vd,
            2.0 * (x * z + w * y) * vn + 2.0 * (y * z - w * x) * ve + (w * w - x * x - y * y + z * z) * vd,
        )
        return ODOMETRY.pack(
            *(self._vehicle.time_us, *nav.position_ned_m, w, x, y, z, *body, *nav.rates_body_rad_s),
            *(*_UNKNOWN_COVARIANCE, *_UNKNOWN_COVARIANCE, 1, 12, 0, 3, 100),
        )

    def battery_status(self, _: ImuCursor) -> bytes:
        battery = self._sensors.battery.latest
        if battery is None:
            return b""
        cell = round(250.0 * battery.voltage_v)
        return BATTERY_STATUS.pack(
            *(round(battery.used_a_s / 3.6), round(battery.used_j / 100.0), 32767, *[cell] * 4, *[65535] * 6),
            *(round(100.0 * battery.current_a), 0, 1, 1, round(100.0 * battery.remaining), 0, 1, 0, 0, 0, 0, 0, 0),
        )

    def sys_status(self, _: ImuCursor) -> bytes:
        battery, sensors = self._sensors.battery.latest, self._sensors
        present = _HEALTH
        for enabled, bit in (
            (sensors.gnss.latest is not None, _HEALTH_GNSS),
            (sensors.mocap.latest is not None, _HEALTH_VISION),
            (sensors.range.latest is not None, _HEALTH_RANGE),
        ):
            present |= bit if enabled else 0
        millivolts, centiamps, percent = 65535, -1, -1
        if battery is not None:
            millivolts, centiamps = round(1000.0 * battery.voltage_v), round(100.0 * battery.current_a)
            percent = round(100.0 * battery.remaining)
        return SYS_STATUS.pack(
            *(present, present, present | _HEALTH_FENCE, 200, millivolts, centiamps, 0, 0, 0, 0, 0, 0, percent, 0, 0, 0)
        )

    def extended_sys_state(self, _: ImuCursor) -> bytes:
        return EXTENDED_SYS_STATE.pack(0, self._autopilot.landed_state)

    def home_position(self, _: ImuCursor) -> bytes:
        home = self._autopilot.home_ned_m
        latitude, longitude, height = self._geodetic(home)
        return HOME_POSITION.pack(
            *(latitude, longitude, round(1000.0 * height), *home, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            self._vehicle.time_us,
        )

    def gps_global_origin(self, _: ImuCursor) -> bytes:
        latitude, longitude, height = self._geodetic((0.0, 0.0, 0.0))
        return GPS_GLOBAL_ORIGIN.pack(latitude, longitude, round(1000.0 * height), self._vehicle.time_us)

    def altitude(self, _: ImuCursor) -> bytes:
        down = self._navigation.state().position_ned_m[2]
        amsl, relative = self._origin.height_m - down, self._autopilot.home_ned_m[2] - down
        return ALTITUDE.pack(self._vehicle.time_us, amsl, amsl, -down, relative, relative, relative)

    def system_time(self, _: ImuCursor) -> bytes:
        return SYSTEM_TIME.pack(UNIX_START_US + self._vehicle.time_us, self._boot_ms())

    def vfr_hud(self, _: ImuCursor) -> bytes:
        nav = self._navigation.state()
        north, east, down = nav.velocity_ned_m_s
        speed, height = math.hypot(north, east), self._origin.height_m - nav.position_ned_m[2]
        heading = round(math.degrees(nav.euler_rad[2])) % 360
        return VFR_HUD.pack(speed, speed, height, -down, heading, round(100.0 * sum(self._outputs()) / 4.0))

    def _outputs(self) -> list[float]:
        parameters = self._vehicle.parameters
        fastest = math.sqrt(parameters.rotor_max_force_n / parameters.rotor_force_coefficient_n_s2)
        return [speed / fastest for speed in self._vehicle.rotor_command_rad_s.tolist()]

    def actuator_output_status(self, _: ImuCursor) -> bytes:
        """Rotor speed commands as fractions of the fastest."""
        return ACTUATOR_OUTPUT_STATUS.pack(self._vehicle.time_us, 4, *self._outputs(), *[0.0] * 28)

    def servo_output_raw(self, _: ImuCursor) -> bytes:
        """1000 us stopped to 2000 us fastest; 900 us disarmed."""
        pulses = [round(1000.0 + 1000.0 * u) if self._autopilot.armed else 900 for u in self._outputs()]
        return SERVO_OUTPUT_RAW.pack(self._vehicle.time_us & 0xFFFFFFFF, *pulses, *[0] * 4, 0, *[0] * 8)

    def attitude_target(self, _: ImuCursor) -> bytes:
        """The attitude the inner loop follows; meaningful in modes that command attitude."""
        thrust = float(self._vehicle.command[5]) / self._vehicle.parameters.max_thrust_n
        return ATTITUDE_TARGET.pack(self._boot_ms(), *self._autopilot.attitude_target, 0.0, 0.0, 0.0, thrust, 7)

    def estimator_status(self, _: ImuCursor) -> bytes:
        """Attitude, velocities and positions good."""
        size = self._navigation.config.position_m
        return ESTIMATOR_STATUS.pack(self._vehicle.time_us, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0, size, size, 0b1100111111)

    def mission_current(self, _: ImuCursor) -> bytes:
        mission = self._autopilot.mission
        state = 1 if not mission.items else 3 if self._autopilot.mode is Mode.MISSION else 2
        return MISSION_CURRENT.pack(min(mission.current, 65535), len(mission.items), state, 0)

    def sim_state(self, _: ImuCursor) -> bytes:
        """Truth: attitude, specific force, rates, position, velocity."""
        state = self._vehicle.state
        latitude, longitude, height = self._geodetic((float(state[0]), float(state[1]), float(state[2])))
        return SIM_STATE.pack(
            *(*state[6:10].tolist(), *euler_from_quaternion(state[6:10]).tolist()),
            *(*self._vehicle.specific_force_body_m_s2, *state[10:13].tolist()),
            *(latitude * 1e-7, longitude * 1e-7, height, 0.0, 0.0, *state[3:6].tolist(), latitude, longitude),
        )


HEARTBEAT = layout("HEARTBEAT")
HIGHRES_IMU = layout("HIGHRES_IMU")
GPS_RAW_INT = layout("GPS_RAW_INT")
VISION_POSITION_ESTIMATE = layout("VISION_POSITION_ESTIMATE")
DISTANCE_SENSOR = layout("DISTANCE_SENSOR")
SCALED_PRESSURE = layout("SCALED_PRESSURE")
ATTITUDE = layout("ATTITUDE")
ATTITUDE_QUATERNION = layout("ATTITUDE_QUATERNION")
LOCAL_POSITION_NED = layout("LOCAL_POSITION_NED")
GLOBAL_POSITION_INT = layout("GLOBAL_POSITION_INT")
ODOMETRY = layout("ODOMETRY")
BATTERY_STATUS = layout("BATTERY_STATUS")
SYS_STATUS = layout("SYS_STATUS")
EXTENDED_SYS_STATE = layout("EXTENDED_SYS_STATE")
HOME_POSITION = layout("HOME_POSITION")
GPS_GLOBAL_ORIGIN = layout("GPS_GLOBAL_ORIGIN")
ALTITUDE = layout("ALTITUDE")
SYSTEM_TIME = layout("SYSTEM_TIME")
VFR_HUD = layout("VFR_HUD")
ACTUATOR_OUTPUT_STATUS = layout("ACTUATOR_OUTPUT_STATUS")
SERVO_OUTPUT_RAW = layout("SERVO_OUTPUT_RAW")
ATTITUDE_TARGET = layout("ATTITUDE_TARGET")
ESTIMATOR_STATUS = layout("ESTIMATOR_STATUS")
MISSION_CURRENT = layout("MISSION_CURRENT")
SIM_STATE = layout("SIM_STATE")

STREAMS: tuple[Stream, ...] = (
    Stream(HEARTBEAT, 1.0, Telemetry.heartbeat),
    Stream(HIGHRES_IMU, 100.0, Telemetry.highres_imu),
    Stream(GPS_RAW_INT, 10.0, Telemetry.gps_raw_int, sensor="gnss"),
    Stream(
        VISION_POSITION_ESTIMATE, 100.0, Telemetry.vision_position_estimate, sensor="mocap", component=MOCAP_COMPONENT
    ),
    Stream(DISTANCE_SENSOR, 20.0, Telemetry.distance_sensor, sensor="range"),
    Stream(SCALED_PRESSURE, 5.0, Telemetry.scaled_pressure, sensor="barometer"),
    Stream(ATTITUDE, 20.0, Telemetry.attitude),
    Stream(ATTITUDE_QUATERNION, 20.0, Telemetry.attitude_quaternion),
    Stream(LOCAL_POSITION_NED, 20.0, Telemetry.local_position_ned),
    Stream(GLOBAL_POSITION_INT, 10.0, Telemetry.global_position_int),
    Stream(ODOMETRY, 0.0, Telemetry.odometry),
    Stream(BATTERY_STATUS, 1.0, Telemetry.battery_status),
    Stream(SYS_STATUS, 1.0, Telemetry.sys_status),
    Stream(EXTENDED_SYS_STATE, 2.0, Telemetry.extended_sys_state),
    Stream(HOME_POSITION, 0.5, Telemetry.home_position),
    Stream(GPS_GLOBAL_ORIGIN, 0.5, Telemetry.gps_global_origin),
    Stream(ALTITUDE, 2.0, Telemetry.altitude),
    Stream(SYSTEM_TIME, 1.0, Telemetry.system_time),
    Stream(VFR_HUD, 4.0, Telemetry.vfr_hud),
    Stream(ACTUATOR_OUTPUT_STATUS, 10.0, Telemetry.actuator_output_status),
    Stream(SERVO_OUTPUT_RAW, 5.0, Telemetry.servo_output_raw),
    Stream(ATTITUDE_TARGET, 0.0, Telemetry.attitude_target),
    Stream(ESTIMATOR_STATUS, 1.0, Telemetry.estimator_status),
    Stream(MISSION_CURRENT, 1.0, Telemetry.mission_current),
    Stream(SIM_STATE, 0.0, Telemetry.sim_state),
)
