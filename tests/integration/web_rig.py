"""A real web process on a free port, a real bus with a hub's part played by the test, and real clients."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from urllib.parse import parse_qs, urlsplit

import httpx
import websockets.sync.client

from gcs.bus import Backlog, Bus, open_router
from gcs.commands import Answer, Request
from gcs.records import Event, Status, TrajectoryStatus
from gcs.runtime import open_runtime
from gcs.signals import SLICES, empty_frame
from models.arrays import Array
from web.auth import add_user

ROOT = Path(__file__).parents[2]
START_TIMEOUT_S = 60.0


def frame(time_s: float, north_m: float = 1.0) -> Array:
    """A frame with a level vehicle at ``north_m``."""
    signals = empty_frame()
    signals[0] = time_s
    signals[SLICES["estimate.position_ned"]] = (north_m, 2.0, -3.0)
    signals[SLICES["estimate.velocity_ned"]] = (0.5, 0.0, 0.0)
    signals[SLICES["estimate.euler"]] = (0.0, 0.0, 0.0)
    signals[SLICES["estimate.ned_from_body"]] = (1.0, 0.0, 0.0, 0.0)
    signals[SLICES["estimate.position_covariance"]] = (0.04, 0.0, 0.0, 0.04, 0.0, 0.01)
    signals[SLICES["reference.position_ned"]] = (1.0, 2.0, -3.0)
    return signals


def status(time_s: float) -> Status:
    return Status(
        t_s=time_s,
        utc_s=0.0,
        vehicle_name="rig",
        vehicle_type="quadrotor",
        autopilot="px4",
        system_id=1,
        authority="rates",
        link_url="udpin://127.0.0.1:14540",
        link_state="live",
        link_silence_s=0.0,
        signing="unsigned",
        state="STANDBY",
        vehicle_mode="HOLD",
        armed=False,
        landed="on ground",
        failsafe="",
        estimator="full",
        position_source="gnss",
        controller="lqr",
        gain_set=1,
        gain_history=(),
        last_good=1,
        controls_holder="",
        controls_client="",
        battery_v=float("nan"),
        battery_remaining=float("nan"),
        flight_time_s=0.0,
        trajectory=TrajectoryStatus("", None, None, None),
        origin_latitude_deg=47.4,
        origin_longitude_deg=8.5,
        ticks=0,
        dropped_frames=0,
        tick_p99_us=0.0,
    )


def event(text: str) -> Event:
    return Event(t_s=1.0, level="advisory", text=text, source="rig")


@dataclass
class Hub:
    """The hub's part on a real bus: answers every command by ``verdict`` and keeps what it was asked."""

    bus: Bus
    requests: list[Request] = field(default_factory=list)
    verdict: Callable[[Request], tuple[bool, str]] = lambda _: (True, "")
    backlog: Backlog = field(default_factory=Backlog)

    def __post_init__(self) -> None:
        self.bus.serve_commands(self._answer)
        self.bus.serve_backlog(lambda: self.backlog)

    def _answer(self, request: Request, reply: Callable[[Answer], None]) -> None:
        self.requests.append(request)
        reply(Answer(request.number, *self.verdict(request)))


@dataclass
class Browser:
    """One browser: an HTTP client that keeps its cookie, with origin and CSRF token as a page would send them."""

    base: str
    http: httpx.Client
    csrf: str = ""

    @property
    def origin(self) -> dict[str, str]:
        return {"Origin": self.base}

    def post(self, path: str, body: object, **headers: str) -> httpx.Response:
        return self.http.post(path, json=body, headers={**self.origin, "X-CSRF-Token": self.csrf, **headers})

    def enter(self, **fields: str) -> httpx.Response:
        """Send the login form; afterwards the session's CSRF token is known if it succeeded."""
        answer = self.http.post("/login", data=fields, headers=self.origin)
        if answer.status_code == 303:
            self.csrf = self.http.get("/api/session").json()["csrf"]
        return answer

    def socket(self, path: str, **options: object) -> websockets.sync.client.ClientConnection:
        cookie = "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())
        arguments = {"origin": self.base, "additional_headers": {"Cookie": cookie}, "proxy": None, **options}
        return websockets.sync.client.connect(self.base.replace("http", "ws") + path, **arguments)  # type: ignore[arg-type]


@dataclass
class Server:
    """A running ``python -m web`` and where its login link is."""

    base: str
    link_file: Path
    process: subprocess.Popen[str]

    @property
    def token(self) -> str:
        return parse_qs(urlsplit(self.link_file.read_text().strip()).query)["token"][0]

    @contextmanager
    def browser(self) -> Iterator[Browser]:
        with httpx.Client(base_url=self.base, trust_env=False) as http:
            yield Browser(self.base, http)

    @contextmanager
    def operator(self) -> Iterator[Browser]:
        with self.browser() as browser:
            assert browser.enter(token=self.token).status_code == 303
            yield browser


class Rig:
    """Bus and server in one temporary folder."""

    def __init__(self, folder: Path) -> None:
        self._runtime = open_runtime(folder / "rt")
        self.users = folder / "users.toml"
        self.runs = folder / "runs"
        add_user(self.users, "ada", "observer", "watch only")
        self.hub = Hub(open_router(self._runtime.zenoh_socket))

    def __enter__(self) -> Rig:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "web", "--runtime", str(self._runtime.folder), "--port", "0"]
            + ["--users", str(self.users), "--runs", str(self.runs)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        match = re.fullmatch(r"LOGIN (http://127\.0\.0\.1:\d+)/login\?token=\S+\n", line)
        assert match is not None, line
        self.server = Server(match[1], self._runtime.login_url, self._process)
        return self

    def restart_hub(self) -> None:
        """The hub goes and comes back on the same socket."""
        self.hub.bus.close()
        self.hub = Hub(open_router(self._runtime.zenoh_socket))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(timeout=20.0)
        finally:
            self._process.kill()
            self.hub.bus.close()
