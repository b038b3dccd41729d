"""Parameters of the full-state filter, with units and where the values come from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from models.frames import Geodetic, Vec3


class PoseAttitude(StrEnum):
    """How much of a mocap attitude is used: its heading, as Raja (3.14) does, or all of it."""

    YAW = "yaw"
    FULL = "full"


class ImuSampling(StrEnum):
    """What one IMU sample is: the mean over the interval up to its stamp (PX4), or a reading then (ArduPilot)."""

    MEAN = "mean"
    INSTANT = "instant"


@dataclass(frozen=True, slots=True)
class EkfParameters:
    """Tuning of :mod:`estimators.full_state_ekf`. Defaults are the sensors of the reference quadrotor.

    Noise densities are per root hertz, walks are densities of the derivative; ``*_std`` are 1-sigma. A delay is the age
    of a measurement at its own stamp; the fusion horizon grows from ``horizon_s`` to the age of the oldest seen.

    Process (reference quadrotor): ``gyro_noise`` rad/s, ``accel_noise`` m/s^2, ``gyro_bias_walk``, ``accel_bias_walk``.
    """

    gyro_noise: float = 1e-3
    accel_noise: float = 1e-2
    gyro_bias_walk: float = 2e-4
    accel_bias_walk: float = 2e-3
    imu_sampling: ImuSampling = ImuSampling.MEAN

    # Start: biases of an uncalibrated small IMU; tilt from the accelerometer, so about its bias over g.
    initial_tilt_std_rad: float = 0.03
    initial_gyro_bias_std_rad_s: float = 0.05
    initial_accel_bias_std_m_s2: float = 0.2
    initial_velocity_std_m_s: float = 0.5
    align_s: float = 0.3

    # Motion capture: reference quadrotor, 100 Hz.
    pose_position_std_m: float = 2e-3
    pose_yaw_std_rad: float = 1e-2
    pose_tilt_std_rad: float = 1e-2
    pose_attitude: PoseAttitude = PoseAttitude.YAW
    pose_delay_s: float = 0.0

    # GNSS: reference quadrotor, 10 Hz; used where the receiver does not state its own accuracy.
    gnss_position_std_m: float = 0.5
    gnss_vertical_std_m: float = 0.5
    gnss_speed_std_m_s: float = 0.1
    gnss_yaw_std_rad: float = 0.05
    gnss_delay_s: float = 0.0
    gnss_delay_std_s: float = 0.0
    """Uncertainty of ``gnss_delay_s``; above zero the filter estimates the rest of the delay from manoeuvres."""
    gnss_lever_body_m: Vec3 = (0.0, 0.0, 0.0)

    # Magnetometer, 3-axis, with the Earth field (World Magnetic Model unless given) and hard iron as states.
    use_magnetometer: bool = True
    magnetometer_std_t: float = 1e-6
    magnetometer_delay_s: float = 0.0
    magnetometer_min_interval_s: float = 0.015
    magnetic_bias_std_t: float = 2e-6
    magnetic_bias_walk_t: float = 2e-9
    earth_field_std_t: float = 2e-7
    earth_field_walk_t: float = 1e-9
    earth_field_ned_t: Vec3 | None = None
    declination_rad: float | None = None
    magnetic_year: float = 2026.5

    # Barometer: height with an offset state, started at the first reading, that follows the weather.
    use_barometer: bool = True
    barometer_std_m: float = 0.5
    barometer_offset_walk_m: float = 0.02
    barometer_min_interval_s: float = 0.015

    # Range finder over level ground: reference quadrotor, 20 Hz.
    use_range: bool = True
    range_std_m: float = 0.02

    # Accelerometer rows of Raja (3.14), off at zero; .235 1/s is the reference quadrotor. Unknown wind widens them.
    drag_1_s: float = 0.0
    drag_accel_std_m_s2: float = 0.1
    wind_std_m_s: float = 3.0

    # Order and time.
    horizon_s: float = 0.0
    max_horizon_s: float = 0.4
    late_tolerance_s: float = 0.06
    max_imu_gap_s: float = 0.5

    # Gates and recovery.
    gate_false_alarm: float = 1e-6
    reset_after_s: float = 1.0
    min_silence_s: float = 0.1
    silence_intervals: float = 3.0

    # A jump of an IMU bias shows as mocap NIS above what noise explains; the bias covariance is then opened.
    bias_inflation: bool = True
    inflation_window_s: float = 0.05
    inflation_hold_s: float = 0.3
    inflation_nis_ratio: float = 2.7
    inflation_gyro_std_rad_s: float = 0.1
    inflation_accel_std_m_s2: float = 0.4

    origin: Geodetic | None = None
    """Origin of the local frame; None takes the vehicle's own (GPS_GLOBAL_ORIGIN) or else the first fix."""
