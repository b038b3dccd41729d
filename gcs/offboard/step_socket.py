"""A simulated vehicle in its own process, driven in lockstep: MAVLink over UDP, time over its step socket.

The driver sends ``<Q`` until_us and gets ``<QI``: the vehicle's time and the number of packets it sent for that step.
The step is over once that many have been received.
"""

from __future__ import annotations

import socket
import struct

_GRANT = struct.Struct("<Q")
_REPLY = struct.Struct("<QI")
_LARGEST_DATAGRAM = 65536
PACKET_TIMEOUT_S = 2.0
BUFFER_BYTES = 1 << 20


class StepSocketError(ConnectionError):
    """The vehicle's step socket cannot be reached or broke; the message says which."""


class SocketVehicle:
    """The driver's end; a :class:`gcs.offboard.lockstep.SteppedVehicle`. Loopback UDP loses nothing that fits.

    ``link`` is a UDP socket bound to the port the vehicle sends to; it is closed with the vehicle.
    """

    def __init__(self, link: socket.socket, step_port: int) -> None:
        self._link = link
        self._link.settimeout(PACKET_TIMEOUT_S)
        self._link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._peer: tuple[str, int] | None = None
        try:
            self._step = socket.create_connection(("127.0.0.1", step_port), timeout=PACKET_TIMEOUT_S)
        except OSError as error:
            raise StepSocketError(f"step socket on port {step_port}: {error}; is the vehicle in lockstep?") from error
        self._step.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._step.settimeout(None)

    def advance(self, until_us: int) -> list[bytes]:
        """Grant time and collect every packet of the step. Raises StepSocketError if the vehicle has gone."""
        self._step.sendall(_GRANT.pack(until_us))
        reply = b""
        while len(reply) < _REPLY.size:
            more = self._step.recv(_REPLY.size - len(reply))
            if not more:
                raise StepSocketError("the vehicle closed its step socket")
            reply += more
        _, count = _REPLY.unpack(reply)
        packets: list[bytes] = []
        for _ in range(count):
            try:
                data, self._peer = self._link.recvfrom(_LARGEST_DATAGRAM)
            except TimeoutError as error:
                raise StepSocketError(f"{count - len(packets)} of {count} packets of a step did not arrive") from error
            packets.append(data)
        return packets

    def send(self, packet: bytes) -> None:
        """Send to the vehicle, once it has been heard."""
        if self._peer is not None:
            self._link.sendto(packet, self._peer)

    def close(self) -> None:
        """Let go of the vehicle: another driver may take it."""
        self._step.close()
        self._link.close()
