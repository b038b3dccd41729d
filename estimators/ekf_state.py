"""Everything the full-state filter remembers between two steps, and what one step puts out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from estimators.ekf_model import ERROR_SIZE, NOMINAL_SIZE
from estimators.ekf_parameters import EkfParameters, ImuSampling
from estimators.kalman import MAX_ROWS, gate_thresholds
from models.estimate import Estimate, Innovation
from models.frames import Array, Geodetic, Vec3
from models.samples import AnySample, ImuSample, MagnetometerSample, PoseSample

IMU_RING_SIZE = 1024
NEVER_S = -math.inf


@dataclass(frozen=True, slots=True)
class Reset:
    """A jump of the estimate that is no measurement update: what, when, why, and how far things moved."""

    source: str
    time_s: float
    reason: str
    position_delta_ned_m: Vec3 = (0.0, 0.0, 0.0)
    velocity_delta_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    yaw_delta_rad: float = 0.0

    def __str__(self) -> str:
        return f"{self.source}: {self.reason}"


@dataclass(frozen=True, slots=True)
class EkfOutput:
    """Result of one step. ``estimate`` is None until attitude is known; ``dropped`` counts samples too late to use."""

    estimate: Estimate | None
    innovations: tuple[Innovation, ...] = ()
    resets: tuple[Reset, ...] = ()
    dropped: int = 0


@dataclass(slots=True)
class SourceHealth:
    """How one source has been doing; all times on the vehicle clock [s]."""

    stamp_s: float = NEVER_S
    interval_s: float = math.nan
    heard_arrival_s: float = NEVER_S
    accepted: bool = False
    rejected_since_s: float = math.nan
    fused_s: float = NEVER_S

    def heard(self, stamp_s: float) -> None:
        """Measure the interval between stamps: a running mean over about five."""
        step_s = stamp_s - self.stamp_s
        if 0.0 < step_s < 10.0:
            self.interval_s = (
                step_s if math.isnan(self.interval_s) else self.interval_s + 0.2 * (step_s - self.interval_s)
            )
        self.stamp_s = max(self.stamp_s, stamp_s)

    def silence_limit_s(self, params: EkfParameters) -> float:
        """Silence beyond which the source counts as lost: max(.1 s, 3 x the measured interval)."""
        if math.isnan(self.interval_s):
            return params.min_silence_s + params.silence_intervals
        return max(params.min_silence_s, params.silence_intervals * self.interval_s)


@dataclass(slots=True)
class EkfState:
    """State of the filter. Arrays and lists are changed in place by ``step`` and handed back: never share one state."""

    nominal: Array
    covariance: Array
    density: Array
    share_before: float
    """Weight of the earlier of two IMU samples in the interval between them."""
    thresholds: Array
    imu_ring: Array
    innovation: Array = field(default_factory=lambda: np.zeros(MAX_ROWS))
    jacobian: Array = field(default_factory=lambda: np.zeros((MAX_ROWS, ERROR_SIZE)))
    variance: Array = field(default_factory=lambda: np.zeros(MAX_ROWS))
    correction: Array = field(default_factory=lambda: np.zeros(ERROR_SIZE))
    report: Array = field(default_factory=lambda: np.zeros(MAX_ROWS + 2))
    predicted: Array = field(default_factory=lambda: np.zeros(NOMINAL_SIZE))

    running: bool = False
    imu_count: int = 0
    """IMU samples received in all; the newest sits at ``(imu_count - 1) % IMU_RING_SIZE``."""
    imu_fused: int = 0
    """Index (since the start) of the IMU sample at or before ``time_s``; the ring keeps it."""
    align_first: int = 0
    time_s: float = math.nan
    """Time of the fusion horizon: ``nominal`` and ``covariance`` are of this moment."""
    newest_s: float = NEVER_S
    newest_arrival_s: float = NEVER_S
    horizon_s: float = 0.0
    """How far the fusion horizon stays behind the newest IMU sample."""
    queue: list[tuple[float, int, int, AnySample]] = field(default_factory=list)
    queued: int = 0
    health: dict[str, SourceHealth] = field(default_factory=dict)

    origin: Geodetic | None = None
    origin_from_vehicle: bool = False
    positioned: bool = False
    field_known: bool = False
    field_started: bool = False
    barometer_started: bool = False
    ground_down_m: float = math.nan
    rest_fused_s: float = NEVER_S
    last_magnetometer: MagnetometerSample | None = None
    last_pose: PoseSample | None = None
    nis_mean: float = 1.0
    inflated_s: float = NEVER_S

    innovations: list[Innovation] = field(default_factory=list)
    resets: list[Reset] = field(default_factory=list)
    dropped: int = 0

    def source(self, name: str) -> SourceHealth:
        """Health of a source, new at its first use."""
        known = self.health.get(name)
        if known is None:
            known = self.health[name] = SourceHealth()
        return known

    def push_imu(self, sample: ImuSample) -> None:
        """Append to the ring; the caller has made sure that time goes forward."""
        row = self.imu_ring[self.imu_count % IMU_RING_SIZE]
        row[0] = sample.time_s
        row[1], row[2], row[3] = sample.gyro_body_rad_s
        row[4], row[5], row[6] = sample.accel_body_m_s2
        self.imu_count += 1
        self.newest_s = sample.time_s
        self.newest_arrival_s = sample.arrival_s

    def imu_row(self, index: int) -> Array:
        """Ring row (7,) of an IMU sample by its index since the start: time, gyro, accelerometer."""
        row: Array = self.imu_ring[index % IMU_RING_SIZE]
        return row


def initial(params: EkfParameters) -> EkfState:
    """A filter that has seen nothing; it aligns itself from the first samples."""
    density = np.zeros(ERROR_SIZE)
    density[3:6] = params.accel_noise**2
    density[6:9] = params.gyro_noise**2
    density[9:12] = params.gyro_bias_walk**2
    density[12:15] = params.accel_bias_walk**2
    nominal = np.zeros(NOMINAL_SIZE)
    nominal[6] = 1.0
    return EkfState(
        nominal=nominal,
        covariance=np.zeros((ERROR_SIZE, ERROR_SIZE)),
        density=density,
        share_before=0.5 if params.imu_sampling is ImuSampling.INSTANT else 0.0,
        thresholds=gate_thresholds(params.gate_false_alarm),
        imu_ring=np.zeros((IMU_RING_SIZE, 7)),
        horizon_s=params.horizon_s,
        origin=params.origin,
    )
