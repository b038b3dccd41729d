"""The runtime folder of one station: a private place (0700) for its sockets, its login link and its lock.

Whoever may enter the folder may command the station, so it must belong to the user alone.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import signal
import stat
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

SOCKET_PATH_LIMIT = 107
"""Longest path a unix socket can have on Linux, in bytes, less the closing zero."""

LONGEST_NAME = "command.sock.lock"


class RuntimeFolderError(Exception):
    """The runtime folder cannot be used; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Runtime:
    """Paths inside the runtime folder.

    ``flight_socket`` is bound by the hub (flight process writes), ``command_socket`` by the flight process (hub
    writes), ``zenoh_socket`` by the hub's router; ``login_url`` is written by the web process.
    """

    folder: Path

    @property
    def flight_socket(self) -> Path:
        return self.folder / "flight.sock"

    @property
    def command_socket(self) -> Path:
        return self.folder / "command.sock"

    @property
    def zenoh_socket(self) -> Path:
        return self.folder / "zenoh.sock"

    @property
    def login_url(self) -> Path:
        return self.folder / "login_url"

    @property
    def lock(self) -> Path:
        return self.folder / "station.lock"


def default_folder() -> Path:
    """``$XDG_RUNTIME_DIR/rotorlab``, or a folder of the user's own below the temporary folder."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    if base:
        return Path(base) / "rotorlab"
    return Path(tempfile.gettempdir()) / f"rotorlab-{os.getuid()}"


def open_runtime(folder: Path | None = None) -> Runtime:
    """Create the folder if needed and check that it is ours alone.

    Raises RuntimeFolderError when its path is too long for a socket, or when somebody else owns or may enter it.
    """
    path = (folder or default_folder()).absolute()
    length = len(os.fsencode(path / LONGEST_NAME))
    if length > SOCKET_PATH_LIMIT:
        raise RuntimeFolderError(
            f"{path}: too long for a socket by {length - SOCKET_PATH_LIMIT} bytes; give a shorter folder with --runtime"
        )
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = path.lstat()
    except OSError as error:
        raise RuntimeFolderError(f"{path}: {error.strerror}; give another folder with --runtime") from error
    if not stat.S_ISDIR(status.st_mode):
        raise RuntimeFolderError(f"{path}: not a folder; give another with --runtime")
    if status.st_uid != os.getuid():
        raise RuntimeFolderError(f"{path}: belongs to user {status.st_uid}; give a folder of your own with --runtime")
    if stat.S_IMODE(status.st_mode) & 0o077:
        raise RuntimeFolderError(
            f"{path}: others may enter (mode {stat.S_IMODE(status.st_mode):04o}); run chmod 700 on it"
        )
    return Runtime(path)


def hold_lock(runtime: Runtime) -> int:
    """Claim the folder for one station; the descriptor returned holds the claim until the process ends.

    Raises RuntimeFolderError naming the process that runs a station here already.
    """
    descriptor = os.open(runtime.lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.read(descriptor, 32).decode("ascii", "replace").strip()
        os.close(descriptor)
        raise RuntimeFolderError(
            f"{runtime.folder}: a station runs here already (process {holder or 'unknown'}); "
            "stop it, or give another folder with --runtime"
        ) from error
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
    return descriptor


_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def end_with_parent() -> None:
    """Ask the kernel (Linux) to terminate this process when its parent dies, however the parent dies."""
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
