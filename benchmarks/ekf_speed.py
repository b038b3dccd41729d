"""One predict and one update of the full-state filter, beside the same filter written on filterpy, in one run.

Ours: predict 23 error states, rows of a mocap pose, gated 4-row Joseph update, injection: the kernels, called from
Python one by one. Printed too: a whole ``step`` as the offboard tick calls it, which adds queue, fusion horizon,
health of the sources, the Innovation, carrying the state to now, and the Estimate.
filterpy: the same filter, 23 error states about a nominal quaternion state, with the linear algebra by its
ExtendedKalmanFilter (Joseph form too) and the model in numpy: midpoint propagation, Phi = I + A dt + (A dt)^2 / 2,
position and heading rows, NIS gate, injection. Printed too: its linear algebra alone, model and Jacobians for nothing.

Run: python -m benchmarks.ekf_speed [--json]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from estimators.ekf_measurements import heading_row, position_rows
from estimators.ekf_model import ERROR_SIZE, inject, predict
from estimators.full_state_ekf import EkfParameters, initial, step
from estimators.kalman import joseph_update
from models.frames import Array
from models.samples import AnySample, ImuSample, PoseSample

STEPS = 3000
REPEATS = 5
TARGET_US = 60.0
TARGET_RATIO = 10.0
GRAVITY = np.array([0.0, 0.0, 9.80665])
GATE = 33.4


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


def kernels_us(batches: list[list[AnySample]]) -> float:
    """Processor time of predict and update by our kernels [us]."""
    state = initial(EkfParameters())
    nominal, covariance = state.nominal, 0.01 * np.eye(ERROR_SIZE)
    inputs = _arrays_of(batches)
    ring, zero = state.imu_ring, np.zeros(3)
    ring[0, 6] = ring[1, 6] = -9.80665
    state.variance[:4] = (4e-6, 4e-6, 4e-6, 1e-4)
    density = 1e-6 * np.ones(ERROR_SIZE)
    started = time.process_time()
    for gyro, accel, position in inputs:
        ring[1, 1:4], ring[1, 4:] = gyro, accel
        predict(nominal, covariance, ring, 0, 0.0, 0.01, density)
        position_rows(nominal, position, zero, 0.0, state.innovation, state.jacobian)
        heading_row(nominal, 0.0, 3, state.innovation, state.jacobian)
        if joseph_update(
            covariance, state.innovation, state.jacobian, state.variance, 4, GATE, state.correction, state.report
        ):
            inject(nominal, covariance, state.correction)
    spent_us = 1e6 * (time.process_time() - started) / len(batches)
    assert np.linalg.norm(nominal[:3]) < 0.05, "a filter that works is timed"
    return spent_us


def _arrays_of(batches: list[list[AnySample]]) -> list[tuple[Array, Array, Array]]:
    inputs = []
    for imu, pose in batches:
        assert isinstance(imu, ImuSample)
        assert isinstance(pose, PoseSample)
        inputs.append((np.array(imu.gyro_body_rad_s), np.array(imu.accel_body_m_s2), np.array(pose.position_ned_m)))
    return inputs


def step_us(batches: list[list[AnySample]]) -> float:
    """Processor time of one step [us]."""
    params = EkfParameters()
    state = initial(params)
    started = time.process_time()
    for batch in batches:
        state, _ = step(state, batch, params=params)
    return 1e6 * (time.process_time() - started) / len(batches)


def skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation(q: Array) -> Array:
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def turned(q: Array, angle: Array) -> Array:
    """q (x) exp(angle)."""
    size = np.linalg.norm(angle)
    w, (x, y, z) = np.cos(0.5 * size), 0.5 * np.sinc(0.5 * size / np.pi) * angle
    left = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
    result: Array = left @ q
    return result / np.linalg.norm(result)


class FilterpyFilter:
    """The full-state filter as one writes it on filterpy."""

    def __init__(self) -> None:
        self.ekf = ExtendedKalmanFilter(dim_x=ERROR_SIZE, dim_z=4)
        self.ekf.x = np.zeros(ERROR_SIZE)
        self.ekf.P *= 0.01
        self.ekf.Q = 1e-8 * np.eye(ERROR_SIZE)
        self.ekf.R = np.diag([4e-6, 4e-6, 4e-6, 1e-4])
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        self.biases = np.zeros(14)
        self.jacobian = np.zeros((4, ERROR_SIZE))
        self.jacobian[:3, :3] = np.eye(3)

    def predict(self, gyro: Array, accel: Array, dt_s: float) -> None:
        w, a = gyro - self.biases[0:3], accel - self.biases[3:6]
        middle = turned(self.quaternion, 0.5 * dt_s * w)
        r = rotation(middle)
        dynamics = np.zeros((ERROR_SIZE, ERROR_SIZE))
        dynamics[0:3, 3:6] = np.eye(3)
        dynamics[3:6, 6:9] = -r @ skew(a)
        dynamics[3:6, 12:15] = -r
        dynamics[6:9, 6:9] = -skew(w)
        dynamics[6:9, 9:12] = -np.eye(3)
        moved = dynamics * dt_s
        self.ekf.F = np.eye(ERROR_SIZE) + moved + 0.5 * moved @ moved
        self.ekf.predict()
        acceleration = r @ a + GRAVITY
        self.position = self.position + dt_s * self.velocity + 0.5 * dt_s**2 * acceleration
        self.velocity = self.velocity + dt_s * acceleration
        self.quaternion = turned(middle, 0.5 * dt_s * w)

    def update(self, position: Array, yaw: float) -> None:
        r = rotation(self.quaternion)
        innovation = np.empty(4)
        innovation[:3] = position - self.position
        innovation[3] = (yaw - np.arctan2(r[1, 0], r[0, 0]) + np.pi) % (2.0 * np.pi) - np.pi
        squared = r[0, 0] ** 2 + r[1, 0] ** 2
        self.jacobian[3, 7] = (-r[0, 0] * r[1, 2] + r[1, 0] * r[0, 2]) / squared
        self.jacobian[3, 8] = (r[0, 0] * r[1, 1] - r[1, 0] * r[0, 1]) / squared
        s = self.jacobian @ self.ekf.P @ self.jacobian.T + self.ekf.R
        if innovation @ np.linalg.solve(s, innovation) > GATE:
            return
        self.ekf.x[:] = 0.0
        self.ekf.update(innovation, lambda _: self.jacobian, lambda _: np.zeros(4))
        error = self.ekf.x
        self.position = self.position + error[0:3]
        self.velocity = self.velocity + error[3:6]
        self.quaternion = turned(self.quaternion, error[6:9])
        self.biases = self.biases + error[9:23]
        turn = np.eye(ERROR_SIZE)
        turn[6:9, 6:9] -= 0.5 * skew(error[6:9])
        self.ekf.P = turn @ self.ekf.P @ turn.T
        self.ekf.x = np.zeros(ERROR_SIZE)


def filterpy_us(batches: list[list[AnySample]]) -> float:
    """Processor time of predict and update of the same filter on filterpy [us]."""
    peer = FilterpyFilter()
    inputs = _arrays_of(batches)
    started = time.process_time()
    for gyro, accel, position in inputs:
        peer.predict(gyro, accel, 0.01)
        peer.update(position, 0.0)
    spent_us = 1e6 * (time.process_time() - started) / len(batches)
    assert np.linalg.norm(peer.position) < 0.05, "the peer must be a filter that works"
    return spent_us


def filterpy_algebra_us(batches: list[list[AnySample]]) -> float:
    """Processor time of filterpy's own linear algebra, the model given for nothing [us]."""
    peer = FilterpyFilter()
    zero = np.zeros(4)
    started = time.process_time()
    for _ in batches:
        peer.ekf.predict()
        peer.ekf.update(zero, lambda _: peer.jacobian, lambda _: zero)
    return 1e6 * (time.process_time() - started) / len(batches)


