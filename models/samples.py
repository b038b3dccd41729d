"""What a vehicle tells us: one frozen type per kind of sample, as estimators and the offboard tick receive them.

Every sample carries the time it was measured and the time it arrived, both on the vehicle clock [s]. Values are SI
and radians; vectors are plain tuples, so that a sample is immutable, hashable and cheap to record. Nothing here is
truth: simulated truth has no type on this floor.
"""

from __future__ import annotations

import msgspec

from models.arrays import Quaternion, Vec3


class Sample(msgspec.Struct, frozen=True, gc=False, array_like=True, tag_field="kind", kw_only=True):
    """Base of all samples: measurement time and arrival time, both on the vehicle clock [s]."""

    time_s: float
    arrival_s: float


class ImuSample(Sample, frozen=True, gc=False, array_like=True, tag="imu", kw_only=True):
    """Angular rate [rad/s] and specific force [m/s^2] in the body frame (frd)."""

    gyro_body_rad_s: Vec3
    accel_body_m_s2: Vec3


class GnssSample(Sample, frozen=True, gc=False, array_like=True, tag="gnss", kw_only=True):
    """Position fix; velocity is None where the receiver gives none. Standard deviations are 1-sigma, 0 if unknown.

    A component of velocity that was not measured is NaN: GPS_RAW_INT carries no vertical velocity, so down is NaN.
    """

    latitude_rad: float
    longitude_rad: float
    height_m: float
    velocity_ned_m_s: Vec3 | None
    fix_type: int
    satellites: int
    horizontal_std_m: float
    vertical_std_m: float
    speed_std_m_s: float
    yaw_rad: float | None = None


class PoseSample(Sample, frozen=True, gc=False, array_like=True, tag="pose", kw_only=True):
    """Motion-capture or vision pose in the local NED frame."""

    position_ned_m: Vec3
    ned_from_body: Quaternion


class MagnetometerSample(Sample, frozen=True, gc=False, array_like=True, tag="magnetometer", kw_only=True):
    """Magnetic flux density in the body frame [T]."""

    field_body_t: Vec3


class BarometerSample(Sample, frozen=True, gc=False, array_like=True, tag="barometer", kw_only=True):
    """Static pressure [Pa] and air temperature [K]."""

    pressure_pa: float
    temperature_k: float


class AirspeedSample(Sample, frozen=True, gc=False, array_like=True, tag="airspeed", kw_only=True):
    """Pitot differential pressure [Pa]."""

    differential_pressure_pa: float


class RangeSample(Sample, frozen=True, gc=False, array_like=True, tag="range", kw_only=True):
    """Distance to the ground along body z [m], valid between its two limits."""

    distance_m: float
    min_m: float
    max_m: float


class AutopilotAttitudeSample(Sample, frozen=True, gc=False, array_like=True, tag="autopilot_attitude", kw_only=True):
    """The autopilot's own attitude and body rates: shown and compared, never fused."""

    ned_from_body: Quaternion
    rates_body_rad_s: Vec3


class AutopilotPositionSample(Sample, frozen=True, gc=False, array_like=True, tag="autopilot_position", kw_only=True):
    """The autopilot's own local position and velocity: shown and compared, never fused."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3


class HeartbeatSample(Sample, frozen=True, gc=False, array_like=True, tag="heartbeat", kw_only=True):
    """MAVLink HEARTBEAT of the vehicle, numbers as on the wire; ``mode`` is its name in the autopilot's own words."""

    autopilot: int
    vehicle_type: int
    base_mode: int
    custom_mode: int
    system_status: int
    armed: bool
    mode: str


class LandedSample(Sample, frozen=True, gc=False, array_like=True, tag="landed", kw_only=True):
    """EXTENDED_SYS_STATE landed state: 0 undefined, 1 on ground, 2 in air, 3 taking off, 4 landing."""

    landed_state: int


class BatterySample(Sample, frozen=True, gc=False, array_like=True, tag="battery", kw_only=True):
    """Battery voltage [V], current [A], remaining charge 0..1; NaN where not reported."""

    voltage_v: float
    current_a: float
    remaining: float


class ActuatorSample(Sample, frozen=True, gc=False, array_like=True, tag="actuator", kw_only=True):
    """Actuator outputs as the vehicle reports them (ACTUATOR_OUTPUT_STATUS or SERVO_OUTPUT_RAW), first eight."""

    outputs: tuple[float, ...]


class StatusTextSample(Sample, frozen=True, gc=False, array_like=True, tag="status_text", kw_only=True):
    """A STATUSTEXT of the vehicle; severity as in MAV_SEVERITY, 0 (emergency) to 7 (debug)."""

    severity: int
    text: str


class HomeSample(Sample, frozen=True, gc=False, array_like=True, tag="home", kw_only=True):
    """HOME_POSITION: geodetic home and where the vehicle's local frame puts it."""

    latitude_rad: float
    longitude_rad: float
    height_m: float
    position_ned_m: Vec3


class OriginSample(Sample, frozen=True, gc=False, array_like=True, tag="origin", kw_only=True):
    """GPS_GLOBAL_ORIGIN: where the autopilot puts the origin of its local frame."""

    latitude_rad: float
    longitude_rad: float
    height_m: float


class CommandAckSample(Sample, frozen=True, gc=False, array_like=True, tag="command_ack", kw_only=True):
    """COMMAND_ACK: command and MAV_RESULT numbers."""

    command: int
    result: int


AnySample = (
    ImuSample
    | GnssSample
    | PoseSample
    | MagnetometerSample
    | BarometerSample
    | AirspeedSample
    | RangeSample
    | AutopilotAttitudeSample
    | AutopilotPositionSample
    | HeartbeatSample
    | LandedSample
    | BatterySample
    | ActuatorSample
    | StatusTextSample
    | HomeSample
    | OriginSample
    | CommandAckSample
)
