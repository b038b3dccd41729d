"""What an estimator says and a controller hears: the types that pass between rooms which never import each other."""

from __future__ import annotations

from dataclasses import dataclass

from models.arrays import Array, Quaternion, Vec3


@dataclass(frozen=True, slots=True)
class Innovation:
    """One measurement update of a filter. Rejection is data: a rejected update is reported just the same.

    ``innovation`` and ``variance`` (diagonal of S) have one entry per row of the measurement, in its unit;
    ``nis`` is e' S^-1 e, ``gate_ratio`` is nis over its threshold (above 1 is rejected).
    """

    source: str
    time_s: float
    innovation: tuple[float, ...]
    variance: tuple[float, ...]
    nis: float
    gate_ratio: float
    accepted: bool


@dataclass(frozen=True, slots=True)
class Estimate:
    """State of the vehicle with its uncertainty, at ``time_s`` on the vehicle clock.

    ``covariance`` (15, 15) is of the error state in this order: position ned [m], velocity ned [m/s], attitude
    (rotation vector in body axes, rad), gyro bias [rad/s], accelerometer bias [m/s^2].
    ``position_valid`` is False while no position source supports it (attitude is then still valid).
    """

    time_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    ned_from_body: Quaternion
    euler_rad: Vec3
    rates_body_rad_s: Vec3
    gyro_bias_rad_s: Vec3
    accel_bias_m_s2: Vec3
    covariance: Array
    position_valid: bool
    attitude_valid: bool


@dataclass(frozen=True, slots=True)
class Reference:
    """What the vehicle should do now: local NED position, its derivatives for feed-forward, and heading."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    acceleration_ned_m_s2: Vec3 = (0.0, 0.0, 0.0)
    jerk_ned_m_s3: Vec3 = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
