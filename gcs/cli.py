"""The command line: ``gcs``. Each command imports what it needs when it runs, so that help is quick.

Exit status: 0 done; 1 refused, or no station answers; 2 wrong configuration or arguments.
"""

from __future__ import annotations

import getpass
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_args

import typer

if TYPE_CHECKING:
    from gcs.bus import Bus
    from gcs.commands import AnyCommand

CONNECT_TIMEOUT_S = 1.0

app = typer.Typer(
    help="rotorlab: a MAVLink ground station that estimates, flies OFFBOARD and tunes live.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class Position(StrEnum):
    """Position sensors of a simulated vehicle."""

    GNSS = "gnss"
    MOCAP = "mocap"
    BOTH = "both"


def _option(metavar: str, text: str, low: float | None = None, high: float | None = None) -> Any:
    """An option whose default is told by its own text."""
    return typer.Option(metavar=metavar, help=text, min=low, max=high, show_default=False)


RuntimeOption = Annotated[Path | None, typer.Option("--runtime", metavar="DIR", help="runtime folder of the station")]
JsonOption = Annotated[bool, typer.Option("--json", help="print JSON for a machine")]


def _fail(text: object, status: int) -> NoReturn:
    print(f"gcs: {text}", file=sys.stderr)
    raise typer.Exit(status)


@app.command()
def up(
    vehicle: Annotated[Path | None, typer.Option(metavar="FILE", help="vehicle file (TOML)")] = None,
    sim: Annotated[str | None, typer.Option(metavar="KIND", help="simulate a vehicle: quadrotor")] = None,
    link: Annotated[str | None, typer.Option(metavar="URL", help="link, instead of the vehicle file's")] = None,
    port: Annotated[int, _option("P", "port of the dashboard (8765)", 1, 65535)] = 8765,
    speed: Annotated[float, _option("X", "simulation: times real time (1)", 0.1, 100.0)] = 1.0,
    wind: Annotated[str, _option("N,E,D", "simulation: mean wind, m/s (0,0,0)")] = "0,0,0",
    gust: Annotated[float, _option("SIGMA", "simulation: gusts, m/s (0)", 0.0, 10.0)] = 0.0,
    seed: Annotated[int, _option("N", "simulation: seed of all noise (0)", 0)] = 0,
    position: Annotated[Position, _option("SENSORS", "simulation: gnss, mocap or both (gnss)")] = Position.GNSS,
    runs: Annotated[Path, _option("DIR", "folder for recordings (runs)")] = Path("runs"),
    runtime: RuntimeOption = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="do not open the dashboard")] = False,
) -> None:
    """Start the station and print the dashboard's link. Ctrl-C stops it."""
    from gcs.config import ConfigError
    from gcs.runtime import RuntimeFolderError
    from gcs.up import PortInUseError, Simulated, StartFault, UpOptions, run_station

    simulated = Simulated(sim, speed, wind, gust, seed, position.value) if sim is not None else None
    options = UpOptions(vehicle, simulated, link, port, runs, runtime, not no_browser)
    try:
        run_station(options)
    except (ConfigError, PortInUseError, RuntimeFolderError, StartFault) as error:
        _fail(error, 2)


@app.command(add_help_option=False, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def sim(context: typer.Context) -> None:
    """Run a simulated vehicle alone; see gcs sim --help."""
    from sitl.__main__ import main as run_sitl

    raise typer.Exit(run_sitl(context.args))


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(metavar="FILE.tlog", help="a telemetry log, or the folder of a run")],
    as_json: JsonOption = False,
) -> None:
    """Estimate a recorded flight anew and score the estimate."""
    from gcs.replay import ReplayError, replay_log

    path = log / "flight.tlog" if log.is_dir() else log
    if log.is_dir() and not path.exists():
        _fail(f"{log}: no flight.tlog in it; give a .tlog file or the folder of a run", 2)
    try:
        if as_json:
            report = replay_log(path)
        else:
            report = _replay_with_progress(path)
    except ReplayError as error:
        _fail(error, 2)
    except OSError as error:
        _fail(f"{path}: {error.strerror}", 2)
    if as_json:
        _print_json(report.to_json())
        return
    _print_table(f"{path.name}: {report.duration_s:.0f} s, compared with {report.reference}", report.to_json())


def _replay_with_progress(path: Path) -> Any:
    from rich.console import Console
    from rich.progress import Progress

    from gcs.replay import replay_log

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("replaying", total=1.0)
        return replay_log(path, progress=lambda fraction: progress.update(task, completed=fraction))


def _print_json(table: Any) -> None:
    import msgspec

    print(msgspec.json.encode(table).decode())


def _print_table(title: str, flat: dict[str, Any]) -> None:
    """Rows of ours beside the autopilot's, then the counts."""
    from rich.console import Console
    from rich.table import Table

    table = Table("quantity", "ours", "autopilot", title=title, title_justify="left")
    units = {"deg": "deg", "m": "m", "s": "s"}
    for key, value in flat.items():
        theirs = flat.get(f"autopilot_{key}")
        if f"autopilot_{key}" in flat and key != "id":
            name, _, unit = key.rpartition("_")
            label = f"{name.replace('_', ' ')}, {unit}" if unit in units else key.replace("_", " ")
            table.add_row(label, _number(value), _number(theirs))
    table.add_row("messages", str(flat["messages_total"]), "")
    table.add_row("bad messages", str(flat["messages_bad"]), "")
    Console().print(table)


