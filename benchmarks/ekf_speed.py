"""One predict and one update of the full-state filter, beside the same filter written on filterpy, in one run.

Ours: a whole ``step`` per IMU sample with one mocap pose, as the offboard tick calls it: queue, prediction of 23 error
states, a gated 4-row Joseph update, injection, carrying the output to now, and the Estimate.
filterpy: its ExtendedKalmanFilter with the 15 states of the Euler form (position, velocity, attitude, biases), with the
model in numpy through the hooks it offers: ``predict_x``, F = I + A dt + (A dt)^2/2, ``update`` with heading wrapped.
Its linear algebra alone, with model and Jacobians given for nothing, is printed too.

Run: python -m benchmarks.ekf_speed [--json]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from estimators.ekf_model import CORE_SIZE
from estimators.full_state_ekf import EkfParameters, initial, step
from models.frames import Array
from models.samples import AnySample, ImuSample, PoseSample

STEPS = 3000
REPEATS = 5
TARGET_US = 60.0
TARGET_RATIO = 10.0


def samples_of(count: int) -> list[list[AnySample]]:
    """A vehicle at rest with honest noise: one IMU sample and one pose per 10 ms."""
    rng = np.random.default_rng(1)
    batches: list[list[AnySample]] = []
    for k in range(count):
        t = 1.0 + 0.01 * k
        gyro = (0.01 * rng.standard_normal(3)).tolist()
        accel = (0.1 * rng.standard_normal(3) - np.array([0.0, 0.0, 9.80665])).tolist()
        place = (2e-3 * rng.standard_normal(3)).tolist()
        batches.append(
            [
                ImuSample(
                    time_s=t,
                    arrival_s=t,
                    gyro_body_rad_s=(gyro[0], gyro[1], gyro[2]),
                    accel_body_m_s2=(accel[0], accel[1], accel[2]),
                ),
                PoseSample(
                    time_s=t,
                    arrival_s=t,
                    position_ned_m=(place[0], place[1], place[2]),
                    ned_from_body=(1.0, 0.0, 0.0, 0.0),
                ),
            ]
        )
    return batches


def ours_us(batches: list[list[AnySample]]) -> float:
    """Processor time of one step [us]."""
    params = EkfParameters()
    state = initial(params)
    started = time.process_time()
    for batch in batches:
        state, _ = step(state, batch, params=params)
    return 1e6 * (time.process_time() - started) / len(batches)


def skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def euler_rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Body to ned, Raja (2.4)."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


class FilterpyEkf(ExtendedKalmanFilter):
    """The Euler form of the filter as one writes it on filterpy; ``u`` is the IMU reading (6,)."""

    def __init__(self) -> None:
        super().__init__(dim_x=CORE_SIZE, dim_z=4)
        self.x = np.zeros(CORE_SIZE)
        self.P *= 0.01
        self.Q = np.diag([0.0] * 3 + [1e-4] * 3 + [1e-6] * 3 + [4e-8] * 3 + [4e-6] * 3) * 0.01
        self.R = np.diag([4e-6, 4e-6, 4e-6, 1e-4])
        self.dt_s = 0.01

    def predict_x(self, u: Array) -> None:
        x, dt_s = self.x, self.dt_s
        w, a = u[:3] - x[9:12], u[3:] - x[12:15]
        roll, pitch, yaw = x[6], x[7], x[8]
        rotation = euler_rotation(roll, pitch, yaw)
        acceleration = rotation @ a + np.array([0.0, 0.0, 9.80665])
        tangent, secant = np.tan(pitch), 1.0 / np.cos(pitch)
        sine, cosine = np.sin(roll), np.cos(roll)
        kinematics = np.array(
            [
                [1.0, sine * tangent, cosine * tangent],
                [0.0, cosine, -sine],
                [0.0, sine * secant, cosine * secant],
            ]
        )
        dynamics = np.zeros((CORE_SIZE, CORE_SIZE))
        dynamics[0:3, 3:6] = np.eye(3)
        dynamics[3:6, 6:9] = -rotation @ skew(a) @ np.linalg.inv(kinematics)
        dynamics[3:6, 12:15] = -rotation
        dynamics[6:9, 9:12] = -kinematics
        step_matrix = dynamics * dt_s
        self.F = np.eye(CORE_SIZE) + step_matrix + 0.5 * step_matrix @ step_matrix
        x[0:3] += dt_s * x[3:6] + 0.5 * dt_s**2 * acceleration
        x[3:6] += dt_s * acceleration
        x[6:9] += dt_s * (kinematics @ w)


JACOBIAN = np.zeros((4, CORE_SIZE))
JACOBIAN[0, 0] = JACOBIAN[1, 1] = JACOBIAN[2, 2] = JACOBIAN[3, 8] = 1.0


def jacobian_of(_: Array) -> Array:
    return JACOBIAN


def measured_of(x: Array) -> Array:
    return JACOBIAN @ x


def wrapped_difference(a: Array, b: Array) -> Array:
    difference: Array = a - b
    difference[3] = (difference[3] + np.pi) % (2.0 * np.pi) - np.pi
    return difference


def filterpy_us(batches: list[list[AnySample]]) -> float:
    """Processor time of predict and update of the same filter on filterpy [us]."""
    ekf = FilterpyEkf()
    inputs = []
    for imu, pose in batches:
        assert isinstance(imu, ImuSample)
        assert isinstance(pose, PoseSample)
        inputs.append((np.array(imu.gyro_body_rad_s + imu.accel_body_m_s2), np.array([*pose.position_ned_m, 0.0])))
    started = time.process_time()
    for reading, measured in inputs:
        ekf.predict(reading)
        ekf.update(measured, jacobian_of, measured_of, residual=wrapped_difference)
    return 1e6 * (time.process_time() - started) / len(batches)


def filterpy_algebra_us(batches: list[list[AnySample]]) -> float:
    """Processor time of filterpy's own linear algebra, the model given for nothing [us]."""
    ekf = ExtendedKalmanFilter(dim_x=CORE_SIZE, dim_z=4)
    ekf.x = np.zeros(CORE_SIZE)
    ekf.P *= 0.01
    ekf.Q = 1e-6 * np.eye(CORE_SIZE)
    ekf.R = np.diag([4e-6, 4e-6, 4e-6, 1e-4])
    ekf.F = np.eye(CORE_SIZE)
    measured = np.zeros(4)
    started = time.process_time()
    for _ in batches:
        ekf.predict()
        ekf.update(measured, jacobian_of, measured_of)
    return 1e6 * (time.process_time() - started) / len(batches)


def best_of(measure: Callable[[list[list[AnySample]]], float], batches: list[list[AnySample]]) -> float:
    """The least disturbed of several runs."""
    return min(measure(batches) for _ in range(REPEATS))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    batches = samples_of(STEPS)
    ours, peer = best_of(ours_us, batches), best_of(filterpy_us, batches)
    algebra = best_of(filterpy_algebra_us, batches)
    ratio = peer / ours
    if arguments.json:
        met = ours <= TARGET_US and ratio >= TARGET_RATIO
        print(
            json.dumps(
                {"ours_us": ours, "filterpy_us": peer, "filterpy_algebra_us": algebra, "ratio": ratio, "met": met}
            )
        )
        return
    print(f"full-state EKF, predict + update   {ours:8.1f} us   (reach: {TARGET_US:.0f} us)")
    print(f"same filter on filterpy            {peer:8.1f} us")
    print(f"  of which its linear algebra      {algebra:8.1f} us")
    print(f"ratio                              {ratio:8.1f}      (reach: {TARGET_RATIO:.0f})")


if __name__ == "__main__":
    main()
