"""Serial links, such as a telemetry radio or an autopilot on USB."""

from __future__ import annotations

import os
import select

import serial

from gcs.mavlink.endpoint import MAX_DATAGRAM, MAX_READS, Backoff, Endpoint, LinkOpenError, open_error
from gcs.mavlink.urls import LinkUrl


class SerialEndpoint(Endpoint):
    """A serial port, opened again when its device went away and came back."""

    def __init__(self, url: LinkUrl) -> None:
        super().__init__(url)
        self._backoff = Backoff()
        self._backoff.reset()
        self._unsent = b""
        self._port: serial.Serial | None = self._open()

    def _open(self) -> serial.Serial:
        try:
            return serial.Serial(self.url.host, self.url.port, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise open_error(self.url, error) from error

    @property
    def connected(self) -> bool:
        return self._port is not None

    def fileno(self) -> int:
        return int(self._port.fileno()) if self._port is not None else -1

    def receive(self) -> list[bytes]:
        packets: list[bytes] = []
        for _ in range(MAX_READS):
            if self._port is None:
                break
            try:
                data = os.read(self._port.fileno(), MAX_DATAGRAM)
                # A quiet line and a device that is gone both read as nothing; only the latter is always readable.
                if not data and self._is_readable():
                    data = os.read(self._port.fileno(), MAX_DATAGRAM)
                    if not data:
                        self._lose()
            except BlockingIOError:
                break
            except OSError:
                self._lose()
                break
            if not data:
                break
            packets.append(data)
        return packets

    def _is_readable(self) -> bool:
        return bool(select.select([self.fileno()], [], [], 0.0)[0])

    def send(self, data: bytes) -> bool:
        if self._port is None or not self._flush():
            self.dropped += 1
            return False
        self._unsent = data
        self._flush()
        return True

    def _flush(self) -> bool:
        # pyserial's own write spins while the line is busy; the descriptor is non-blocking, so write to it.
        if not self._unsent or self._port is None:
            return True
        try:
            self._unsent = self._unsent[os.write(self._port.fileno(), self._unsent) :]
        except BlockingIOError:
            return False
        except OSError:
            self._lose()
            return False
        return not self._unsent

    def poll(self, now_s: float) -> None:
        if self._port is not None:
            self._flush()
        elif self._backoff.is_due(now_s):
            try:
                self._port = self._open()
            except LinkOpenError:
                return
            self._backoff.reset()
            self.generation += 1

    def _lose(self) -> None:
        if self._port is not None:
            self._port.close()
            self.generation += 1
        self._port, self._unsent = None, b""

    def close(self) -> None:
        self._lose()