def _number(value: Any) -> str:
    return "-" if value is None or value != value else f"{value:.3f}" if isinstance(value, float) else str(value)


def _open_bus(runtime: Path | None) -> Bus:
    from gcs.bus import BusError, open_client
    from gcs.runtime import RuntimeFolderError, open_runtime

    try:
        return open_client(open_runtime(runtime).zenoh_socket, CONNECT_TIMEOUT_S)
    except RuntimeFolderError as error:
        _fail(error, 2)
    except BusError as error:
        _fail(error, 1)


@app.command()
def login(runtime: RuntimeOption = None) -> None:
    """Print a link that logs in to the dashboard, once."""
    from gcs.runtime import RuntimeFolderError, open_runtime

    try:
        path = open_runtime(runtime).login_url
        print(path.read_text(encoding="utf-8").strip())
    except RuntimeFolderError as error:
        _fail(error, 2)
    except FileNotFoundError:
        _fail("no station runs here; start one with gcs up", 1)


@app.command()
def status(runtime: RuntimeOption = None, as_json: JsonOption = False) -> None:
    """Show what the running station sees and does."""
    from gcs.bus import BusError

    with _open_bus(runtime) as bus:
        try:
            backlog = bus.backlog()
        except BusError as error:
            _fail(error, 1)
    if as_json:
        _print_json({"status": backlog.status, "recording": backlog.recording, "events": backlog.events[-20:]})
        return
    seen, recording = backlog.status, backlog.recording
    if seen is None:
        print("The hub runs; the flight process has not reported yet.")
    else:
        print(f"vehicle     {seen.vehicle_name}, {seen.vehicle_type}, {seen.autopilot}, system {seen.system_id}")
        print(f"link        {seen.link_state}, {seen.link_url}, {seen.signing}")
        armed = "armed" if seen.armed else "disarmed"
        print(f"mode        {seen.state}; vehicle {seen.vehicle_mode or 'unknown'}, {armed}")
        source = {"any": "any sensor", "": "nothing"}.get(seen.position_source, seen.position_source)
        print(f"estimator   {seen.estimator}, position by {source}")
        print(f"controller  {seen.controller}, gain set {seen.gain_set}, {seen.authority}")
        print(f"controls    {seen.controls_holder or 'free'}")
    if recording is not None:
        size = f"{recording.run}, {recording.size_bytes / 1e6:.1f} MB" if recording.run else ""
        print(f"recording   {recording.state} {size} {recording.reason}".rstrip())
    for event in backlog.events[-5:]:
        print(f"{event.level:10s}  {event.text}")


@app.command()
def command(
    kind: Annotated[str, typer.Argument(metavar="COMMAND", help="hold, land, arm, take_off, start_offboard, ...")],
    fields: Annotated[list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="its fields")] = None,
    take: Annotated[bool, typer.Option("--take", help="take the controls first")] = False,
    runtime: RuntimeOption = None,
    as_json: JsonOption = False,
) -> None:
    """Command the station: gcs command take_off height_m=3"""
    from gcs.bus import BusError
    from gcs.commands import Identity, TakeControls

    wanted = _parse_command(kind, fields or [])
    identity = Identity(getpass.getuser(), "operator", "cli")
    with _open_bus(runtime) as bus:
        try:
            answer = bus.command(TakeControls(), identity) if take else None
            if answer is None or answer.accepted:
                answer = bus.command(wanted, identity)
        except BusError as error:
            _fail(error, 1)
    if as_json:
        _print_json(answer)
    else:
        print(f"{kind}: accepted. {answer.reason}".rstrip() if answer.accepted else f"{kind}: refused. {answer.reason}")
    raise typer.Exit(0 if answer.accepted else 1)


def _parse_command(kind: str, fields: list[str]) -> AnyCommand:
    """A command from its name and ``key=value`` fields, values as JSON or plain text."""
    import msgspec

    from gcs.commands import AnyCommand

    table: dict[str, Any] = {"type": kind}
    for field in fields:
        key, separator, text = field.partition("=")
        if not separator:
            _fail(f"{field}: not KEY=VALUE", 2)
        try:
            table[key] = msgspec.json.decode(text)
        except msgspec.DecodeError:
            table[key] = text
    kinds = {str(struct.__struct_config__.tag): struct for struct in get_args(AnyCommand)}
    if kind not in kinds:
        _fail(f"{kind}: no such command; there are {', '.join(sorted(kinds))}", 2)
    try:
        parsed: AnyCommand = msgspec.convert(table, AnyCommand)
    except msgspec.ValidationError as error:
        names = ", ".join(kinds[kind].__struct_fields__) or "none"
        # msgspec says "Expected `float` <= 100.0 - at `$.height_m`"; the field belongs in front.
        fault, _, where = str(error).partition(" - at `$.")
        _fail(f"{kind}: {f'{where[:-1]}: ' if where else ''}{fault}; its fields: {names}", 2)
    return parsed


def main() -> None:
    """Entry point of ``gcs``."""
    app()


if __name__ == "__main__":
    main()
