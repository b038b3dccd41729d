"""The messages of the hot path, fields in wire order, checked at import against the dialect's own tables.

Values are exactly those on the wire, in the wire's units (degE7, mm, cm/s, hPa, gauss, ...): nothing is converted here.
Conversion to SI and radians happens once, in :mod:`gcs.telemetry`. Arrays are tuples; characters are raw bytes.
"""

from __future__ import annotations

import msgspec


class Heartbeat(msgspec.Struct, frozen=True, gc=False):
    """HEARTBEAT (0)."""

    custom_mode: int
    type: int
    autopilot: int
    base_mode: int
    system_status: int
    mavlink_version: int


class SysStatus(msgspec.Struct, frozen=True, gc=False):
    """SYS_STATUS (1)."""

    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int
    load: int
    voltage_battery: int
    current_battery: int
    drop_rate_comm: int
    errors_comm: int
    errors_count1: int
    errors_count2: int
    errors_count3: int
    errors_count4: int
    battery_remaining: int
    onboard_control_sensors_present_extended: int
    onboard_control_sensors_enabled_extended: int
    onboard_control_sensors_health_extended: int


class SystemTime(msgspec.Struct, frozen=True, gc=False):
    """SYSTEM_TIME (2)."""

    time_unix_usec: int
    time_boot_ms: int


class GpsRawInt(msgspec.Struct, frozen=True, gc=False):
    """GPS_RAW_INT (24)."""

    time_usec: int
    lat: int
    lon: int
    alt: int
    eph: int
    epv: int
    vel: int
    cog: int
    fix_type: int
    satellites_visible: int
    alt_ellipsoid: int
    h_acc: int
    v_acc: int
    vel_acc: int
    hdg_acc: int
    yaw: int


class ScaledImu(msgspec.Struct, frozen=True, gc=False):
    """SCALED_IMU (26)."""

    time_boot_ms: int
    xacc: int
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int
    xmag: int
    ymag: int
    zmag: int
    temperature: int


class RawImu(msgspec.Struct, frozen=True, gc=False):
    """RAW_IMU (27)."""

    time_usec: int
    xacc: int
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int
    xmag: int
    ymag: int
    zmag: int
    id: int
    temperature: int


class ScaledPressure(msgspec.Struct, frozen=True, gc=False):
    """SCALED_PRESSURE (29)."""

    time_boot_ms: int
    press_abs: float
    press_diff: float
    temperature: int
    temperature_press_diff: int


class Attitude(msgspec.Struct, frozen=True, gc=False):
    """ATTITUDE (30)."""

    time_boot_ms: int
    roll: float
    pitch: float
    yaw: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float


class AttitudeQuaternion(msgspec.Struct, frozen=True, gc=False):
    """ATTITUDE_QUATERNION (31)."""

    time_boot_ms: int
    q1: float
    q2: float
    q3: float
    q4: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float
    repr_offset_q: tuple[float, ...]


class LocalPositionNed(msgspec.Struct, frozen=True, gc=False):
    """LOCAL_POSITION_NED (32)."""

    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float


class ServoOutputRaw(msgspec.Struct, frozen=True, gc=False):
    """SERVO_OUTPUT_RAW (36)."""

    time_usec: int
    servo1_raw: int
    servo2_raw: int
    servo3_raw: int
    servo4_raw: int
    servo5_raw: int
    servo6_raw: int
    servo7_raw: int
    servo8_raw: int
    port: int
    servo9_raw: int
    servo10_raw: int
    servo11_raw: int
    servo12_raw: int
    servo13_raw: int
    servo14_raw: int
    servo15_raw: int
    servo16_raw: int


class GpsGlobalOrigin(msgspec.Struct, frozen=True, gc=False):
    """GPS_GLOBAL_ORIGIN (49)."""

    latitude: int
    longitude: int
    altitude: int
    time_usec: int


class CommandAck(msgspec.Struct, frozen=True, gc=False):
    """COMMAND_ACK (77)."""

    command: int
    result: int
    progress: int
    result_param2: int
    target_system: int
    target_component: int


class VisionPositionEstimate(msgspec.Struct, frozen=True, gc=False):
    """VISION_POSITION_ESTIMATE (102)."""

    usec: int
    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float
    covariance: tuple[float, ...]
    reset_counter: int


class HighresImu(msgspec.Struct, frozen=True, gc=False):
    """HIGHRES_IMU (105)."""

    time_usec: int
    xacc: float
    yacc: float
    zacc: float
    xgyro: float
    ygyro: float
    zgyro: float
    xmag: float
    ymag: float
    zmag: float
    abs_pressure: float
    diff_pressure: float
    pressure_alt: float
    temperature: float
    fields_updated: int
    id: int


