"""What the vehicle's sensors make of the truth: noise, bias, rate and delay, each from its own random generator.

The inertial sensor is integrated with the plant (:mod:`sitl.vehicle`). Here are the slower ones: each measures at its
rate and hands the value over ``delay_s`` later. Formulas are the simulator's own and share nothing with an estimator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from models.frames import Array, Vec3, euler_from_quaternion, rotation_from_quaternion
from sitl.vehicle import ImuConfig, QuadrotorVehicle


@dataclass(frozen=True, slots=True)
class GnssConfig:
    """Satellite receiver. Its messages are stamped when they are handed over, ``delay_s`` after the measurement,
    as real receivers do; whoever uses them takes the delay off."""

    position_noise_m: float = 0.5
    velocity_noise_m_s: float = 0.1
    position_bias_sigma_m: float = 0.0
    rate_hz: float = 10.0
    delay_s: float = 0.1


@dataclass(frozen=True, slots=True)
class MocapConfig:
    """Motion capture; stamped at the measurement (its clock is the vehicle's), handed over ``delay_s`` later."""

    position_noise_m: float = 0.002
    roll_pitch_noise_rad: float = 0.005
    yaw_noise_rad: float = 0.01
    position_bias_sigma_m: float = 0.0
    rate_hz: float = 100.0
    delay_s: float = 0.01


@dataclass(frozen=True, slots=True)
class MagnetometerConfig:
    """Three-axis magnetometer; declination is positive east, inclination positive down."""

    declination_rad: float = math.radians(3.2)
    inclination_rad: float = math.radians(63.4)
    field_t: float = 48.2e-6
    noise_t: float = 0.4e-6
    bias_sigma_t: float = 0.2e-6
    rate_hz: float = 50.0
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class BarometerConfig:
    """Static pressure and air temperature; the bias stands for the weather."""

    noise_pa: float = 2.5
    bias_sigma_pa: float = 60.0
    temperature_k: float = 291.0
    rate_hz: float = 25.0
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class RangeConfig:
    """Downward range finder along body z; silent outside its limits."""

    noise_m: float = 0.02
    bias_sigma_m: float = 0.0
    min_m: float = 0.05
    max_m: float = 12.0
    rate_hz: float = 20.0
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class BatteryConfig:
    """Four lithium cells drained by rotor power over an efficiency, plus the electronics."""

    capacity_a_s: float = 5.0 * 3600.0
    full_v: float = 16.8
    empty_v: float = 13.6
    resistance_ohm: float = 0.02
    efficiency: float = 0.6
    idle_w: float = 6.0
    rate_hz: float = 5.0
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """All sensors of one vehicle."""

    imu: ImuConfig = field(default_factory=ImuConfig)
    gnss: GnssConfig = field(default_factory=GnssConfig)
    mocap: MocapConfig = field(default_factory=MocapConfig)
    magnetometer: MagnetometerConfig = field(default_factory=MagnetometerConfig)
    barometer: BarometerConfig = field(default_factory=BarometerConfig)
    range: RangeConfig = field(default_factory=RangeConfig)
    battery: BatteryConfig = field(default_factory=BatteryConfig)


class GnssFix(NamedTuple):
    """Position and velocity, ned about the local origin [m], [m/s]; ``time_us`` is when the receiver hands it over."""

    time_us: int
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3


class MocapPose(NamedTuple):
    """Pose in the local frame; roll, pitch, yaw [rad]."""

    time_us: int
    position_ned_m: Vec3
    euler_rad: Vec3


class MagneticField(NamedTuple):
    """Flux density in body axes [T]."""

    time_us: int
    field_body_t: Vec3


class StaticPressure(NamedTuple):
    """Static pressure [Pa] and air temperature [K]."""

    time_us: int
    pressure_pa: float
    temperature_k: float


class GroundRange(NamedTuple):
    """Distance to the ground along body z [m]; outside the limits of the sensor it is not to be believed."""

    time_us: int
    distance_m: float


class BatteryState(NamedTuple):
    """Terminal voltage [V], current [A], charge left 0..1, charge used [A s] and energy used [J]."""

    time_us: int
    voltage_v: float
    current_a: float
    remaining: float
    used_a_s: float
    used_j: float


Reading = TypeVar("Reading", covariant=True)


class Sensor(Generic[Reading]):
    """A sensor's rate, delay and newest reading. ``count`` numbers the readings handed over so far."""

    def __init__(self, rate_hz: float, delay_s: float, measure: Callable[[int], Reading]) -> None:
        self.interval_us = round(1e6 / rate_hz)
        self.delay_us = round(1e6 * delay_s)
        self.enabled = True
        self.latest: Reading | None = None
        self.count = 0
        self._measure = measure

    def measure(self, time_us: int) -> Callable[[], None]:
        """Measure now; the returned call hands the reading over when its delay has passed."""
        reading = self._measure(time_us)

        def hand_over() -> None:
            if self.enabled:
                self.latest = reading
                self.count += 1

        return hand_over


def _vector(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))


def gnss(vehicle: QuadrotorVehicle, config: GnssConfig, generator: np.random.Generator) -> Sensor[GnssFix]:
    """Receiver: white position and velocity noise on a constant bias."""
    bias = config.position_bias_sigma_m * generator.standard_normal(3)
    delay_us = round(1e6 * config.delay_s)

    def measure(time_us: int) -> GnssFix:
        draw = generator.standard_normal(6)
        position = vehicle.state[0:3] + bias + config.position_noise_m * draw[:3]
        velocity = vehicle.state[3:6] + config.velocity_noise_m_s * draw[3:]
        return GnssFix(time_us + delay_us, _vector(position), _vector(velocity))

    return Sensor(config.rate_hz, config.delay_s, measure)


