"""One predict and one update of the full-state filter, beside filterpy's EKF on the same model, in one run.

Ours: a whole ``step`` per IMU sample with one mocap pose, as the offboard tick calls it: queue, prediction of 23 error
states, a gated 4-row Joseph update, injection, carrying the output to now, and the Estimate. filterpy: its
ExtendedKalmanFilter with 15 states, its own ``predict`` and ``update`` with the same transition, Jacobian and noise
given for free, so only the linear algebra is timed.

Run: python benchmarks/ekf_speed.py [--json]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from estimators.ekf_model import CORE_SIZE, transition_rows
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


def filterpy_us(batches: list[list[AnySample]]) -> float:
    """Processor time of filterpy's predict and update with 15 states and 4 rows [us]."""
    ekf = ExtendedKalmanFilter(dim_x=CORE_SIZE, dim_z=4)
    ekf.P *= 0.01
    ekf.Q = 1e-6 * np.eye(CORE_SIZE)
    ekf.R = np.diag([4e-6, 4e-6, 4e-6, 1e-4])
    nominal = np.zeros(24)
    nominal[6] = 1.0
    rows = np.empty((9, CORE_SIZE))
    transition_rows(nominal, np.array([0.0, 0.0, 0.0, 0.0, 0.0, -9.80665]), 0.01, rows)
    ekf.F = np.vstack([rows, np.hstack([np.zeros((6, 9)), np.eye(6)])])
    jacobian = np.zeros((4, CORE_SIZE))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[2, 2] = jacobian[3, 8] = 1.0

    def rows_of(_: Array) -> Array:
        return jacobian

    def measurement_of(x: Array) -> Array:
        return jacobian @ x

    measured = np.zeros((4, 1))
    started = time.process_time()
    for _ in batches:
        ekf.predict()
        ekf.update(measured, rows_of, measurement_of)
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
    result = {
        "ours_us": ours,
        "filterpy_us": peer,
        "ratio": peer / ours,
        "met": ours <= TARGET_US and peer / ours >= TARGET_RATIO,
    }
    if arguments.json:
        print(json.dumps(result))
        return
    print(f"full-state EKF, predict + update   {ours:8.1f} us   (reach: {TARGET_US:.0f} us)")
    print(f"filterpy, predict + update         {peer:8.1f} us")
    print(f"ratio                              {peer / ours:8.1f}      (reach: {TARGET_RATIO:.0f})")


if __name__ == "__main__":
    main()