class SimState(msgspec.Struct, frozen=True, gc=False):
    """SIM_STATE (108)."""

    q1: float
    q2: float
    q3: float
    q4: float
    roll: float
    pitch: float
    yaw: float
    xacc: float
    yacc: float
    zacc: float
    xgyro: float
    ygyro: float
    zgyro: float
    lat: float
    lon: float
    alt: float
    std_dev_horz: float
    std_dev_vert: float
    vn: float
    ve: float
    vd: float
    lat_int: int
    lon_int: int


class Timesync(msgspec.Struct, frozen=True, gc=False):
    """TIMESYNC (111)."""

    tc1: int
    ts1: int


class ScaledImu2(msgspec.Struct, frozen=True, gc=False):
    """SCALED_IMU2 (116)."""

    time_boot_ms: int
    xacc: int
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int
    xmag: int
    ymag: int
    zmag: int
    temperature: int


class DistanceSensor(msgspec.Struct, frozen=True, gc=False):
    """DISTANCE_SENSOR (132)."""

    time_boot_ms: int
    min_distance: int
    max_distance: int
    current_distance: int
    type: int
    id: int
    orientation: int
    covariance: int
    horizontal_fov: float
    vertical_fov: float
    quaternion: tuple[float, ...]
    signal_quality: int


class AttPosMocap(msgspec.Struct, frozen=True, gc=False):
    """ATT_POS_MOCAP (138)."""

    time_usec: int
    q: tuple[float, ...]
    x: float
    y: float
    z: float
    covariance: tuple[float, ...]


class BatteryStatus(msgspec.Struct, frozen=True, gc=False):
    """BATTERY_STATUS (147)."""

    current_consumed: int
    energy_consumed: int
    temperature: int
    voltages: tuple[int, ...]
    current_battery: int
    id: int
    battery_function: int
    type: int
    battery_remaining: int
    time_remaining: int
    charge_state: int
    voltages_ext: tuple[int, ...]
    mode: int
    fault_bitmask: int


class AutopilotVersion(msgspec.Struct, frozen=True, gc=False):
    """AUTOPILOT_VERSION (148)."""

    capabilities: int
    uid: int
    flight_sw_version: int
    middleware_sw_version: int
    os_sw_version: int
    board_version: int
    vendor_id: int
    product_id: int
    flight_custom_version: tuple[int, ...]
    middleware_custom_version: tuple[int, ...]
    os_custom_version: tuple[int, ...]
    uid2: tuple[int, ...]


class HomePosition(msgspec.Struct, frozen=True, gc=False):
    """HOME_POSITION (242)."""

    latitude: int
    longitude: int
    altitude: int
    x: float
    y: float
    z: float
    q: tuple[float, ...]
    approach_x: float
    approach_y: float
    approach_z: float
    time_usec: int


class ExtendedSysState(msgspec.Struct, frozen=True, gc=False):
    """EXTENDED_SYS_STATE (245)."""

    vtol_state: int
    landed_state: int


class Statustext(msgspec.Struct, frozen=True, gc=False):
    """STATUSTEXT (253)."""

    severity: int
    text: bytes
    id: int
    chunk_seq: int


class ActuatorOutputStatus(msgspec.Struct, frozen=True, gc=False):
    """ACTUATOR_OUTPUT_STATUS (375)."""

    time_usec: int
    active: int
    actuator: tuple[float, ...]


Message = (
    Heartbeat
    | SysStatus
    | SystemTime
    | GpsRawInt
    | ScaledImu
    | RawImu
    | ScaledPressure
    | Attitude
    | AttitudeQuaternion
    | LocalPositionNed
    | ServoOutputRaw
    | GpsGlobalOrigin
    | CommandAck
    | VisionPositionEstimate
    | HighresImu
    | SimState
    | Timesync
    | ScaledImu2
    | DistanceSensor
    | AttPosMocap
    | BatteryStatus
    | AutopilotVersion
    | HomePosition
    | ExtendedSysState
    | Statustext
    | ActuatorOutputStatus
)

MESSAGE_TYPES: dict[int, type[Message]] = {
    0: Heartbeat,
    1: SysStatus,
    2: SystemTime,
    24: GpsRawInt,
    26: ScaledImu,
    27: RawImu,
    29: ScaledPressure,
    30: Attitude,
    31: AttitudeQuaternion,
    32: LocalPositionNed,
    36: ServoOutputRaw,
    49: GpsGlobalOrigin,
    77: CommandAck,
    102: VisionPositionEstimate,
    105: HighresImu,
    108: SimState,
    111: Timesync,
    116: ScaledImu2,
    132: DistanceSensor,
    138: AttPosMocap,
    147: BatteryStatus,
    148: AutopilotVersion,
    242: HomePosition,
    245: ExtendedSysState,
    253: Statustext,
    375: ActuatorOutputStatus,
}
