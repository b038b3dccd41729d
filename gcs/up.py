"""``gcs up``: the whole station, from a vehicle file or with a simulated vehicle, until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from gcs.config import ConfigError, VehicleFile, check_link, load_vehicle, simulated_vehicle
from gcs.mavlink.urls import parse_link_url
from gcs.runtime import Runtime, hold_lock, open_runtime
from gcs.supervisor import Program, StartFault, Supervisor

LOOPBACK = "127.0.0.1"
REPORT_TIMEOUT_S = 3.0


class PortInUseError(Exception):
    """The port of the dashboard is taken; the text says what to do."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """The simulated vehicle: times real time, wind N,E,D and gusts [m/s], seed of all noise, position sensors."""

    kind: str
    speed: float = 1.0
    wind: str = "0,0,0"
    gust_m_s: float = 0.0
    seed: int = 0
    position: str = "gnss"


@dataclass(frozen=True, slots=True)
class UpOptions:
    """What the user asked for. With ``simulated`` the vehicle file and the link have defaults."""

    vehicle: Path | None
    simulated: Simulated | None
    link: str | None
    port: int
    runs: Path
    runtime: Path | None
    browser: bool


@dataclass(frozen=True, slots=True)
class Plan:
    """What will run: checked, nothing started."""

    vehicle: VehicleFile
    programs: list[Program]
    summary: str


def plan_station(options: UpOptions, runtime: Runtime) -> Plan:
    """Check everything that can be checked before a process starts.

    Raises ConfigError for the vehicle file, link or simulation, PortInUseError for the dashboard's port.
    """
    simulated = options.simulated
    if options.vehicle is None and simulated is None:
        raise ConfigError("nothing to fly: give --sim quadrotor, or --vehicle FILE of a real vehicle")
    path = options.vehicle or simulated_vehicle(simulated.kind if simulated else "")
    vehicle = load_vehicle(path)
    if options.link is not None:
        check_link(options.link, "--link")
    _check_port(options.port)
    link = options.link or vehicle.link
    _check_runs(options.runs)
    programs = []
    if simulated is not None:
        link = options.link or f"udpin://{LOOPBACK}:{_free_udp_port()}"
        programs.append(_sitl(simulated, vehicle, link))
    folder = ("--runtime", str(runtime.folder))
    router_port = str(_free_udp_port())
    runs = str(options.runs.absolute())
    notes = _notes(simulated, link)
    web = ("--port", str(options.port), "--runs", runs)
    flight = ("--vehicle", str(path.absolute()), "--link", link, "--router-port", router_port)
    # In this order, so that at the end the hub is the last to go but for the simulation, and records everything.
    programs += [
        Program("hub", "gcs.hub", (*folder, "--runs", runs, *notes)),
        Program("flight", "gcs.flight", (*folder, *flight)),
        Program("actions", "gcs.actions", (*folder, "--port", router_port)),
        Program("web", "web", (*folder, *web)),
    ]
    return Plan(vehicle, programs, _summary(vehicle, simulated, link))


def _summary(vehicle: VehicleFile, simulated: Simulated | None, link: str) -> str:
    if simulated is None:
        return f"{vehicle.name}, {vehicle.authority}, on {link}"
    pace = "real time" if simulated.speed == 1.0 else f"{simulated.speed:g} x real time"
    wind = "" if simulated.wind == "0,0,0" else f", wind {simulated.wind} m/s"
    return f"{vehicle.name}, {vehicle.authority}, {pace}, position by {simulated.position}, seed {simulated.seed}{wind}"


def _notes(simulated: Simulated | None, link: str) -> tuple[str, ...]:
    facts = {"link": link}
    if simulated is not None:
        for name in ("kind", "speed", "wind", "gust_m_s", "seed", "position"):
            facts[f"sim.{name}"] = str(getattr(simulated, name))
    return tuple(part for name, value in facts.items() for part in ("--note", f"{name}={value}"))


def _sitl(simulated: Simulated, vehicle: VehicleFile, link: str) -> Program:
    url = parse_link_url(link)
    if url.scheme != "udpin":
        raise ConfigError(f"--link {link}: a simulated vehicle comes to udpin://[host:]port")
    _check_wind(simulated.wind)
    arguments = (
        *("--vehicle", vehicle.type, "--link", f"udpout://{url.host}:{url.port}"),
        *("--speed", f"{simulated.speed:g}", "--seed", str(simulated.seed), "--position", simulated.position),
        *(f"--wind={simulated.wind}", "--gust", f"{simulated.gust_m_s:g}"),
    )
    return Program("sim", "sitl", arguments)


def _check_wind(wind: str) -> None:
    try:
        numbers = [float(part) for part in wind.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"--wind {wind}: give three numbers, north,east,down in m/s, such as --wind=3,0,0")


def _check_runs(runs: Path) -> None:
    """A flight must not find out in the air that it is not recorded; nothing is made here."""
    nearest = next(folder for folder in (runs.absolute(), *runs.absolute().parents) if folder.exists())
    if not nearest.is_dir():
        raise ConfigError(f"--runs {runs}: {nearest} is not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise ConfigError(f"--runs {runs}: no permission to write in {nearest}")


def _check_port(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise PortInUseError(
                f"port {port} on {LOOPBACK}: {error.strerror}. Stop the program that holds it, "
                f"or choose another: gcs up --port {port + 1 if port < 65535 else 8765}"
            ) from error


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


class Console:
    """What the user sees: the link, ends and restarts, and what processes print as errors. All lines go to the log."""

    def __init__(self, log: TextIO, *, browser: bool, report: Callable[[str], None]) -> None:
        self._log = log
        self._browser = browser
        self._report = report

    def line(self, name: str, line: str, is_error: bool) -> None:
        """A line of a process."""
        self._log.write(f"{name}: {line}\n")
        self._log.flush()
        if name == "web" and line.startswith("LOGIN "):
            self._show_link(line.removeprefix("LOGIN "))
        elif is_error:
            print(line if line.startswith(f"{name}:") else f"{name}: {line}", file=sys.stderr, flush=True)

    def event(self, text: str) -> None:
        """An end or a restart, also told to the station."""
        self._log.write(f"up: {text}\n")
        self._log.flush()
        print(text, file=sys.stderr, flush=True)
        self._report(text)

    def _show_link(self, url: str) -> None:
        print(f"\n  {url}\n\nThe link works once; gcs login prints a new one. Stop with Ctrl-C.", flush=True)
        if self._browser:
            self._browser = False
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def has_display() -> bool:
    """Whether a browser window could open here."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _reporter(runtime: Runtime) -> Callable[[str], None]:
    """Tells the station of an event, if there is a hub to tell; a dead hub is told once it is back."""

    def send(text: str) -> None:
        from gcs.bus import BusError, open_client
        from gcs.records import Event

        with contextlib.suppress(BusError), open_client(runtime.zenoh_socket, REPORT_TIMEOUT_S) as bus:
            bus.report(Event(float("nan"), "caution", text, "gcs up"))
            bus.backlog()  # A round trip: the report is out before we leave.

    return lambda text: threading.Thread(target=send, args=(text,), daemon=True).start()


def run_station(options: UpOptions) -> None:
    """Run the station until SIGINT or SIGTERM.

    Raises ConfigError, PortInUseError or RuntimeFolderError before anything starts, StartFault when a process refuses.
    """
    runtime = open_runtime(options.runtime)
    lock = hold_lock(runtime)
    try:
        runtime.login_url.unlink(missing_ok=True)
        plan = plan_station(options, runtime)
        print(f"rotorlab: {plan.summary}", flush=True)
        with (runtime.folder / "station.log").open("w", encoding="utf-8") as log:
            console = Console(log, browser=options.browser and has_display(), report=_reporter(runtime))
            asyncio.run(_supervise(plan, console))
    finally:
        runtime.login_url.unlink(missing_ok=True)
        os.close(lock)


async def _supervise(plan: Plan, console: Console) -> None:
    supervisor = Supervisor(console.line, console.event)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, supervisor.stop)
    await supervisor.run(plan.programs)
    print("Station stopped.", flush=True)


__all__ = ["PortInUseError", "Simulated", "StartFault", "UpOptions", "run_station"]
