"""``python -m web``: the web server of one station."""

from __future__ import annotations

import argparse
import getpass
import os
import socket
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from ipaddress import ip_address
from pathlib import Path

import uvicorn
from fastapi import FastAPI

from gcs.runtime import RuntimeFolderError, end_with_parent, open_runtime
from web.app import Access, create_app
from web.auth import AttemptLimiter, LoginLink, SessionStore, Users, UsersError, add_user
from web.gate import MAX_BODY_BYTES, cookie_name
from web.routes import Station
from web.scene import Scene
from web.station import StationLink
from web.stream import Feed

_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
_GRACE_S = 2


class StartError(Exception):
    """The server cannot start as asked; the text says why and what to do."""


def default_users_file() -> Path:
    """``users.toml`` in the user's configuration folder."""
    base = os.environ.get("XDG_CONFIG_HOME")
    return (Path(base) if base else Path.home() / ".config") / "rotorlab" / "users.toml"


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m web", description="Web server of one station.")
    parser.add_argument("--runtime", type=Path, help="runtime folder of the station")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    parser.add_argument("--port", type=int, default=8765, help="port, 0 for any free one (default %(default)s)")
    parser.add_argument("--allow-host", action="append", default=[], metavar="NAME", help="host name it answers to")
    parser.add_argument("--tls-cert", type=Path, help="certificate chain, PEM")
    parser.add_argument("--tls-key", type=Path, help="private key, PEM")
    parser.add_argument("--users", type=Path, default=default_users_file(), help="password users (default %(default)s)")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of recorded runs (default %(default)s)")
    parser.add_argument("--add-user", metavar="NAME", help="ask for a password, add a user to the users file, and stop")
    parser.add_argument("--role", choices=("observer", "operator"), default="observer", help="role of the added user")
    return parser.parse_args(arguments)


def listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises StartError when the address cannot be used."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # With the protocol named asyncio turns Nagle's algorithm off; else every answer takes 40 ms longer.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise StartError(f"port {port} on {host}: {error.strerror}; choose another with --port or --host") from error
    return listener


def check_exposure(host: str, *, tls: bool) -> None:
    """Passwords and sessions must not cross a network in the clear. Raises StartError."""
    try:
        loopback = ip_address(host).is_loopback
    except ValueError as error:
        raise StartError(f"--host {host}: give an IP address, such as 127.0.0.1 or 0.0.0.0") from error
    if not loopback and not tls:
        raise StartError(
            f"--host {host}: reachable from the network, so give --tls-cert and --tls-key, or tunnel to 127.0.0.1"
        )


def answered_names(host: str, extra: list[str]) -> frozenset[str]:
    """Host names this server answers to."""
    own = f"[{host}]" if ":" in host else host
    return _LOOPBACK_NAMES | {own} | set(extra)


def base_url(host: str, port: int, *, tls: bool) -> str:
    """Address of the start page as seen from this computer."""
    shown = "127.0.0.1" if ip_address(host).is_unspecified else host
    return f"{'https' if tls else 'http'}://{f'[{shown}]' if ':' in shown else shown}:{port}"


def serve(options: argparse.Namespace) -> None:
    """Run the server until it is told to stop. Raises StartError, RuntimeFolderError or UsersError."""
    if (options.tls_cert is None) != (options.tls_key is None):
        raise StartError("--tls-cert and --tls-key go together")
    tls = options.tls_cert is not None
    check_exposure(options.host, tls=tls)
    runtime = open_runtime(options.runtime)
    users = Users.load(options.users)
    listener = listen(options.host, options.port)
    port = listener.getsockname()[1]
    link = LoginLink(runtime.login_url, base_url(options.host, port, tls=tls))
    access = Access(
        sessions=SessionStore(runtime.folder / "web_sessions.json", time.time),
        link=link,
        users=users,
        limiter=AttemptLimiter(time.monotonic),
        hosts=answered_names(options.host, options.allow_host),
        cookie=cookie_name(port),
    )
    feed, scene = Feed(), Scene()
    station_link = StationLink(runtime.zenoh_socket, feed, scene)
    station = Station(
        feed=feed, send=station_link.send, scene=scene, sessions=access.sessions, runs_folder=options.runs
    )

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with station_link.running():
            print(f"LOGIN {link.url}", flush=True)
            yield

    config = uvicorn.Config(
        create_app(station, access, lifespan),
        log_level="warning",
        access_log=False,  # It would write one-time tokens into logs.
        proxy_headers=False,
        server_header=False,
        ws_max_size=MAX_BODY_BYTES,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=options.tls_cert,
        ssl_keyfile=options.tls_key,
    )
    uvicorn.Server(config).run(sockets=[listener])


def main(arguments: list[str]) -> int:
    """Exit status: 0 stopped as asked, 2 could not start."""
    options = parse_arguments(arguments)
    try:
        if options.add_user is not None:
            add_user(options.users, options.add_user, options.role, getpass.getpass("Password: "))
            print(f"{options.users}: added {options.role} '{options.add_user}'")
        else:
            end_with_parent()
            serve(options)
    except (StartError, RuntimeFolderError, UsersError) as error:
        print(f"web: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
