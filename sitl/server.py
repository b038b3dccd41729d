"""Sockets and clocks around the simulation: UDP links, real time at a chosen speed, or lockstep with one driver.

Lockstep: a driver holds the step socket (TCP on the loopback). It sends ``<Q`` until_us; the vehicle first takes in all
datagrams that have arrived, runs to that time, sends its packets and answers ``<QI``: its time and how many packets it
has sent on the first link since the last answer. MAVLink traffic never moves time.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Sequence
from typing import NoReturn
from urllib.parse import urlsplit

from sitl.mavlink_face import Packet
from sitl.simulation import Simulation

_GRANT = struct.Struct("<Q")
_REPLY = struct.Struct("<QI")
_LONGEST_GRANT_US = 600_000_000
_CHUNK_US = 20_000
_MAX_LAG_S = 0.25
_SPIN_S = 5e-4
_LARGEST_DATAGRAM = 65535
_BUFFER_BYTES = 1 << 20


_PRIORITY = 10
_FASTEST_REAL_TIME = 2.0


def prefer_realtime(speed: float) -> None:
    """Ask for SCHED_FIFO: hardware does not slow down because a browser draws. Not when fast: that starves others."""
    if speed <= _FASTEST_REAL_TIME and hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))


class ServerError(ValueError):
    """A link or port that cannot be opened; the message says which and what to do."""


class UdpLink:
    """One MAVLink link over UDP. ``udpout`` sends to a peer and hears only it; ``udpin`` answers whoever spoke last."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError:
            port = None
        if parts.scheme not in ("udpout", "udpin") or port is None or (parts.scheme == "udpout" and port == 0):
            raise ServerError(f"link '{url}' is not udpout://HOST:PORT or udpin://[HOST:]PORT")
        if parts.scheme == "udpout" and not parts.hostname:
            raise ServerError(f"link '{url}' names no host; write udpout://HOST:PORT")
        host = parts.hostname or "127.0.0.1"
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        self.dropped = 0
        self._fixed = parts.scheme == "udpout"
        self._peer: tuple[str, int] | None = None
        try:
            if self._fixed:
                address = socket.gethostbyname(host)
                self._peer = (address, port)
                self.socket.bind(("127.0.0.1" if address.startswith("127.") else "", 0))
            else:
                self.socket.bind((host, port))
        except OSError as error:
            self.socket.close()
            advice = "" if self._fixed else "; is another vehicle or station using the port? Choose another one"
            raise ServerError(f"link '{url}' cannot be opened: {error.strerror or error}{advice}") from error
        if self._fixed:
            self.url = f"udpout://{host}:{port}"
        else:
            self.url = f"udpin://{host}:{self.socket.getsockname()[1]}"

    def receive(self) -> list[bytes]:
        """All datagrams that have arrived."""
        datagrams: list[bytes] = []
        while True:
            try:
                data, sender = self.socket.recvfrom(_LARGEST_DATAGRAM)
            except (BlockingIOError, ConnectionError):
                return datagrams
            if not self._fixed:
                self._peer = sender
            elif sender != self._peer:
                continue
            datagrams.append(data)

    def send(self, data: bytes) -> None:
        """Send, or count a drop: a full buffer or an absent peer never holds the vehicle up."""
        if self._peer is None:
            return
        try:
            self.socket.sendto(data, self._peer)
        except OSError:
            self.dropped += 1

    def close(self) -> None:
        """Give the port back."""
        self.socket.close()


class Server:
    """A simulation on its links. Links are closed by whoever opened them."""

    def __init__(self, simulation: Simulation, links: Sequence[UdpLink]) -> None:
        self._simulation = simulation
        self._links = links
        self._sent_on_first = 0

    def _take_in(self) -> None:
        for index, link in enumerate(self._links):
            for datagram in link.receive():
                self._simulation.receive(index, datagram)

    def _send(self, packets: Sequence[Packet]) -> None:
        for packet in packets:
            self._links[packet.link].send(packet.data)
            if packet.link == 0:
                self._sent_on_first += 1

    def run_at_speed(self, speed: float) -> NoReturn:
        """Real time times ``speed``, for ever. A machine too slow for it slips, and says so once.

        The vehicle sleeps in select until its next event or a datagram, on a monotonic clock that never drifts.
        """
        prefer_realtime(speed)
        simulation, sockets = self._simulation, [link.socket for link in self._links]
        start_s = time.monotonic() - simulation.time_us * 1e-6 / speed
        told = False
        while True:
            elapsed_us = int((time.monotonic() - start_s) * 1e6 * speed)
            lag_s = (elapsed_us - simulation.time_us) * 1e-6 / speed
            if lag_s > _MAX_LAG_S:
                start_s += lag_s
                elapsed_us = simulation.time_us
                if not told:
                    print(f"sitl: this machine does not reach speed {speed:g}, running slower", file=sys.stderr)
                    told = True
            self._take_in()
            self._send(simulation.advance(min(elapsed_us, simulation.time_us + _CHUNK_US)))
            due_s = start_s + simulation.next_due_us * 1e-6 / speed
            select.select(sockets, [], [], max(0.0, due_s - time.monotonic()))

    def run_lockstep(self, listener: socket.socket) -> NoReturn:
        """Advance only as the driver on the step socket grants, for ever. A second driver is turned away."""
        driver: socket.socket | None = None
        pending = b""
        sockets = [link.socket for link in self._links]
        while True:
            received = self._receive_soon(driver) if driver is not None else None
            if received is None:
                ready, _, _ = select.select([*sockets, listener, *([driver] if driver is not None else [])], [], [])
                if listener in ready:
                    newcomer, _ = listener.accept()
                    if driver is None:
                        newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        driver, pending = newcomer, b""
                    else:
                        newcomer.close()
                self._take_in()
                continue
            assert driver is not None
            pending += received
            try:
                while len(pending) >= _GRANT.size:
                    (until_us,) = _GRANT.unpack_from(pending)
                    pending = pending[_GRANT.size :]
                    driver.sendall(self._grant(until_us))
            except ConnectionError:
                received = b""
            if not received:
                driver.close()
                driver = None

    @staticmethod
    def _receive_soon(driver: socket.socket) -> bytes | None:
        """Bytes of the driver (empty: it has gone), or None if none come within a moment.

        A driver answers within a few hundred microseconds; sleeping and being woken would cost as much as its work.
        """
        give_up_s = time.monotonic() + _SPIN_S
        while True:
            try:
                return driver.recv(4096, socket.MSG_DONTWAIT)
            except BlockingIOError:
                if time.monotonic() > give_up_s:
                    return None
            except ConnectionError:
                return b""

    def _grant(self, until_us: int) -> bytes:
        """One step; an absurdly long grant is cut to ten minutes, as the time in the reply shows."""
        self._take_in()
        self._send(self._simulation.advance(min(until_us, self._simulation.time_us + _LONGEST_GRANT_US)))
        sent, self._sent_on_first = self._sent_on_first, 0
        return _REPLY.pack(self._simulation.time_us, sent)


def open_step_listener(port: int) -> socket.socket:
    """Listening step socket on the loopback, port 0 for any; raises ServerError if it cannot be had."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise ServerError(f"step port {port} cannot be opened: {error}; choose another one, or 0 for any") from error
    listener.listen(4)
    return listener
