"""What goes to the browsers: signal frames, status and events, from one feed to any number of WebSockets.

Every browser has its own bounded outbox in which the newest wins: one that reads slowly misses frames, and holds up
nobody.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from gcs.records import Event, RecordingStatus
from gcs.signals import FRAME_SIZE, SIGNALS, SLICES
from models.arrays import Array
from web.auth import Session, SessionStore

FRAME_BYTES = 8 * FRAME_SIZE
# More than a page's usual window would hold up the status behind it where a browser draws without a graphics card.
BACKLOG_S = 30.0
_BACKLOG_FRAMES = 1500
_OUTBOX_FRAMES = 250
_EVENTS_KEPT = 1000
_EVENTS_IN_HELLO = 100
_CHUNK_FRAMES = 256
_SEND_TIMEOUT_S = 10.0
_IDLE_CHECK_S = 2.0


def signal_table() -> list[dict[str, Any]]:
    """The signal table for a browser: where in a frame of float64 each signal starts, and what it is."""
    return [
        {
            "name": signal.name,
            "unit": signal.unit,
            "labels": list(signal.labels),
            "offset": SLICES[signal.name].start,
            "size": signal.size,
            "description": signal.description,
        }
        for signal in SIGNALS
    ]


def event_fields(event: Event) -> dict[str, Any]:
    return {"type": "event", **msgspec.structs.asdict(event)}


class Outbox:
    """What one browser has not been sent yet."""

    def __init__(self) -> None:
        self.frames: deque[bytes] = deque(maxlen=_OUTBOX_FRAMES)
        self.texts: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self.status: str | None = None
        self.ready = asyncio.Event()

    def take(self) -> tuple[list[str], bytes]:
        """Empty the outbox: texts, status last, and the frames joined."""
        texts = list(self.texts)
        if self.status is not None:
            texts.append(self.status)
        frames = b"".join(self.frames)
        self.texts.clear()
        self.frames.clear()
        self.status = None
        self.ready.clear()
        return texts, frames


class Feed:
    """Newest state of the station, with enough of the past to fill a page that opens now. Lives on one event loop."""

    def __init__(self) -> None:
        self.status: dict[str, Any] | None = None
        self.events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self.malformed = 0
        self._recording: dict[str, Any] = {}
        self._frames: deque[bytes] = deque(maxlen=_BACKLOG_FRAMES)
        self._outboxes: dict[Outbox, Session] = {}

    @property
    def newest_frame(self) -> bytes | None:
        return self._frames[-1] if self._frames else None

    def newest_signals(self) -> Array | None:
        """The newest frame as numbers, a copy."""
        newest = self.newest_frame
        return np.frombuffer(newest).copy() if newest is not None else None

    @property
    def watchers(self) -> list[str]:
        """Names of the sessions that have a page open, each once."""
        return sorted({session.name for session in self._outboxes.values()})

    def add_signals(self, payload: bytes) -> None:
        """Take one or more joined frames of :mod:`gcs.signals`; anything of another length is counted and dropped."""
        if not payload or len(payload) % FRAME_BYTES:
            self.malformed += 1
            return
        for start in range(0, len(payload), FRAME_BYTES):
            frame = payload[start : start + FRAME_BYTES]
            self._frames.append(frame)
            for outbox in self._outboxes:
                outbox.frames.append(frame)
                outbox.ready.set()

    def add_status(self, payload: bytes) -> None:
        """Take a status as JSON."""
        status = self._object(payload)
        if status is None:
            return
        self.status = {**status, **self._recording, "type": "status"}
        text = msgspec.json.encode(self.status).decode()
        for outbox in self._outboxes:
            outbox.status = text
            outbox.ready.set()

    def add_recording(self, recording: RecordingStatus) -> None:
        """Take the state of the recorder; it goes out with the next status."""
        self._recording = {
            "recording": recording.run if recording.state == "recording" else "",
            "recording_state": recording.state,
            "recording_bytes": recording.size_bytes,
            "recording_reason": recording.reason,
        }

    def add_event(self, event: Event) -> None:
        self.events.append(event)
        self._tell(event_fields(event))

    def frames(self) -> Iterator[bytes]:
        """Frames of the last half minute, oldest first."""
        return iter(tuple(self._frames))

    def backlog(self) -> list[bytes]:
        """Signal frames of the last half minute, joined into chunks."""
        frames = list(self._frames)
        return [b"".join(frames[i : i + _CHUNK_FRAMES]) for i in range(0, len(frames), _CHUNK_FRAMES)]

    def attach(self, session: Session) -> Outbox:
        outbox = Outbox()
        self._outboxes[outbox] = session
        self._tell({"type": "watchers", "names": self.watchers})
        return outbox

    def detach(self, outbox: Outbox) -> None:
        self._outboxes.pop(outbox, None)
        self._tell({"type": "watchers", "names": self.watchers})

    def hello(self) -> dict[str, Any]:
        recent = list(self.events)[-_EVENTS_IN_HELLO:]
        return {
            "type": "hello",
            "signals": signal_table(),
            "frame_size": FRAME_SIZE,
            "backlog_seconds": BACKLOG_S,
            "status": self.status,
            "events": [event_fields(event) for event in recent],
            "watchers": self.watchers,
        }

    def _object(self, payload: bytes) -> dict[str, Any] | None:
        try:
            return msgspec.json.decode(payload, type=dict[str, Any])
        except msgspec.DecodeError:
            self.malformed += 1
            return None

    def _tell(self, message: dict[str, Any]) -> None:
        text = msgspec.json.encode(message).decode()
        for outbox in self._outboxes:
            outbox.texts.append(text)
            outbox.ready.set()


async def serve_stream(socket: WebSocket, feed: Feed, session: Session, sessions: SessionStore) -> None:
    """Feed one browser until it leaves, is logged out, or has not read for ten seconds."""
    await socket.accept()
    outbox = feed.attach(session)
    backlog = feed.backlog()
    hello = msgspec.json.encode(feed.hello()).decode()
    tasks = {
        asyncio.create_task(_send(socket, outbox, hello, backlog, session, sessions)),
        asyncio.create_task(_until_closed(socket)),
    }
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            failure = task.exception()
            if failure is not None and not isinstance(failure, (WebSocketDisconnect, TimeoutError)):
                raise failure
    finally:
        feed.detach(outbox)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _send(
    socket: WebSocket, outbox: Outbox, hello: str, backlog: list[bytes], session: Session, sessions: SessionStore
) -> None:
    async with asyncio.timeout(_SEND_TIMEOUT_S):
        await socket.send_text(hello)
    for chunk in backlog:
        async with asyncio.timeout(_SEND_TIMEOUT_S):
            await socket.send_bytes(chunk)
    while sessions.is_open(session):
        try:
            async with asyncio.timeout(_IDLE_CHECK_S):
                await outbox.ready.wait()
        except TimeoutError:
            continue
        texts, frames = outbox.take()
        async with asyncio.timeout(_SEND_TIMEOUT_S):
            for text in texts:
                await socket.send_text(text)
            if frames:
                await socket.send_bytes(frames)
    await socket.close(1008, "The session was closed. Log in again.")


async def _until_closed(socket: WebSocket) -> None:
    """The stream has no way in: whatever a page sends is ignored."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
