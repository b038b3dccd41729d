"""TCP links: one that connects, again and again, and one that listens and serves a single peer at a time."""

from __future__ import annotations

import errno
import socket

from gcs.mavlink.endpoint import MAX_DATAGRAM, MAX_READS, Backoff, Endpoint, open_error, resolve
from gcs.mavlink.urls import LinkUrl

_WOULD_BLOCK = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINPROGRESS)


class TcpEndpoint(Endpoint):
    """``tcpout`` connects, and again whenever the connection is lost; ``tcpin`` listens and serves one peer."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._family, self._address = resolve(url)
        self._stream: socket.socket | None = None
        self._listener: socket.socket | None = None
        self._connecting = False
        self._unsent = b""
        self._backoff = Backoff()
        if url.scheme == "tcpin":
            listener = socket.socket(self._family, socket.SOCK_STREAM)
            try:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.setblocking(False)
                listener.bind(self._address)
                listener.listen(1)
            except OSError as error:
                listener.close()
                raise open_error(url, error) from error
            self._listener = listener

    @property
    def connected(self) -> bool:
        return self._stream is not None and not self._connecting

    @property
    def port(self) -> int:
        """Local port of a listener, also where the URL asked for any free one with 0."""
        bound = self._listener or self._stream
        return int(bound.getsockname()[1]) if bound is not None else 0

    def fileno(self) -> int:
        current = self._stream or self._listener
        return current.fileno() if current is not None else -1

    def receive(self) -> list[bytes]:
        if not self.connected:
            self._establish()
        packets: list[bytes] = []
        for _ in range(MAX_READS):
            if self._stream is None or self._connecting:
                break
            try:
                data = self._stream.recv(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._lose()
                break
            packets.append(data)
        return packets

    def send(self, data: bytes) -> bool:
        # A packet is sent whole or not at all: what a full socket left of the last one goes first.
        if self._stream is None or self._connecting or not self._flush():
            self.dropped += 1
            return False
        self._unsent = data
        self._flush()
        return True

    def _flush(self) -> bool:
        if not self._unsent or self._stream is None:
            return True
        try:
            self._unsent = self._unsent[self._stream.send(self._unsent) :]
        except BlockingIOError:
            return False
        except OSError:
            self._lose()
            return False
        return not self._unsent

    def poll(self, now_s: float) -> None:
        if self.connected:
            self._flush()
            return
        self._establish()
        if self._listener is None and not self.connected and self._backoff.is_due(now_s):
            self._connect()

    def _connect(self) -> None:
        """Begin a connection; one that hangs since the last attempt is given up."""
        if self._stream is not None:
            self._lose()
        stream = socket.socket(self._family, socket.SOCK_STREAM)
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        code = stream.connect_ex(self._address)
        if code not in (0, *_WOULD_BLOCK):
            stream.close()
            return
        self._stream, self._connecting = stream, True
        self.generation += 1
        self._establish()

    def _establish(self) -> None:
        """Take up a connection that has come about, as the one who asked or the one who was asked."""
        if self._listener is not None and self._stream is None:
            try:
                self._stream, _ = self._listener.accept()
            except OSError:
                return
            self._stream.setblocking(False)
            self._stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.generation += 1
        elif self._stream is not None and self._connecting:
            if self._stream.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                self._lose()
                return
            try:
                self._stream.getpeername()
            except OSError:
                return
            self._connecting = False
            self._backoff.reset()

    def _lose(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self.generation += 1
        self._stream, self._connecting, self._unsent = None, False, b""

    def close(self) -> None:
        self._lose()
        if self._listener is not None:
            self._listener.close()
            self._listener = None
