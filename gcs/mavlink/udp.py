"""UDP links: one that binds and locks to the first peer, one that speaks to a given address."""

from __future__ import annotations

import socket

from gcs.mavlink.codec import MAGIC_V1, MAGIC_V2
from gcs.mavlink.endpoint import MAX_DATAGRAM, MAX_READS, Endpoint, open_error, resolve
from gcs.mavlink.urls import LinkUrl

# A peer silent for this long loses its lock to another that speaks.
PEER_SILENT_S = 5.0


class UdpEndpoint(Endpoint):
    """``udpin`` binds and locks to the first peer that speaks MAVLink; ``udpout`` speaks to one address."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._peer: tuple[str, int] | None = None
        self._heard = False
        self._heard_s: float | None = None
        family = resolve(url)
        self._socket = socket.socket(family[0], socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._listens = url.scheme == "udpin"
        try:
            if self._listens:
                self._socket.bind(family[1])
            else:
                self._socket.connect(family[1])
        except OSError as error:
            self._socket.close()
            raise open_error(url, error) from error

    @property
    def connected(self) -> bool:
        return not self._listens or self._peer is not None

    @property
    def port(self) -> int:
        """Local port, also where the URL asked for any free one with 0."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> list[bytes]:
        packets: list[bytes] = []
        for _ in range(MAX_READS):
            try:
                data, peer = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except OSError:
                # A datagram of ours found no listener (ICMP): the vehicle is not there yet.
                continue
            if not self._listens or peer == self._peer or self._takes(peer, data):
                packets.append(data)
            else:
                self.foreign += 1
        self._heard = self._heard or bool(packets)
        return packets

    def _takes(self, peer: tuple[str, int], data: bytes) -> bool:
        if self._peer is not None or not data or data[0] not in (MAGIC_V1, MAGIC_V2):
            return False
        self._peer = peer
        return True

    def send(self, data: bytes) -> bool:
        try:
            if not self._listens:
                self._socket.send(data)
                return True
            if self._peer is not None:
                self._socket.sendto(data, self._peer)
                return True
        except OSError:
            # Full buffer, no route, nobody there: UDP promises nothing, and neither do we.
            pass
        self.dropped += 1
        return False

    def poll(self, now_s: float) -> None:
        if self._heard or self._heard_s is None:
            self._heard_s = now_s
            self._heard = False
        elif now_s - self._heard_s > PEER_SILENT_S:
            self._peer = None

    def close(self) -> None:
        self._socket.close()
