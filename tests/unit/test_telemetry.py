"""The fold: units, dirty inputs, choice of sources, and that every message is accounted for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Decoder
from gcs.telemetry import Telemetry, vehicle_stamp_s
from models.samples import (
    ActuatorSample,
    AirspeedSample,
    AutopilotAttitudeSample,
    AutopilotPositionSample,
    BarometerSample,
    BatterySample,
    CommandAckSample,
    GnssSample,
    HeartbeatSample,
    HomeSample,
    ImuSample,
    LandedSample,
    MagnetometerSample,
    OriginSample,
    PoseSample,
    RangeSample,
    StatusTextSample,
)

PX4, ARDUPILOT = 12, 3
ALL_UPDATED = 0x1FFF
Send = Callable[..., list[Any]]


@pytest.fixture
def telemetry() -> Telemetry:
    return Telemetry()


@pytest.fixture
def send(telemetry: Telemetry) -> Send:
    """Pack a message with pymavlink, decode it with ours, fold it."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = Decoder()

    def pack_and_fold(name: str, *values: Any, at_s: float = 10.0) -> list[Any]:
        message = getattr(mav, f"{name}_encode")(*values)
        (frame,) = decoder.feed(bytes(message.pack(mav)))
        mav.seq = (mav.seq + 1) & 0xFF
        return telemetry.fold(frame, at_s)

    return pack_and_fold


def heartbeat(send: Send, autopilot: int, kind: int = 2, base_mode: int = 81, custom_mode: int = 0) -> list[Any]:
    return send("heartbeat", kind, autopilot, base_mode, custom_mode, 3, 3)


def highres(
    send: Send,
    stamp_us: int = 5_000_000,
    gyro: tuple[float, float, float] = (0.1, 0.2, 0.3),
    accel: tuple[float, float, float] = (1.0, 2.0, -9.5),
    field: tuple[float, float, float] = (0.2, 0.1, -0.5),
    pressures: tuple[float, float] = (950.0, 2.5),
    updated: int = ALL_UPDATED,
    at_s: float = 10.0,
) -> list[Any]:
    return send("highres_imu", stamp_us, *accel, *gyro, *field, *pressures, 100.0, 25.0, updated, at_s=at_s)


def test_highres_imu_in_si(send: Send) -> None:
    heartbeat(send, PX4)
    imu, magnetometer, barometer, airspeed = highres(send)
    assert isinstance(imu, ImuSample)
    assert (imu.time_s, imu.arrival_s) == (5.0, 10.0)
    assert imu.gyro_body_rad_s == pytest.approx((0.1, 0.2, 0.3))
    assert imu.accel_body_m_s2 == pytest.approx((1.0, 2.0, -9.5))
    assert isinstance(magnetometer, MagnetometerSample)
    assert magnetometer.field_body_t == pytest.approx((20e-6, 10e-6, -50e-6))
    assert isinstance(barometer, BarometerSample)
    assert (barometer.pressure_pa, barometer.temperature_k) == (pytest.approx(95000.0), pytest.approx(298.15))
    assert isinstance(airspeed, AirspeedSample)
    assert airspeed.differential_pressure_pa == pytest.approx(250.0)


def test_only_updated_fields_become_samples(send: Send) -> None:
    heartbeat(send, PX4)
    assert [type(sample) for sample in highres(send, updated=0x3F)] == [ImuSample]
    assert [type(sample) for sample in highres(send, stamp_us=5_004_000, updated=0x200)] == [BarometerSample]
    assert highres(send, stamp_us=5_008_000, updated=0x07) == []


def test_ardupilot_field_in_microgauss_and_garbage_pitot(send: Send) -> None:
    heartbeat(send, ARDUPILOT)
    samples = highres(send, field=(224015.5, 80639.2, -528911.7), pressures=(945.0, -79.6))
    assert [type(sample) for sample in samples] == [ImuSample, MagnetometerSample, BarometerSample]
    assert samples[1].field_body_t == pytest.approx((22.40155e-6, 8.06392e-6, -52.89117e-6))


def test_airspeed_of_ardupilot_is_of_scaled_pressure_and_only_with_a_pitot(send: Send) -> None:
    heartbeat(send, ARDUPILOT, kind=1)
    assert not any(isinstance(s, AirspeedSample) for s in send("scaled_pressure", 5000, 945.0, 2.4, 2500))
    send("sys_status", 16, 16, 16, 0, 12600, 100, 90, 0, 0, 0, 0, 0, 0)
    samples = send("scaled_pressure", 5200, 945.0, 2.4, 2500)
    (airspeed,) = [sample for sample in samples if isinstance(sample, AirspeedSample)]
    assert airspeed.differential_pressure_pa == pytest.approx(240.0)
    assert airspeed.time_s == pytest.approx(5.2)


