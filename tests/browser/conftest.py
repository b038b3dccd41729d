from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.station import StationProcess, log_in, open_dashboard, rest, running_browser, running_station


@pytest.fixture(scope="module")
def station() -> Iterator[StationProcess]:
    # Not pytest's own folder: its path may be too long for a unix socket.
    with tempfile.TemporaryDirectory(prefix="rl-") as folder, running_station(Path(folder)) as process:
        yield process


@pytest.fixture(scope="module")
def dashboard(station: StationProcess) -> Iterator[Page]:
    """One page for a module: without a graphics card its scene takes seconds to start."""
    with running_browser() as browser:
        yield open_dashboard(log_in(browser, station), station)


@pytest.fixture
def page(dashboard: Page) -> Iterator[Page]:
    rest(dashboard)
    yield dashboard
    for event in dashboard.request.get(f"{dashboard.url}api/events?limit=30").json():
        print(event["t_s"], event["level"], event["text"])  # shown when a test fails
    assert dashboard.evaluate("window.violations") == []
