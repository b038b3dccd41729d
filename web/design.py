"""Predictions of a change of gains: poles, margins, steps, and the jump of the command. Heavy: it loads the kernels."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from controllers.cascade import CascadeLimits, Command
from controllers.design import DesignReport, predict
from controllers.flight_controller import engage, prepare, step
from controllers.gains import GainError, GainSet, edited
from gcs.commands import ControllerKind
from gcs.signals import SLICES
from models.arrays import Array
from models.estimate import Estimate, Reference
from models.parameters import load_quadrotor
from web.tables import DesignError, DesignRequest, newest_set


class Jump(msgspec.Struct, frozen=True):
    """What applying the staged set now would do to the command at that instant: largest torque and thrust change."""

    torque_n_m: float
    thrust_n: float


class Prediction(msgspec.Struct, frozen=True):
    """Live and staged design of one controller; ``base`` names the set the changes count from.

    ``jump`` is None while nothing is being commanded.
    """

    controller: ControllerKind
    base: str
    live: DesignReport
    staged: DesignReport
    jump: Jump | None


def predicted_jump(staged: GainSet, frame: Array | None) -> Jump | None:
    """Change of command if ``staged`` took over at a frame of :mod:`gcs.signals`, by the controller's own code."""
    if frame is None:
        return None
    values_of = {name: tuple(frame[place].tolist()) for name, place in SLICES.items()}
    needed = ("estimate.position_ned", "estimate.velocity_ned", "reference.position_ned", "control.torque_body")
    if not all(np.isfinite(values_of[name]).all() for name in needed):
        return None
    estimate = Estimate(
        time_s=frame[0],
        position_ned_m=values_of["estimate.position_ned"],
        velocity_ned_m_s=values_of["estimate.velocity_ned"],
        ned_from_body=values_of["estimate.ned_from_body"],
        euler_rad=values_of["estimate.euler"],
        rates_body_rad_s=values_of["estimate.rates_body"],
        gyro_bias_rad_s=values_of["estimate.gyro_bias"],
        accel_bias_m_s2=values_of["estimate.accel_bias"],
        covariance=np.zeros((15, 15)),
        position_valid=True,
        attitude_valid=True,
    )
    reference = Reference(
        values_of["reference.position_ned"],
        values_of["reference.velocity_ned"],
        yaw_rad=values_of["reference.yaw"][0],
    )
    roll_rad, pitch_rad, _ = values_of["control.euler_command"]
    last = Command((roll_rad, pitch_rad), values_of["control.thrust"][0], values_of["control.torque_body"])
    state = engage(prepare(staged, load_quadrotor()), estimate, reference, gain_set_number=0, last=last)
    _, ladder = step(state, estimate, reference, limits=CascadeLimits(tilt_rad=math.pi))
    torque_change = np.subtract(ladder.torque_body_n_m, last.torque_n_m)
    return Jump(float(np.abs(torque_change).max()), abs(ladder.thrust_n - last.thrust_n))


@lru_cache(maxsize=32)
def _report(gain_set: GainSet) -> DesignReport:
    """Remembered, because the live set is asked for again with every edit of the staged one."""
    return predict(gain_set, load_quadrotor())


def predict_change(wanted: DesignRequest, status: dict[str, Any] | None, frame: Array | None) -> Prediction:
    """Poles, margins and steps of the newest set of a controller and of that set with changes. Raises DesignError."""
    base, live = newest_set(wanted.controller, status)
    try:
        staged = edited(live, wanted.changes)
    except GainError as error:
        raise DesignError(str(error)) from error
    try:
        return Prediction(
            controller=wanted.controller,
            base=base,
            live=_report(live),
            staged=_report(staged),
            jump=predicted_jump(staged, frame),
        )
    except np.linalg.LinAlgError as error:
        raise DesignError(f"These weights give no stabilising gains: {error}") from error


def warm_up() -> None:
    """Load and run everything a prediction needs, so that the first one is as quick as the others."""
    predict_change(DesignRequest("lqr"), None, None)
