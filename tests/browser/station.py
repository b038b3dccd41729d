"""The whole station as a user starts it, and a Chromium to look at it: nothing imitated."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, expect, sync_playwright

ROOT = Path(__file__).parents[2]
START_TIMEOUT_S = 120.0
STOP_TIMEOUT_S = 20.0
EXPECT_MS = 15_000
SLOW_MS = 45_000
"""For what takes the vehicle some seconds, on a machine that may be busy."""


def chromium() -> str:
    """The system's Chromium; skips the test where there is none."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if path is not None:
            return path
    pytest.skip("no Chromium on this machine")


@dataclass(frozen=True)
class StationProcess:
    """A running ``gcs up --sim quadrotor`` and where it lives."""

    process: subprocess.Popen[str]
    runtime: Path
    runs: Path
    login_url: str

    def child(self, module: str) -> int:
        """Process id of the running ``python -m module`` below ``gcs up``."""
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError, ValueError):
                continue
            if parent == self.process.pid and module.encode() in words:
                return int(entry.name)
        raise AssertionError(f"no {module} below gcs up")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def running_station(folder: Path) -> Iterator[StationProcess]:
    """``gcs up --sim quadrotor`` on free ports, ready to be logged in to; stopped with Ctrl-C's signal.

    At half speed: a browser without a graphics card takes the processor, and to a vehicle in flight a simulation that
    stalls for a tenth of its second is a lost estimate, rightly answered by landing.
    """
    if not (ROOT / "web" / "static" / "index.html").is_file():
        pytest.skip("no dashboard bundle: python hatch_build.py")
    runtime, runs = folder / "rt", folder / "runs"
    command = [sys.executable, "-m", "gcs.cli", "up", "--sim", "quadrotor", "--seed", "7", "--speed", "0.5"]
    command += ["--no-browser", "--port", str(_free_port()), "--runtime", str(runtime), "--runs", str(runs)]
    process = subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}, text=True, stdout=subprocess.PIPE
    )
    watchdog = threading.Timer(START_TIMEOUT_S, process.kill)
    watchdog.start()
    try:
        assert process.stdout is not None
        link = next((line.strip() for line in process.stdout if "/login?token=" in line), None)
        watchdog.cancel()
        assert link is not None, "gcs up ended without a login link"
        yield StationProcess(process, runtime, runs, link)
    finally:
        watchdog.cancel()
        process.send_signal(signal.SIGINT)
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def running_browser() -> Iterator[Browser]:
    """A headless Chromium; what is expected of a page may take a while on a busy machine."""
    expect.set_options(timeout=EXPECT_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium(),
            args=["--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"],
        )
        yield browser
        browser.close()


# Our own page only: the scene's frame has its own policy.
_WATCH_VIOLATIONS = """
if (window === window.top) {
  window.violations = [];
  const note = (e) => window.violations.push(`${e.violatedDirective} ${e.blockedURI}`);
  document.addEventListener("securitypolicyviolation", note);
}
"""


def log_in(browser: Browser, station: StationProcess) -> BrowserContext:
    """A context whose session came from the one-time link."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme="dark")
    context.add_init_script(_WATCH_VIOLATIONS)
    page = context.new_page()
    page.goto(station.login_url)
    expect(at(page, "strip-link")).to_contain_text("%", timeout=SLOW_MS)
    page.close()
    return context


def open_dashboard(context: BrowserContext, station: StationProcess) -> Page:
    """A fresh dashboard that shows a live vehicle."""
    page = context.new_page()
    page.goto(station.login_url.split("/login")[0] + "/")
    expect(at(page, "strip-link")).to_contain_text("%", timeout=SLOW_MS)
    return page


def rest(page: Page) -> None:
    """Back to how a page looks when it opens: Fly view, 30 s window, nothing held."""
    page.set_viewport_size({"width": 1280, "height": 720})
    page.emulate_media(color_scheme="dark")
    at(page, "rail-fly").click()
    at(page, "window-30").click()
    if "You" in at(page, "strip-controls").inner_text():
        at(page, "key-controls").click()
    expect(at(page, "strip-controls")).to_contain_text("Free")


def take_controls(page: Page) -> None:
    """Press Take controls and see that they are ours."""
    at(page, "key-controls").click()
    expect(at(page, "strip-controls")).to_contain_text("You")


def at(page: Page, testid: str) -> Locator:
    return page.locator(f"[data-testid='{testid}']")


def number(locator: Locator) -> float:
    """A number as the dashboard writes it."""
    text = locator.inner_text().replace("−", "-")
    return float("nan") if text == "–" else float(text)


def press(locator: Locator, held_ms: int = 1100) -> None:
    """Hold a key longer than its 0.8 s."""
    locator.hover()
    page = locator.page
    page.mouse.down()
    page.wait_for_timeout(held_ms)
    page.mouse.up()


def status(page: Page) -> dict[str, object]:
    """What the station itself says, by its REST interface."""
    answer = page.request.get(f"{page.url}api/status")
    assert answer.ok, answer.text()
    found: dict[str, object] = json.loads(answer.text())
    return found