def mocap(vehicle: QuadrotorVehicle, config: MocapConfig, generator: np.random.Generator) -> Sensor[MocapPose]:
    """Motion capture: white noise on position and Euler angles."""
    bias = config.position_bias_sigma_m * generator.standard_normal(3)
    sigma = np.array([*[config.position_noise_m] * 3, *[config.roll_pitch_noise_rad] * 2, config.yaw_noise_rad])

    def measure(time_us: int) -> MocapPose:
        draw = sigma * generator.standard_normal(6)
        position = vehicle.state[0:3] + bias + draw[:3]
        euler = euler_from_quaternion(vehicle.state[6:10]) + draw[3:]
        return MocapPose(time_us, _vector(position), _vector(euler))

    return Sensor(config.rate_hz, config.delay_s, measure)


def magnetometer(
    vehicle: QuadrotorVehicle, config: MagnetometerConfig, generator: np.random.Generator
) -> Sensor[MagneticField]:
    """Earth's field turned into body axes, with hard-iron bias and white noise."""
    bias = config.bias_sigma_t * generator.standard_normal(3)
    level = math.cos(config.inclination_rad)
    field_ned = config.field_t * np.array(
        [
            level * math.cos(config.declination_rad),
            level * math.sin(config.declination_rad),
            math.sin(config.inclination_rad),
        ]
    )

    def measure(time_us: int) -> MagneticField:
        body = field_ned @ rotation_from_quaternion(vehicle.state[6:10])
        return MagneticField(time_us, _vector(body + bias + config.noise_t * generator.standard_normal(3)))

    return Sensor(config.rate_hz, config.delay_s, measure)


def barometer(
    vehicle: QuadrotorVehicle, config: BarometerConfig, generator: np.random.Generator, origin_height_m: float
) -> Sensor[StaticPressure]:
    """ISA pressure at the true height above sea level, with a constant bias and white noise."""
    bias = config.bias_sigma_pa * generator.standard_normal()

    def measure(time_us: int) -> StaticPressure:
        height = origin_height_m - vehicle.state[2]
        pressure = 101325.0 * (1.0 - 2.25577e-5 * height) ** 5.25588
        noisy = pressure + bias + config.noise_pa * generator.standard_normal()
        return StaticPressure(time_us, float(noisy), config.temperature_k)

    return Sensor(config.rate_hz, config.delay_s, measure)


def range_finder(vehicle: QuadrotorVehicle, config: RangeConfig, generator: np.random.Generator) -> Sensor[GroundRange]:
    """Slant distance to flat ground; beyond the limits it reads one centimetre past the limit."""
    bias = config.bias_sigma_m * generator.standard_normal()

    def measure(time_us: int) -> GroundRange:
        x, y = vehicle.state[7], vehicle.state[8]
        down = 1.0 - 2.0 * (x * x + y * y)
        noise = config.noise_m * generator.standard_normal()
        slant = -vehicle.state[2] / down + bias + noise if down > 0.1 else math.inf
        return GroundRange(time_us, float(min(max(slant, config.min_m - 0.01), config.max_m + 0.01)))

    return Sensor(config.rate_hz, config.delay_s, measure)


def battery(vehicle: QuadrotorVehicle, config: BatteryConfig) -> Sensor[BatteryState]:
    """Charge drained by the shaft power of the rotors over their efficiency; voltage falls with charge and current."""
    used = [0.0, 0.0]
    interval_s = 1.0 / config.rate_hz

    def measure(time_us: int) -> BatteryState:
        shaft_w = vehicle.parameters.rotor_torque_coefficient_n_m_s2 * float((vehicle.state[13:17] ** 3).sum())
        power_w = shaft_w / config.efficiency + config.idle_w
        remaining = max(0.0, 1.0 - used[0] / config.capacity_a_s)
        rest_v = config.empty_v + (config.full_v - config.empty_v) * remaining
        current = power_w / rest_v
        voltage = rest_v - current * config.resistance_ohm
        used[0] += current * interval_s
        used[1] += power_w * interval_s
        return BatteryState(time_us, voltage, current, remaining, used[0], used[1])

    return Sensor(config.rate_hz, config.delay_s, measure)


@dataclass(frozen=True, slots=True)
class Sensors:
    """The sensors of one vehicle, each with its own random generator."""

    gnss: Sensor[GnssFix]
    mocap: Sensor[MocapPose]
    magnetometer: Sensor[MagneticField]
    barometer: Sensor[StaticPressure]
    range: Sensor[GroundRange]
    battery: Sensor[BatteryState]


def build_sensors(
    vehicle: QuadrotorVehicle, config: SensorConfig, seeds: list[np.random.SeedSequence], origin_height_m: float
) -> Sensors:
    """Sensors of a vehicle from five seeds: receiver, motion capture, magnetometer, barometer, range."""
    generators = [np.random.default_rng(seed) for seed in seeds]
    return Sensors(
        gnss=gnss(vehicle, config.gnss, generators[0]),
        mocap=mocap(vehicle, config.mocap, generators[1]),
        magnetometer=magnetometer(vehicle, config.magnetometer, generators[2]),
        barometer=barometer(vehicle, config.barometer, generators[3], origin_height_m),
        range=range_finder(vehicle, config.range, generators[4]),
        battery=battery(vehicle, config.battery),
    )
