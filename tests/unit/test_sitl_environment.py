"""Gusts against their Dryden statistics; sensors against their stated noise, bias, delay and rate."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from models import atmosphere
from models.frames import quaternion_from_euler
from models.parameters import load_quadrotor
from sitl.sensors import (
    BarometerConfig,
    GnssConfig,
    MagnetometerConfig,
    MocapConfig,
    RangeConfig,
    SensorConfig,
    build_sensors,
)
from sitl.vehicle import ImuConfig, QuadrotorVehicle
from sitl.wind import GUST_STATES, Wind, step_wind, wind_constants
from tests.unit.sitl_rig import Station

DT = 0.02


def gusts(sigma: float, height_m: float, speed_m_s: float, mean=(0.0, 0.0, 0.0), count: int = 400_000):
    generator = np.random.default_rng(8)
    gust, wind = generator.standard_normal(GUST_STATES), np.empty(3)
    constants = wind_constants(Wind(mean, sigma))
    noise = generator.standard_normal((count, 3))
    out = np.empty((count, 3))
    for k in range(count):
        step_wind(gust, constants, height_m, speed_m_s, DT, noise[k], wind)
        out[k] = wind
    return out - mean


@pytest.fixture(scope="module")
def gust_record():
    return gusts(1.5, 30.0, 12.0)


def test_gust_intensities_follow_the_specification(gust_record):
    height_ft = 30.0 / 0.3048
    ratio = (0.177 + 0.000823 * height_ft) ** 0.4
    assert gust_record[:, 0].std() == pytest.approx(1.5, rel=0.05)
    assert gust_record[:, 1].std() == pytest.approx(1.5, rel=0.05)
    assert gust_record[:, 2].std() == pytest.approx(1.5 * ratio, rel=0.05)


def test_gust_spectra_follow_dryden(gust_record):
    """One-sided spectra of u (first order) and w (second order) between .05 and 2 Hz, within 15 %."""
    height_ft = 30.0 / 0.3048
    shape = 0.177 + 0.000823 * height_ft
    t_u = height_ft / shape**1.2 * 0.3048 / 12.0
    t_w = 30.0 / 12.0
    frequency, power = signal.welch(gust_record, 1.0 / DT, nperseg=8192, axis=0)
    band = (frequency > 0.05) & (frequency < 2.0)
    x = 2.0 * math.pi * frequency[band]
    sigma_w = 1.5 * shape**0.4
    expected_u = 4.0 * 1.5**2 * t_u / (1.0 + (t_u * x) ** 2)
    expected_w = 2.0 * sigma_w**2 * t_w * (1.0 + 3.0 * (t_w * x) ** 2) / (1.0 + (t_w * x) ** 2) ** 2
    for measured, expected in ((power[band, 0], expected_u), (power[band, 2], expected_w)):
        assert np.median(measured / expected) == pytest.approx(1.0, abs=0.15)
        assert np.median((measured / expected)[x > 6.0]) == pytest.approx(1.0, abs=0.2)


def test_no_gust_is_the_mean_exactly():
    assert (gusts(0.0, 3.0, 5.0, mean=(3.0, -1.0, 0.5), count=10) == 0.0).all()


def standing(config: SensorConfig, seed: int = 1):
    vehicle = QuadrotorVehicle(load_quadrotor(), Wind(), config.imu, np.random.default_rng(seed))
    return vehicle, build_sensors(vehicle, config, np.random.SeedSequence(seed).spawn(5), 488.0)


def readings(sensor, count=4000):
    out = []
    for k in range(count):
        sensor.measure(k * sensor.interval_us)()
        out.append(sensor.latest)
    return out


def test_position_sensors_have_the_stated_noise():
    vehicle, sensors = standing(SensorConfig())
    vehicle.state[:6] = [3.0, -2.0, -7.0, 1.0, 0.5, -0.3]
    fixes = readings(sensors.gnss)
    position = np.array([f.position_ned_m for f in fixes]) - vehicle.state[:3]
    velocity = np.array([f.velocity_ned_m_s for f in fixes]) - vehicle.state[3:6]
    assert np.abs(position.std(axis=0) / GnssConfig().position_noise_m - 1.0).max() < 0.05
    assert np.abs(velocity.std(axis=0) / GnssConfig().velocity_noise_m_s - 1.0).max() < 0.05
    assert np.abs(position.mean(axis=0)).max() < 0.03
    poses = readings(sensors.mocap)
    position = np.array([p.position_ned_m for p in poses]) - vehicle.state[:3]
    yaw = np.array([p.euler_rad[2] for p in poses])
    assert np.abs(position.std(axis=0) / MocapConfig().position_noise_m - 1.0).max() < 0.05
    assert yaw.std() == pytest.approx(MocapConfig().yaw_noise_rad, rel=0.05)


def test_magnetometer_shows_the_declination():
    config = SensorConfig(magnetometer=replace(MagnetometerConfig(), bias_sigma_t=0.0))
    vehicle, sensors = standing(config)
    yaw = 0.9
    vehicle.state[6:10] = quaternion_from_euler(0.0, 0.0, yaw)
    x, y, z = np.mean([m.field_body_t for m in readings(sensors.magnetometer)], axis=0)
    heading = math.atan2(-y, x) + config.magnetometer.declination_rad
    assert heading == pytest.approx(yaw, abs=2e-3)
    assert math.hypot(x, y, z) == pytest.approx(config.magnetometer.field_t, rel=1e-3)
    assert math.atan2(z, math.hypot(x, y)) == pytest.approx(config.magnetometer.inclination_rad, abs=2e-3)


def test_barometer_agrees_with_the_standard_atmosphere():
    vehicle, sensors = standing(SensorConfig(barometer=replace(BarometerConfig(), bias_sigma_pa=0.0)))
    vehicle.state[2] = -20.0
    pressure = np.array([b.pressure_pa for b in readings(sensors.barometer)])
    assert atmosphere.height_m(float(pressure.mean())) == pytest.approx(508.0, abs=0.2)
    assert pressure.std() == pytest.approx(BarometerConfig().noise_pa, rel=0.05)


def test_range_is_slant_and_says_when_it_is_out_of_reach():
    vehicle, sensors = standing(SensorConfig())
    vehicle.state[2] = -4.0
    vehicle.state[6:10] = quaternion_from_euler(0.3, 0.0, 0.0)
    distance = np.array([r.distance_m for r in readings(sensors.range)])
    assert distance.mean() == pytest.approx(4.0 / math.cos(0.3), abs=2e-3)
    assert distance.std() == pytest.approx(RangeConfig().noise_m, rel=0.05)
    vehicle.state[2] = -40.0
    assert readings(sensors.range, 1)[0].distance_m > RangeConfig().max_m


def test_battery_drains_as_rotor_power_says():
    vehicle, sensors = standing(SensorConfig())
    idle = readings(sensors.battery, 10)[-1]
    vehicle.state[13:17] = 456.7
    flown = readings(sensors.battery, 10)[-1]
    assert 5.0 < flown.current_a < 15.0
    assert flown.voltage_v < idle.voltage_v
    assert flown.remaining < idle.remaining


def test_imu_noise_and_bias_walk_have_the_stated_densities():
    config = ImuConfig(gyro_bias_sigma_rad_s=0.0, accel_bias_sigma_m_s2=0.0)
    ends, biases = [], []
    for seed in range(60):
        vehicle = QuadrotorVehicle(load_quadrotor(), Wind(), config, np.random.default_rng(seed))
        vehicle.advance(500)
        vehicle.imu_integral[5] += 9.80665
        ends.append(vehicle.imu_integral.copy())
        biases.append(vehicle.imu_bias.copy())
    spread, walk = np.array(ends).std(axis=0), np.array(biases).std(axis=0)
    # One second: the walk adds a third of its square to the white noise.
    assert spread[:3].mean() == pytest.approx(math.hypot(1e-3, 2e-4 / math.sqrt(3)), rel=0.15)
    assert spread[3:].mean() == pytest.approx(math.hypot(1e-2, 2e-3 / math.sqrt(3)), rel=0.15)
    assert walk[:3].mean() == pytest.approx(2e-4, rel=0.15)
    assert walk[3:].mean() == pytest.approx(2e-3, rel=0.15)


def test_gnss_is_late_by_its_delay_and_mocap_stamped_at_the_measurement():
    config = SensorConfig(
        gnss=replace(GnssConfig(), position_noise_m=0.0, velocity_noise_m_s=0.0),
        mocap=replace(MocapConfig(), position_noise_m=0.0),
    )
    station = Station(position="both", sensors=config)
    station.fly()
    positions = {}

    def note():
        positions[station.simulation.time_us] = station.state[2]
        station.send(_climb())

    from tests.unit.sitl_rig import local_target

    def _climb():
        return local_target(2503, vz=-1.0)

    station.run(0.3, note, period_s=0.01)
    station.mode(6)
    station.received.clear()
    station.run(2.0, note, period_s=0.01)
    for fix in station.all("GPS_RAW_INT")[2:]:
        then = positions[fix.time_usec - 100_000]
        assert fix.alt * 1e-3 - 488.0 == pytest.approx(-then, abs=2e-3)
    for pose in station.all("VISION_POSITION_ESTIMATE")[2:]:
        assert pose.z == pytest.approx(positions[pose.usec], abs=1e-6)


def test_inertial_navigation_on_the_imu_follows_the_truth():
    """Strapdown integration of noiseless IMU messages reproduces attitude and velocity through take-off and landing."""
    from models.frames import quaternion_from_rotation_vector, quaternion_multiply, rotation_from_quaternion
    from tests.unit.sitl_rig import LAND

    quiet = ImuConfig(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rate_hz=250.0)
    station = Station(sensors=SensorConfig(imu=quiet), wind=Wind((2.0, 1.0, 0.0), 0.5))
    station.fly()
    station.command(LAND)
    station.run(12.0)
    assert station.simulation.autopilot.landed
    attitude, velocity, dt = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0.004
    for m in station.all("HIGHRES_IMU"):
        turn = quaternion_from_rotation_vector(np.array([m.xgyro, m.ygyro, m.zgyro]) * dt * 0.5)
        half = quaternion_multiply(attitude, turn)
        velocity += (rotation_from_quaternion(half) @ [m.xacc, m.yacc, m.zacc] + [0.0, 0.0, 9.80665]) * dt
        attitude = quaternion_multiply(half, turn)
    assert abs(abs(attitude @ station.state[6:10]) - 1.0) < 1e-6
    assert np.abs(velocity - station.state[3:6]).max() < 0.03