def best_of(measure: Callable[[list[list[AnySample]]], float], batches: list[list[AnySample]]) -> float:
    """The least disturbed of several runs."""
    return min(measure(batches) for _ in range(REPEATS))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    batches = samples_of(STEPS)
    ours, whole = best_of(kernels_us, batches), best_of(step_us, batches)
    peer, algebra = best_of(filterpy_us, batches), best_of(filterpy_algebra_us, batches)
    ratio = peer / ours
    if arguments.json:
        figures = {
            "ours_us": ours,
            "step_us": whole,
            "filterpy_us": peer,
            "filterpy_algebra_us": algebra,
            "ratio": ratio,
        }
        print(json.dumps(figures | {"met": whole <= TARGET_US and ratio >= TARGET_RATIO}))
        return
    print(f"full-state EKF, predict + update          {ours:8.1f} us")
    print(f"  whole step, with queue and Estimate     {whole:8.1f} us   (reach: {TARGET_US:.0f} us)")
    print(f"same filter on filterpy, predict + update {peer:8.1f} us")
    print(f"  its linear algebra alone                {algebra:8.1f} us")
    print(f"ratio, predict + update                   {ratio:8.1f}      (reach: {TARGET_RATIO:.0f})")
    print(f"ratio, filterpy to our whole step         {peer / whole:8.1f}")


if __name__ == "__main__":
    main()
