"""Switching and tuning in flight, in 3 m/s wind with a .05 N m roll disturbance: no jump, hardly a twitch."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from controllers import flight_controller
from controllers.cascade import hover_command
from controllers.flight_controller import FlightControllerState
from controllers.gains import GainSet, edited, load_gain_set
from models.estimate import Reference
from tests.flights.control_rig import PARAMETERS, Rig
from tests.flights.test_controllers_steps import paper_circle

HOVER = Reference((0.0, 0.0, -2.0))
LQR, PID = load_gain_set("lqr", "default"), load_gain_set("pid", "default")


def steady(gain_set: GainSet, reference: Callable[[float], Reference]) -> tuple[Rig, FlightControllerState]:
    """A vehicle that has flown long enough for the integrals to hold off wind and disturbance."""
    begin = reference(0.0)
    rig = Rig(wind_ned_m_s=(0.0, 3.0, 0.0), disturbance_n_m=(0.05, 0.0, 0.0), position_ned_m=begin.position_ned_m)
    return rig, rig.fly(rig.engaged(gain_set, begin), reference, 50.0)


def after_switch(
    rig: Rig, controller: FlightControllerState, reference: Callable[[float], Reference], bumpless: bool, to: GainSet
) -> tuple[float, float]:
    """Largest torque jump [N m] at the switch and largest attitude deviation [deg] in the 10 s after it.

    The deviation is from the flight that goes on without a switch.
    """
    twin = Rig(rig.wind_ned_m_s, rig.disturbance_n_m)
    twin.state, twin.time_s = rig.state.copy(), rig.time_s
    begin_s = rig.time_s
    twin.fly(controller, lambda t: reference(begin_s + t), 10.0)
    law = flight_controller.prepare(to, PARAMETERS)
    now = reference(begin_s)
    if bumpless:
        controller = flight_controller.switch_to(controller, law, rig.estimate(), now, gain_set_number=2)
    else:
        controller = flight_controller.engage(
            law, rig.estimate(), now, gain_set_number=2, last=hover_command(law.vehicle)
        )
    before = len(rig.log)
    rig.fly(controller, lambda t: reference(begin_s + t), 10.0)
    jump = float(np.abs(rig.commands[before][1:] - rig.commands[before - 1][1:]).max())
    deviation = np.abs(np.array(rig.log)[before:, 6:9] - np.array(twin.log)[:, 6:9]).max()
    return jump, math.degrees(float(deviation))


@pytest.mark.parametrize(("begin", "to"), [(PID, LQR), (LQR, PID)], ids=["to_lqr", "to_pid"])
def test_switch_in_hover_in_wind(begin: GainSet, to: GainSet) -> None:
    rig, controller = steady(begin, lambda _: HOVER)
    jump_n_m, deviation_deg = after_switch(rig, controller, lambda _: HOVER, True, to)
    assert jump_n_m < 1e-4
    assert deviation_deg <= 0.37


def test_a_cold_switch_would_have_jumped() -> None:
    """The same switch without initial values, so that the test above is seen to test something."""
    rig, controller = steady(PID, lambda _: HOVER)
    jump_n_m, deviation_deg = after_switch(rig, controller, lambda _: HOVER, False, LQR)
    assert jump_n_m > 0.02
    assert deviation_deg > 2.0


@pytest.mark.parametrize(("begin", "to"), [(PID, LQR), (LQR, PID)], ids=["to_lqr", "to_pid"])
def test_switch_on_the_circle_in_wind(begin: GainSet, to: GainSet) -> None:
    rig, controller = steady(begin, paper_circle)
    jump_n_m, deviation_deg = after_switch(rig, controller, paper_circle, True, to)
    assert jump_n_m < 5e-3
    assert deviation_deg <= 1.5


@pytest.mark.parametrize(
    ("base", "changes"),
    [
        (LQR, {"attitude.q_roll_integral": 1600.0, "position.q_x_integral": 0.06}),
        (LQR, {"feed_forward": 0.0}),
        (PID, {"roll.p": 90.0, "yaw.i": 0.0, "position.i": 0.5}),
    ],
)
def test_live_gain_change_in_wind(base: GainSet, changes: dict[str, float]) -> None:
    rig, controller = steady(base, lambda _: HOVER)
    jump_n_m, deviation_deg = after_switch(rig, controller, lambda _: HOVER, True, edited(base, changes))
    assert jump_n_m < 1e-4
    assert deviation_deg <= 0.37
