"""The dashboard on the ground: layout at three sizes, staging, refusals, keys, a lost station."""

from __future__ import annotations

import os
import signal

import pytest
from playwright.sync_api import Page, expect

from tests.browser.station import SLOW_MS, StationProcess, at, status, take_controls

VIEWS = ("fly", "tune", "model", "identify", "estimate", "link", "runs")
SIZES = ((1920, 1080), (1280, 720), (1024, 768))
CELLS = ["vehicle", "link", "signing", "mode", "estimator", "controller", "compensator", "controls", "battery"]
CELLS += ["time", "recording"]  # always in this order

_OVERFLOWING = """
[...document.querySelectorAll(".panel, .cell, .bar, .rail, .scroll")]
  .filter((e) => e.offsetParent)
  .filter((e) => e.scrollWidth > e.clientWidth + 1 || (e.scrollHeight > e.clientHeight + 1 && !e.matches(".scroll")))
  .map((e) => [e.className, e.dataset.testid, e.scrollWidth - e.clientWidth, e.scrollHeight - e.clientHeight])
"""
_SCROLLS = "[document.documentElement.scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]"


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_nothing_scrolls_or_is_cut_at_any_size(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    for view in VIEWS:
        at(page, f"rail-{view}").click()
        expect(at(page, f"view-{view}")).to_be_visible()
        page.wait_for_timeout(400)
        assert page.evaluate(_SCROLLS) == [0, 0], view
        assert page.evaluate(_OVERFLOWING) == [], view


def test_strip_has_its_cells_in_order_and_says_unsigned(page: Page) -> None:
    found = page.eval_on_selector_all(
        "[data-testid='strip'] .cell", "cells => cells.map(c => c.dataset.testid.slice(6))"
    )
    assert found == CELLS
    expect(at(page, "strip-signing")).to_contain_text("Unsigned")
    expect(at(page, "strip-compensator")).to_contain_text("Off")
    expect(at(page, "strip-vehicle")).to_contain_text(str(status(page)["vehicle_name"]))


def test_charts_move_and_pause_without_losing_samples(page: Page) -> None:
    expect(at(page, "liveness")).to_contain_text("Live", timeout=SLOW_MS)
    page.keyboard.press("Space")
    expect(at(page, "liveness")).to_contain_text("Paused")
    expect(at(page, "liveness")).to_contain_text("2 s behind", timeout=SLOW_MS)
    page.keyboard.press("Space")
    expect(at(page, "liveness")).to_contain_text("Live")
    page.keyboard.press("]")
    expect(at(page, "window-120")).to_have_attribute("aria-pressed", "true")


def test_theme_follows_the_system_and_is_remembered(page: Page) -> None:
    root = page.locator("html")
    expect(root).to_have_attribute("data-theme", "dark")
    page.emulate_media(color_scheme="light")
    expect(root).to_have_attribute("data-theme", "light")
    page.keyboard.press("?")
    at(page, "theme-dark").click()
    expect(root).to_have_attribute("data-theme", "dark")
    page.reload()
    expect(root).to_have_attribute("data-theme", "dark")
    expect(at(page, "strip-link")).to_contain_text("%")
    page.keyboard.press("?")
    at(page, "theme-system").click()
    page.keyboard.press("Escape")


def test_a_bad_gain_is_refused_and_nothing_changes(page: Page) -> None:
    before = status(page)["gain_set"]
    take_controls(page)
    at(page, "rail-tune").click()
    field = at(page, "staged-attitude.q_roll")
    field.fill("1e9")
    at(page, "tune-why").fill("Too much")
    expect(at(page, "tune-caution")).to_contain_text("outside 0 to 10000")
    expect(at(page, "tune-apply")).to_be_disabled()
    field.fill("not a number")
    expect(at(page, "tune-caution")).to_contain_text("is not a number")
    field.fill("1")

    # The page is not the guard: the flight process refuses the same by itself.
    csrf = page.request.get(f"{page.url}api/session").json()["csrf"]
    answer = page.request.post(
        f"{page.url}api/commands",
        headers={"X-CSRF-Token": csrf, "Origin": page.url.rstrip("/")},
        data={"type": "apply_gains", "changes": {"attitude.q_roll": 1e9}, "why": "Too much"},
    ).json()
    assert answer["accepted"] is False
    assert "attitude.q_roll" in answer["reason"]
    assert status(page)["gain_set"] == before


def test_staged_edits_show_poles_and_margins_and_refuse_unstable_ones(page: Page) -> None:
    at(page, "rail-tune").click()
    margins = at(page, "tune-margins")
    expect(margins).to_contain_text("Phase margin")
    expect(page.locator(".pole.live").first).to_be_visible()
    at(page, "staged-attitude.q_roll_rate").fill("2")
    expect(at(page, "staged-attitude.q_roll_rate")).to_have_class("field staged")
    expect(page.locator(".pole.staged").first).to_be_visible()
    at(page, "staged-attitude.r_roll").fill("0.1")
    at(page, "staged-attitude.q_roll").fill("10000")
    expect(at(page, "tune-caution")).to_contain_text("staged poles are unstable", timeout=SLOW_MS)
    at(page, "tune-discard").click()
    expect(page.locator(".pole.staged")).to_have_count(0)


def test_escape_leaves_a_field_without_staging(page: Page) -> None:
    at(page, "rail-tune").click()
    field = at(page, "staged-attitude.q_roll")
    value = field.input_value()
    field.fill("7")
    field.press("Escape")
    expect(field).to_have_value(value)
    expect(at(page, "tune-discard")).to_be_disabled()


def test_letters_are_not_keys_while_typing(page: Page) -> None:
    at(page, "rail-tune").click()
    at(page, "staged-attitude.q_roll").click()
    page.keyboard.press("2")
    expect(at(page, "view-tune")).to_be_visible()
    page.keyboard.press("c")
    page.wait_for_timeout(500)
    expect(at(page, "strip-controls")).to_contain_text("Free")


def test_fields_out_of_range_are_marked_and_offboard_comes_first(page: Page) -> None:
    take_controls(page)
    at(page, "trajectory-radius_m").fill("500")
    expect(at(page, "trajectory-radius_m")).to_have_attribute("aria-invalid", "true")
    expect(at(page, "fly-trajectory")).to_be_disabled()  # not in offboard
    at(page, "trajectory-radius_m").fill("0.8")


def test_a_lost_link_makes_every_value_stale_and_keeps_the_keys(page: Page, station: StationProcess) -> None:
    simulator = station.child("sitl")
    os.kill(simulator, signal.SIGSTOP)
    try:
        expect(at(page, "strip-link")).to_contain_text("Lost", timeout=SLOW_MS)
        expect(at(page, "strip-mode")).to_contain_text("Failsafe expected: hold")
        expect(at(page, "bar-notice")).to_contain_text("Link lost")
        expect(at(page, "state-table")).to_contain_text("s old")
        expect(at(page, "state-north-estimate")).to_have_class("stale")
        expect(at(page, "key-hold")).to_be_enabled()
    finally:
        os.kill(simulator, signal.SIGCONT)
    expect(at(page, "strip-link")).to_contain_text("%", timeout=SLOW_MS)
    expect(at(page, "state-north-estimate")).to_have_class("strong")


def test_a_lost_station_is_said_and_comes_back(page: Page, station: StationProcess) -> None:
    os.kill(station.child("web"), signal.SIGKILL)
    expect(at(page, "bar-notice")).to_contain_text("No connection to the station. Nothing you press is sent.")
    for key in ("key-controls", "key-hold", "key-land", "key-last-good"):
        expect(at(page, key)).to_be_disabled()
    expect(at(page, "key-hold")).to_be_enabled(timeout=2 * SLOW_MS)  # gcs up has started it again
    expect(at(page, "bar-notice")).not_to_contain_text("No connection")
    expect(at(page, "liveness")).to_contain_text("Live", timeout=SLOW_MS)