def test_repeated_slow_sensors_are_measured_again_only_when_they_change(send: Send) -> None:
    heartbeat(send, ARDUPILOT)
    counts = []
    for step in range(40):
        field = (0.2 + (step // 10) * 1e-3, 0.1, -0.5)
        samples = highres(send, stamp_us=5_000_000 + 10_000 * step, field=field)
        counts.append(sum(isinstance(sample, MagnetometerSample) for sample in samples))
    assert counts == [1 if step % 10 == 0 else 0 for step in range(40)]
    still = [highres(send, stamp_us=6_000_000 + 10_000 * step) for step in range(60)]
    assert 3 <= sum(isinstance(sample, MagnetometerSample) for samples in still for sample in samples) <= 5


def test_integer_imu_serves_until_a_better_one_is_heard_and_after_it_is_gone(send: Send, telemetry: Telemetry) -> None:
    heartbeat(send, ARDUPILOT)
    raw = (100, -200, -1000, 10, -20, 30, 224, 80, -528)
    imu, magnetometer = send("raw_imu", 4_000_000, *raw, at_s=4.0)
    assert imu.accel_body_m_s2 == pytest.approx((0.980665, -1.96133, -9.80665))
    assert imu.gyro_body_rad_s == pytest.approx((0.01, -0.02, 0.03))
    assert magnetometer.field_body_t == pytest.approx((22.4e-6, 8.0e-6, -52.8e-6))
    highres(send, stamp_us=4_010_000, at_s=4.01)
    assert send("raw_imu", 4_020_000, *raw, at_s=4.02) == []
    assert send("scaled_imu2", 4020, *raw, at_s=4.02) == []
    assert telemetry.repeated["SCALED_IMU2"] == 1
    after = send("scaled_imu2", 6000, *raw, at_s=6.0)
    assert isinstance(after[0], ImuSample)
    assert after[0].time_s == pytest.approx(6.0)


def test_raw_imu_of_px4_has_no_units_and_is_left_alone(send: Send) -> None:
    heartbeat(send, PX4)
    assert send("raw_imu", 4_000_000, 1, 2, 3, 4, 5, 6, 7, 8, 9) == []


def test_same_stamp_twice_is_one_measurement(send: Send, telemetry: Telemetry) -> None:
    heartbeat(send, PX4)
    assert len(highres(send, updated=0x3F)) == 1
    assert highres(send, updated=0x3F) == []
    assert telemetry.repeated["HIGHRES_IMU"] == 1


def test_values_that_are_no_numbers_are_bad(send: Send, telemetry: Telemetry) -> None:
    heartbeat(send, PX4)
    assert highres(send, gyro=(math.nan, 0.0, 0.0), updated=0x3F) == []
    assert send("local_position_ned", 1000, math.inf, 0, 0, 0, 0, 0) == []
    assert send("attitude", 1000, math.nan, 0, 0, 0, 0, 0) == []
    assert telemetry.bad == {"HIGHRES_IMU": 1, "LOCAL_POSITION_NED": 1, "ATTITUDE": 1}


def gps(send: Send, stamp_us: int, **changes: int) -> list[Any]:
    values = {"fix": 3, "eph": 121, "epv": 200, "vel": 500, "cog": 9000, "sats": 10, "vel_acc": 200, "yaw": 0} | changes
    return send(
        "gps_raw_int",
        stamp_us,
        values["fix"],
        473977420,
        85455940,
        488_250,
        values["eph"],
        values["epv"],
        values["vel"],
        values["cog"],
        values["sats"],
        488_000,
        300,
        450,
        values["vel_acc"],
        0,
        values["yaw"],
    )


def test_gnss_in_si_with_accuracy_and_velocity(send: Send) -> None:
    (fix,) = gps(send, 9_800_000)
    assert isinstance(fix, GnssSample)
    assert (fix.time_s, fix.fix_type, fix.satellites) == (pytest.approx(9.8), 3, 10)
    assert fix.latitude_rad == pytest.approx(math.radians(47.397742), abs=1e-12)
    assert fix.longitude_rad == pytest.approx(math.radians(8.545594), abs=1e-12)
    assert fix.height_m == pytest.approx(488.25)
    assert (fix.horizontal_std_m, fix.vertical_std_m, fix.speed_std_m_s) == pytest.approx((0.3, 0.45, 0.2))
    assert fix.velocity_ned_m_s is not None
    assert fix.velocity_ned_m_s[:2] == pytest.approx((0.0, 5.0), abs=1e-12)
    assert math.isnan(fix.velocity_ned_m_s[2])
    assert fix.yaw_rad is None


def test_gnss_without_fix_velocity_or_news(send: Send, telemetry: Telemetry) -> None:
    assert gps(send, 9_800_000, fix=1) == []
    (fix,) = gps(send, 9_800_000, vel=65535, yaw=36000)
    assert fix.velocity_ned_m_s is None
    assert fix.yaw_rad == pytest.approx(2.0 * math.pi)
    assert gps(send, 9_800_000) == []
    assert telemetry.repeated["GPS_RAW_INT"] == 2


def test_stamps_that_count_from_1970_or_not_at_all_become_the_arrival(send: Send) -> None:
    (fix,) = gps(send, 1_790_000_000_000_000)
    assert fix.time_s == 10.0
    (pose,) = send("vision_position_estimate", 0, 1, 2, 3, 0, 0, 0)
    assert pose.time_s == 10.0


def test_poses(send: Send) -> None:
    (vision,) = send("vision_position_estimate", 9_900_000, 1.0, 2.0, -3.0, 0.0, 0.0, math.pi / 2)
    assert isinstance(vision, PoseSample)
    assert (vision.time_s, vision.position_ned_m) == (pytest.approx(9.9), (1.0, 2.0, -3.0))
    assert vision.ned_from_body == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    (mocap,) = send("att_pos_mocap", 9_950_000, [0.5, 0.5, -0.5, 0.5], 4.0, 5.0, 6.0)
    assert (mocap.ned_from_body, mocap.position_ned_m) == ((0.5, 0.5, -0.5, 0.5), (4.0, 5.0, 6.0))


def test_range_only_downwards(send: Send) -> None:
    (down,) = send("distance_sensor", 9000, 20, 1200, 345, 0, 0, 25, 0)
    assert isinstance(down, RangeSample)
    assert (down.distance_m, down.min_m, down.max_m) == pytest.approx((3.45, 0.2, 12.0))
    assert send("distance_sensor", 9000, 20, 1200, 345, 0, 0, 0, 0) == []


def test_autopilot_estimates(send: Send) -> None:
    (position,) = send("local_position_ned", 9000, 1, 2, -3, 4, 5, -6)
    assert isinstance(position, AutopilotPositionSample)
    assert (position.position_ned_m, position.velocity_ned_m_s) == ((1.0, 2.0, -3.0), (4.0, 5.0, -6.0))
    (euler,) = send("attitude", 9000, 0.0, math.pi / 2, 0.0, 0.1, 0.2, 0.3)
    assert isinstance(euler, AutopilotAttitudeSample)
    assert euler.ned_from_body == pytest.approx((math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0), abs=1e-7)
    (quaternion,) = send("attitude_quaternion", 9010, 0.5, 0.5, 0.5, 0.5, 0.1, 0.2, 0.3)
    assert quaternion.ned_from_body == (0.5, 0.5, 0.5, 0.5)
    assert send("attitude", 9010, 0, 0, 0, 0, 0, 0) == []


@pytest.mark.parametrize(
    ("autopilot", "kind", "custom_mode", "name"),
    [
        (PX4, 2, 6 << 16, "OFFBOARD"),
        (PX4, 2, 4 << 16 | 2 << 24, "TAKEOFF"),
        (PX4, 2, 4 << 16 | 3 << 24, "LOITER"),
        (ARDUPILOT, 2, 4, "GUIDED"),
        (ARDUPILOT, 4, 9, "LAND"),
        (ARDUPILOT, 1, 15, "GUIDED"),
        (ARDUPILOT, 1, 13, "TAKEOFF"),
        (ARDUPILOT, 2, 99, "MODE_99"),
    ],
)
def test_heartbeat_names_mode_and_arming(send: Send, autopilot: int, kind: int, custom_mode: int, name: str) -> None:
    (disarmed,) = heartbeat(send, autopilot, kind, 81, custom_mode)
    (armed,) = heartbeat(send, autopilot, kind, 81 | 128, custom_mode)
    assert isinstance(disarmed, HeartbeatSample)
    assert (disarmed.armed, armed.armed) == (False, True)
    assert (armed.mode, armed.autopilot, armed.vehicle_type) == (name, autopilot, kind)


def test_battery(send: Send) -> None:
    (status,) = send("sys_status", 0, 0, 0, 0, 11100, -1, -1, 0, 0, 0, 0, 0, 0, at_s=1.0)
    assert isinstance(status, BatterySample)
    assert status.voltage_v == pytest.approx(11.1)
    assert math.isnan(status.current_a)
    assert math.isnan(status.remaining)
    cells = [4200, 4100, 4000] + [65535] * 7
    (battery,) = send("battery_status", 0, 0, 0, 2000, cells, 1234, 0, 0, 80, at_s=1.1)
    assert (battery.voltage_v, battery.current_a, battery.remaining) == pytest.approx((12.3, 12.34, 0.8))
    assert send("sys_status", 0, 0, 0, 0, 11100, -1, -1, 0, 0, 0, 0, 0, 0, at_s=2.0) == []
    (unknown,) = send("battery_status", 0, 0, 0, 2000, [65535] * 10, -1, 0, 0, -1, at_s=2.1)
    assert math.isnan(unknown.voltage_v)


def test_actuators_landed_state_and_answers(send: Send) -> None:
    (servo,) = send("servo_output_raw", 9_000_000, 0, *range(1001, 1009))
    assert isinstance(servo, ActuatorSample)
    assert servo.outputs == tuple(float(value) for value in range(1001, 1009))
    (outputs,) = send("actuator_output_status", 9_000_000, 4, [0.5, 0.25, 0.125, 1.0] + [0.0] * 28)
    assert outputs.outputs == (0.5, 0.25, 0.125, 1.0, 0.0, 0.0, 0.0, 0.0)
    assert send("servo_output_raw", 9_010_000, 0, *range(1001, 1009)) == []
    (landed,) = send("extended_sys_state", 0, 2)
    assert landed == LandedSample(time_s=10.0, arrival_s=10.0, landed_state=2)
    (ack,) = send("command_ack", 400, 4)
    assert ack == CommandAckSample(time_s=10.0, arrival_s=10.0, command=400, result=4)


def test_home_and_origin(send: Send) -> None:
    (home,) = send("home_position", -353632610, 1491652299, 584090, 1, 2, -3, [1, 0, 0, 0], 0, 0, 0, 9_000_000)
    assert isinstance(home, HomeSample)
    assert home.latitude_rad == pytest.approx(math.radians(-35.3632610), abs=1e-12)
    assert (home.height_m, home.position_ned_m, home.time_s) == (pytest.approx(584.09), (1.0, 2.0, -3.0), 9.0)
    (origin,) = send("gps_global_origin", -353632610, 1491652299, 584090, 9_500_000)
    assert isinstance(origin, OriginSample)
    assert (origin.height_m, origin.time_s) == (pytest.approx(584.09), 9.5)


def text(send: Send, words: str, text_id: int = 0, chunk: int = 0, severity: int = 4) -> list[str]:
    samples = send("statustext", severity, words.encode(), text_id, chunk)
    assert all(isinstance(sample, StatusTextSample) and sample.severity == severity for sample in samples)
    return [sample.text for sample in samples]


def test_texts_short_long_lost_and_interrupted(send: Send) -> None:
    assert text(send, "Arming denied: höhe") == ["Arming denied: höhe"]
    assert text(send, "a" * 50) == ["a" * 50]
    assert text(send, "b" * 50, text_id=7, chunk=0) == []
    assert text(send, "c" * 50, text_id=7, chunk=1) == []
    assert text(send, "end", text_id=7, chunk=2) == ["b" * 50 + "c" * 50 + "end"]
    assert text(send, "d" * 50, text_id=8, chunk=0) == []
    assert text(send, "tail", text_id=8, chunk=2) == ["d" * 50 + "…tail"]
    assert text(send, "e" * 50, text_id=9, chunk=0) == []
    assert text(send, "other") == ["e" * 50, "other"]


def test_every_message_is_counted_once(send: Send, telemetry: Telemetry) -> None:
    heartbeat(send, PX4)
    highres(send)
    highres(send)
    send("attitude", 1000, math.nan, 0, 0, 0, 0, 0)
    send("vfr_hud", 1, 2, 3, 4, 5, 6)
    send("vfr_hud", 1, 2, 3, 4, 5, 6)
    assert telemetry.folded == {"HEARTBEAT": 1, "HIGHRES_IMU": 2}
    assert telemetry.repeated == {}
    assert telemetry.unused == {"VFR_HUD": 2}
    assert telemetry.bad == {"ATTITUDE": 1}
    assert telemetry.messages_total == 6


def test_reset_forgets_stamps_but_not_the_vehicle(send: Send, telemetry: Telemetry) -> None:
    heartbeat(send, ARDUPILOT, kind=4)
    highres(send)
    telemetry.reset()
    assert (telemetry.autopilot, telemetry.vehicle_type) == (ARDUPILOT, 4)
    assert any(isinstance(sample, ImuSample) for sample in highres(send))


def test_clock_stamps_come_from_messages_sent_at_once(send: Send) -> None:
    from gcs.mavlink.messages import Attitude, GpsRawInt, HighresImu, Timesync

    assert vehicle_stamp_s(HighresImu(5_000_000, *[0.0] * 13, 0, 0)) == pytest.approx(5.0)  # type: ignore[arg-type]
    assert vehicle_stamp_s(Attitude(7000, 0, 0, 0, 0, 0, 0)) == pytest.approx(7.0)
    assert vehicle_stamp_s(HighresImu(1_790_000_000_000_000, *[0.0] * 13, 0, 0)) is None  # type: ignore[arg-type]
    assert vehicle_stamp_s(GpsRawInt(5_000_000, *[0] * 15)) is None
    assert vehicle_stamp_s(Timesync(1, 2)) is None
