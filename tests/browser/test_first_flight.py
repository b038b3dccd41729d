"""The main job in a real browser: take off, fly the circle, switch controllers, tune, undo, land."""

from __future__ import annotations

import re
import time

from playwright.sync_api import Page, expect

from tests.browser.station import ROOT, SLOW_MS, StationProcess, at, number, press, status, take_controls
from tests.recorded_flight import assert_no_torque_jump, reticked

HEIGHT_M = 2.0
VEHICLE = ROOT / "gcs" / "vehicles" / "sim_quadrotor.toml"
FLUSHED_S = 1.5
"""The recorder writes to disk at least once a second."""
GAIN = "attitude.q_roll_rate"


def _take_off(page: Page) -> None:
    expect(at(page, "checklist")).to_contain_text("Position 3σ")
    expect(at(page, "take-off")).to_be_disabled()
    take_controls(page)
    at(page, "take-off-height").fill(str(HEIGHT_M))
    at(page, "take-off").click()
    _climbed(page)


def _climbed(page: Page) -> None:
    """The vehicle's own take-off is over. GNSS height is off by some decimetres, so only the order of it is asked."""
    expect(at(page, "strip-mode")).to_contain_text("TAKEOFF, armed", timeout=SLOW_MS)
    expect(at(page, "strip-mode")).to_contain_text("LOITER, armed", timeout=SLOW_MS)
    expect(at(page, "state-height-estimate")).to_have_text(re.compile(r"^[1-3]\.\d\d$"))


def _start_offboard(page: Page) -> None:
    at(page, "start-offboard").click()
    expect(at(page, "strip-mode")).to_contain_text("Offboard, armed", timeout=SLOW_MS)
    expect(at(page, "stop-and-hold")).to_be_enabled()


def _fly_circle(page: Page) -> None:
    at(page, "trajectory-circle").click()
    at(page, "trajectory-radius_m").fill("0.8")
    at(page, "trajectory-height_m").fill(str(HEIGHT_M))
    at(page, "fly-trajectory").click()
    expect(at(page, "manoeuvre-description")).to_contain_text("Circle 0.80 m")
    expect(at(page, "manoeuvre-progress")).to_contain_text(re.compile(r"Lap\s*1"), timeout=SLOW_MS)


def _switch(page: Page, kind: str, shown: str) -> None:
    at(page, f"controller-{kind}").click()
    page.wait_for_timeout(300)
    expect(at(page, f"controller-{kind}")).to_have_attribute("aria-pressed", "false")  # a short press cancels
    press(at(page, f"controller-{kind}"))
    expect(at(page, "strip-controller")).to_contain_text(shown)
    page.wait_for_timeout(2000)
    expect(at(page, "strip-mode")).to_contain_text("Offboard, armed")


def _change_gain(page: Page) -> int:
    """Stage, predict, apply; the number of the new set."""
    before = int(str(status(page)["gain_set"]))
    at(page, "rail-tune").click()
    expect(at(page, "tune-margins")).to_contain_text("Phase margin")
    at(page, f"staged-{GAIN}").fill("2")
    expect(at(page, "tune-apply")).to_be_disabled()  # the reason is required
    at(page, "tune-why").fill("More damping on the circle")
    expect(at(page, "tune-apply")).to_have_text("Hold to apply 1 edit")
    expect(at(page, "tune-apply")).to_be_enabled()
    press(at(page, "tune-apply"))
    row = at(page, f"history-{before + 1}")
    expect(row).to_contain_text("More damping on the circle")
    expect(row).to_contain_text("live")
    expect(at(page, f"live-{GAIN}")).to_have_text("2.00")
    return before + 1


def _recording_shows_no_torque_jump(station: StationProcess) -> None:
    """Ticked anew, the recorded inputs give every output to the bit; four switches, an edit and its undo: no jump."""
    time.sleep(FLUSHED_S)
    (run,) = station.runs.iterdir()
    assert_no_torque_jump(reticked(run, VEHICLE), changes=6)


def test_first_flight(page: Page, station: StationProcess) -> None:
    _take_off(page)
    _start_offboard(page)
    _fly_circle(page)
    for kind, shown in (("pid", "PI"), ("lqr", "LQR+I"), ("pid", "PI"), ("lqr", "LQR+I")):
        _switch(page, kind, shown)
    assert abs(number(at(page, "state-height-estimate")) - HEIGHT_M) < 0.5

    applied = _change_gain(page)
    at(page, "tune-undo").click()
    expect(at(page, f"history-{applied + 1}")).to_contain_text("live")
    expect(at(page, f"live-{GAIN}")).to_have_text("1.50")
    assert status(page)["gain_set"] == applied + 1

    at(page, "rail-fly").click()
    expect(at(page, "chart-roll-1")).not_to_have_text("–")
    page.mouse.move(5, 400)
    at(page, "key-land").click()
    page.wait_for_timeout(500)
    assert "OFFBOARD" in str(status(page)["vehicle_mode"])  # landing in the air needs the whole press
    press(at(page, "key-land"))
    expect(at(page, "strip-mode")).to_contain_text("disarmed", timeout=2 * SLOW_MS)
    assert status(page)["landed"] == "on ground"
    at(page, "fly-tab-alerts").click()
    expect(at(page, "event-log")).to_contain_text("started by operator 1")
    at(page, "fly-tab-manoeuvre").click()
    _recording_shows_no_torque_jump(station)


def test_safety_keys_work_from_inside_the_scene(page: Page) -> None:
    take_controls(page)
    at(page, "take-off-height").fill("1.5")
    at(page, "take-off").click()
    _climbed(page)
    _start_offboard(page)

    scene = page.frame_locator("[data-testid='scene-frame']")
    scene.locator("body").focus()
    page.evaluate("document.querySelector(\"[data-testid='scene-frame']\").contentWindow.focus()")
    assert page.evaluate("document.activeElement.tagName") == "IFRAME"
    page.keyboard.press("h")
    expect(at(page, "strip-mode")).not_to_contain_text("Offboard", timeout=SLOW_MS)

    page.keyboard.down("l")
    page.wait_for_timeout(1100)
    page.keyboard.up("l")
    expect(at(page, "strip-mode")).to_contain_text("disarmed", timeout=2 * SLOW_MS)
