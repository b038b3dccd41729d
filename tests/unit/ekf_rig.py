"""A vehicle on a known path with honest sensors, for the filter's tests: exact kinematics, seeded noise, no dynamics.

Position is a sum of sines, so velocity and acceleration are exact at any time. An IMU sample is the mean over its
interval: the turn between both ends over its length, and the specific force by Simpson's rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from models.estimate import Estimate
from models.frames import (
    Array,
    Geodetic,
    Vec3,
    euler_from_quaternion,
    geodetic_from_ned,
    quaternion_from_euler,
    rotation_from_quaternion,
)
from models.samples import (
    AnySample,
    BarometerSample,
    GnssSample,
    ImuSample,
    MagnetometerSample,
    OriginSample,
    PoseSample,
)

GRAVITY_M_S2 = 9.80665
HOME = Geodetic(math.radians(47.397742), math.radians(8.545594), 488.0)
ZERO: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Path:
    """Amplitudes and angular frequencies of position [m] and of roll, pitch, yaw [rad]; ``drift`` [m/s] is added."""

    amplitude_m: Vec3 = (2.0, 1.5, 0.5)
    frequency_rad_s: Vec3 = (0.8, 1.1, 0.6)
    amplitude_rad: Vec3 = (0.3, 0.25, 0.8)
    angular_frequency_rad_s: Vec3 = (1.3, 0.9, 0.4)
    drift_m_s: Vec3 = ZERO

    def position(self, t: float) -> Array:
        a, w = np.array(self.amplitude_m), np.array(self.frequency_rad_s)
        return a * np.sin(w * t) + np.array(self.drift_m_s) * t

    def velocity(self, t: float) -> Array:
        a, w = np.array(self.amplitude_m), np.array(self.frequency_rad_s)
        return a * w * np.cos(w * t) + np.array(self.drift_m_s)

    def acceleration(self, t: float) -> Array:
        a, w = np.array(self.amplitude_m), np.array(self.frequency_rad_s)
        return -a * w * w * np.sin(w * t)

    def quaternion(self, t: float) -> Array:
        a, w = np.array(self.amplitude_rad), np.array(self.angular_frequency_rad_s)
        return quaternion_from_euler(*(a * np.sin(w * t)).tolist())

    def force(self, t: float) -> Array:
        r = rotation_from_quaternion(self.quaternion(t))
        return r.T @ (self.acceleration(t) - np.array([0.0, 0.0, GRAVITY_M_S2]))


@dataclass(frozen=True)
class QuadrotorPath(Path):
    """As a quadrotor flies it in still air: thrust along body z and linear drag are all that its accelerometer feels.

    The attitude follows from acceleration and velocity.
    """

    drag_1_s: float = 0.235

    def quaternion(self, t: float) -> Array:
        ax, ay, az = self.acceleration(t).tolist()
        vx, vy, vz = self.velocity(t).tolist()
        k = self.drag_1_s
        zx, zy, zz = -(ax + k * vx), -(ay + k * vy), -(az + k * vz - GRAVITY_M_S2)
        norm = math.sqrt(zx * zx + zy * zy + zz * zz)
        zx, zy, zz = zx / norm, zy / norm, zz / norm
        yaw = self.amplitude_rad[2] * math.sin(self.angular_frequency_rad_s[2] * t)
        # Body z in the frame turned by the yaw: its lean forward is the pitch, its lean sideways the roll.
        forward = math.cos(yaw) * zx + math.sin(yaw) * zy
        right = -math.sin(yaw) * zx + math.cos(yaw) * zy
        return quaternion_from_euler(math.asin(-right), math.atan2(forward, zz), yaw)


REST = Path(amplitude_m=ZERO, amplitude_rad=ZERO)


@dataclass
class Rig:
    """Sensors on a path. ``step`` gives the samples of one IMU interval; biases walk, and can be made to jump."""

    path: Path
    seed: int
    imu_hz: float = 100.0
    gyro_noise: float = 1e-3
    accel_noise: float = 1e-2
    gyro_walk: float = 2e-4
    accel_walk: float = 2e-3
    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))
    accel_bias: Array = field(default_factory=lambda: np.zeros(3))
    pose_every: int = 1
    pose_std_m: float = 2e-3
    tilt_std_rad: float = 1e-2
    yaw_std_rad: float = 1e-2
    gnss_every: int = 0
    gnss_std_m: float = 0.5
    gnss_speed_std_m_s: float = 0.1
    gnss_delay_s: float = 0.0
    magnetometer_every: int = 0
    field_ned_t: Vec3 = (2.15e-5, 1.4e-6, 4.33e-5)
    hard_iron_t: Vec3 = ZERO
    barometer_every: int = 0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.count = 0
        self.last = (self.path.quaternion(self.time_s), self.path.force(self.time_s))

    @property
    def time_s(self) -> float:
        """Time of the newest IMU sample; starts at 1 s, as a vehicle's clock would."""
        return 1.0 + self.count / self.imu_hz

    def run(self, duration_s: float) -> Iterator[tuple[float, list[AnySample]]]:
        """Time and samples of each IMU interval for so long."""
        for _ in range(round(duration_s * self.imu_hz)):
            yield self.step()

    def step(self) -> tuple[float, list[AnySample]]:
        self.count += 1
        t, dt = self.time_s, 1.0 / self.imu_hz
        normal = self.rng.standard_normal
        self.gyro_bias = self.gyro_bias + self.gyro_walk * math.sqrt(dt) * normal(3)
        self.accel_bias = self.accel_bias + self.accel_walk * math.sqrt(dt) * normal(3)
        q, force_now = self.path.quaternion(t), self.path.force(t)
        turn = product(self.last[0] * np.array([1.0, -1.0, -1.0, -1.0]), q)
        half_sine = math.sqrt(float(turn[1:] @ turn[1:]))
        angle = 2.0 * math.atan2(half_sine, abs(turn[0]))
        rates = math.copysign(angle / (half_sine * dt) if half_sine > 1e-12 else 2.0 / dt, turn[0]) * turn[1:]
        force = (self.last[1] + 4.0 * self.path.force(t - 0.5 * dt) + force_now) / 6.0
        self.last = (q, force_now)
        gyro = rates + self.gyro_bias + self.gyro_noise / math.sqrt(dt) * normal(3)
        accel = force + self.accel_bias + self.accel_noise / math.sqrt(dt) * normal(3)
        samples: list[AnySample] = [
            ImuSample(time_s=t, arrival_s=t, gyro_body_rad_s=_vec(gyro), accel_body_m_s2=_vec(accel))
        ]
        if self.pose_every and self.count % self.pose_every == 0:
            samples.append(self.pose(t))
        if self.gnss_every and self.count % self.gnss_every == 0:
            samples.append(self.gnss(t))
        if self.magnetometer_every and self.count % self.magnetometer_every == 0:
            r = rotation_from_quaternion(self.path.quaternion(t))
            measured = r.T @ np.array(self.field_ned_t) + np.array(self.hard_iron_t) + 4e-7 * normal(3)
            samples.append(MagnetometerSample(time_s=t, arrival_s=t, field_body_t=_vec(measured)))
        if self.barometer_every and self.count % self.barometer_every == 0:
            height = HOME.height_m - float(self.path.position(t)[2]) + 7.0 + 0.2 * float(normal())
            pressure = 101325.0 * (1.0 - 0.0065 * height / 288.15) ** 5.25588
            samples.append(BarometerSample(time_s=t, arrival_s=t, pressure_pa=pressure, temperature_k=288.0))
        return t, samples

    def pose(self, t: float) -> PoseSample:
        position = self.path.position(t) + self.pose_std_m * self.rng.standard_normal(3)
        roll, pitch, yaw = euler_from_quaternion(self.path.quaternion(t)).tolist()
        noise = self.rng.standard_normal(3).tolist()
        roll, pitch = roll + self.tilt_std_rad * noise[0], pitch + self.tilt_std_rad * noise[1]
        yaw += self.yaw_std_rad * noise[2]
        q = quaternion_from_euler(roll, pitch, yaw).tolist()
        return PoseSample(time_s=t, arrival_s=t, position_ned_m=_vec(position), ned_from_body=(q[0], q[1], q[2], q[3]))

    def gnss(self, t: float, offset_ned_m: Vec3 = ZERO) -> GnssSample:
        """A fix handed over at t, true for ``gnss_delay_s`` before."""
        true_s = t - self.gnss_delay_s
        position = self.path.position(true_s) + self.gnss_std_m * self.rng.standard_normal(3) + np.array(offset_ned_m)
        velocity = self.path.velocity(true_s) + self.gnss_speed_std_m_s * self.rng.standard_normal(3)
        place = geodetic_from_ned(_vec(position), HOME)
        return GnssSample(
            time_s=t,
            arrival_s=t,
            latitude_rad=place.latitude_rad,
            longitude_rad=place.longitude_rad,
            height_m=place.height_m,
            velocity_ned_m_s=_vec(velocity),
            fix_type=3,
            satellites=12,
            horizontal_std_m=self.gnss_std_m,
            vertical_std_m=self.gnss_std_m,
            speed_std_m_s=self.gnss_speed_std_m_s,
        )

    def origin(self) -> OriginSample:
        """The vehicle tells where its local frame begins: at home."""
        return OriginSample(
            time_s=self.time_s,
            arrival_s=self.time_s,
            latitude_rad=HOME.latitude_rad,
            longitude_rad=HOME.longitude_rad,
            height_m=HOME.height_m,
        )

    def error(self, estimate: Estimate) -> Array:
        """True minus estimated, in the filter's error states (15,); attitude as a body rotation vector."""
        t = estimate.time_s
        w, x, y, z = estimate.ned_from_body
        conjugate = np.array([w, -x, -y, -z])
        q = product(conjugate, self.path.quaternion(t))
        attitude = 2.0 * math.copysign(1.0, q[0]) * q[1:]
        return np.concatenate(
            [
                self.path.position(t) - np.array(estimate.position_ned_m),
                self.path.velocity(t) - np.array(estimate.velocity_ned_m_s),
                attitude,
                self.gyro_bias - np.array(estimate.gyro_bias_rad_s),
                self.accel_bias - np.array(estimate.accel_bias_m_s2),
            ]
        )

    def nees(self, estimate: Estimate) -> float:
        """Normalised estimation error squared, 15 degrees of freedom."""
        e = self.error(estimate)
        return float(e @ np.linalg.solve(estimate.covariance, e))


def product(a: Array, b: Array) -> Array:
    """Hamilton product, written out."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
        ]
    )


def _vec(values: Array) -> Vec3:
    x, y, z = values.tolist()
    return (x, y, z)
