"""What every way to a vehicle has in common: the endpoint interface, its errors, and when to try again.

Nothing in an endpoint blocks, waits, or has a thread. The caller owns the clock: :meth:`Endpoint.poll` drives
reconnection. ``fileno`` changes when a connection is lost or made; ``generation`` counts that, so that a selector knows
when to register anew.
"""

from __future__ import annotations

import errno
import socket
from abc import ABC, abstractmethod

from gcs.mavlink.urls import LinkUrl

MAX_DATAGRAM = 65536
# One drain takes at most this many reads, so that a flood cannot hold the caller.
MAX_READS = 256
BACKOFF_FIRST_S = 0.25
BACKOFF_LAST_S = 8.0


class LinkOpenError(OSError):
    """A link that cannot be opened; the message names the URL, the cause and what to do."""


class Endpoint(ABC):
    """One way to a vehicle. ``dropped`` counts packets that were not sent, ``foreign`` datagrams from other peers."""

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.foreign = 0
        self.generation = 0

    @property
    @abstractmethod
    def connected(self) -> bool:
        """True while there is a peer to send to."""

    @abstractmethod
    def fileno(self) -> int:
        """Descriptor to wait for reading on; -1 while there is none."""

    @abstractmethod
    def receive(self) -> list[bytes]:
        """Everything that has arrived, at once; empty if nothing has. Never blocks, never raises for a lost peer."""

    @abstractmethod
    def send(self, data: bytes) -> bool:
        """Send one packet now, or drop and count it; True if it went out."""

    @abstractmethod
    def poll(self, now_s: float) -> None:
        """Reconnect if it is time to; ``now_s`` is any monotonic clock of the caller [s]."""

    @abstractmethod
    def close(self) -> None:
        """Release the descriptor; the endpoint cannot be used again."""


class Backoff:
    """When to try again: at once, then after .25 s, doubling up to 8 s."""

    def __init__(self) -> None:
        self._delay_s = 0.0
        self._due_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        """True if it is time to try; the next time is then set."""
        if self._due_s is None:
            self._due_s = now_s + self._delay_s
        if now_s < self._due_s:
            return False
        self._delay_s = min(max(2.0 * self._delay_s, BACKOFF_FIRST_S), BACKOFF_LAST_S)
        self._due_s = now_s + self._delay_s
        return True

    def reset(self) -> None:
        """A connection stands: the next loss begins with the shortest delay."""
        self._delay_s = BACKOFF_FIRST_S
        self._due_s = None


def resolve(url: LinkUrl) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Address of a URL's host and port. Raises LinkOpenError for a host nobody knows."""
    kind = socket.SOCK_DGRAM if url.scheme.startswith("udp") else socket.SOCK_STREAM
    try:
        family, _, _, _, address = socket.getaddrinfo(url.host, url.port, type=kind)[0]
    except socket.gaierror as error:
        raise LinkOpenError(f"{url.text}: host '{url.host}' is not known: {error.strerror}") from error
    return family, (str(address[0]), int(address[1]))


def open_error(url: LinkUrl, error: OSError | ValueError) -> LinkOpenError:
    """The error of the system, worded with its remedy."""
    code = error.errno if isinstance(error, OSError) else None
    advice = {
        errno.EADDRINUSE: f"port {url.port} is in use: stop the program that holds it, or choose another port",
        errno.EADDRNOTAVAIL: f"'{url.host}' is not an address of this machine: use 127.0.0.1 or 0.0.0.0",
        errno.EACCES: "no permission: for a serial port join the group 'dialout'; ports below 1024 need root",
        errno.ENOENT: f"there is no device '{url.host}': is it plugged in?",
        errno.EBUSY: f"'{url.host}' is in use by another program",
        errno.ENETUNREACH: f"no route to '{url.host}'",
    }.get(code or 0, str(error))
    return LinkOpenError(f"{url.text}: {advice}")
