from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page

from tests.browser.station import StationProcess, log_in, open_dashboard, running_browser, running_station


@pytest.fixture(scope="module")
def station() -> Iterator[StationProcess]:
    # Not pytest's own folder: its path may be too long for a unix socket.
    with tempfile.TemporaryDirectory(prefix="rl-") as folder, running_station(Path(folder)) as process:
        yield process


@pytest.fixture(scope="module")
def context(station: StationProcess) -> Iterator[BrowserContext]:
    with running_browser() as browser:
        yield log_in(browser, station)


@pytest.fixture
def page(context: BrowserContext, station: StationProcess) -> Iterator[Page]:
    page = open_dashboard(context, station)
    yield page
    assert page.evaluate("window.violations") == []
    page.close()
