"""``python -m sitl``: one simulated vehicle on MAVLink links."""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import NoReturn

from sitl.server import Server, ServerError, UdpLink, open_step_listener
from sitl.simulation import POSITION_SOURCES, Simulation, SimulationConfig
from sitl.wind import Wind

DEFAULT_LINK = "udpout://127.0.0.1:14550"
STRONGEST_WIND_M_S = 25.0


def _wind(text: str) -> tuple[float, float, float]:
    try:
        north, east, down = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers n,e,d in m/s, such as 3,0,0") from None
    if not math.hypot(north, east, down) <= STRONGEST_WIND_M_S:
        raise argparse.ArgumentTypeError(f"'{text}' is not a wind of at most {STRONGEST_WIND_M_S:g} m/s")
    return (north, east, down)


def _between(low: float, high: float) -> Callable[[str], float]:
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g}")
        return value

    return parse


def _whole(high: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not text.isdecimal() or int(text) > high:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 to {high}")
        return int(text)

    return parse


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl", description="A simulated vehicle that speaks MAVLink.")
    add = parser.add_argument
    add("--vehicle", choices=["quadrotor"], default="quadrotor")
    add(
        "--link",
        action="append",
        metavar="URL",
        help=f"udpout://HOST:PORT or udpin://[HOST:]PORT, repeatable ({DEFAULT_LINK})",
    )
    clock = parser.add_mutually_exclusive_group()
    clock.add_argument("--speed", type=_between(0.01, 1000.0), default=1.0, metavar="X", help="times real time (1)")
    clock.add_argument(
        "--lockstep", type=_whole(65535), metavar="PORT", help="step socket, TCP on 127.0.0.1; 0: any port"
    )
    add("--seed", type=_whole(2**63), default=0, metavar="N", help="of all noise and gusts (0)")
    add("--position", choices=POSITION_SOURCES, default="gnss", help="position sensors on board (gnss)")
    add("--wind", type=_wind, default=(0.0, 0.0, 0.0), metavar="N,E,D", help="mean wind, where it blows to, m/s")
    add("--gust", type=_between(0.0, 10.0), default=0.0, metavar="SIGMA", help="Dryden gusts, 1-sigma, m/s")
    add("--json", action="store_true", help="print the ready line as JSON")
    return parser


def _stop(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until interrupted; returns the exit status (2: something asked for cannot be had)."""
    options = _parser().parse_args(arguments)
    links: list[UdpLink] = []
    try:
        for url in options.link or [DEFAULT_LINK]:
            links.append(UdpLink(url))
        listener = open_step_listener(options.lockstep) if options.lockstep is not None else None
    except ServerError as error:
        for link in links:
            link.close()
        print(f"sitl: {error}", file=sys.stderr)
        return 2
    wind = Wind(options.wind, options.gust)
    simulation = Simulation(SimulationConfig(seed=options.seed, position=options.position, wind=wind, links=len(links)))
    ready = {
        "ready": True,
        "vehicle": options.vehicle,
        "links": [link.url for link in links],
        "lockstep_port": listener.getsockname()[1] if listener is not None else None,
        "speed": options.speed if listener is None else None,
        "seed": options.seed,
        "position": options.position,
    }
    if options.json:
        print(json.dumps(ready), flush=True)
    else:
        clock = f"lockstep on port {ready['lockstep_port']}" if listener is not None else f"speed {options.speed:g}"
        urls = ", ".join(link.url for link in links)
        print(f"sitl: {options.vehicle} ready on {urls}, {clock}, seed {options.seed}, {options.position}", flush=True)
    signal.signal(signal.SIGTERM, _stop)
    server = Server(simulation, links)
    try:
        if listener is not None:
            server.run_lockstep(listener)
        else:
            server.run_at_speed(options.speed)
    except KeyboardInterrupt:
        return 0
    finally:
        for link in links:
            link.close()
        if listener is not None:
            listener.close()


if __name__ == "__main__":
    sys.exit(main())
