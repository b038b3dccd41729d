"""Between the station's bus and the pages: what arrives goes into feed and scene; commands go out and are answered."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import msgspec
import numpy as np
from anyio import to_thread

from gcs.bus import Backlog, Bus, BusError, Topic, decode_event, decode_recording, open_client
from gcs.commands import Answer, Request
from models.arrays import Array
from web.scene import TRAIL_S, Scene
from web.stream import Feed

_SCENE_PERIOD_S = 0.05
_CONNECT_TIMEOUT_S = 5.0
_NO_HUB = "The hub does not answer, nothing was sent. Look at the output of gcs up."


class StationLink:
    """The web process's end of the bus. The pages are served whether or not there is a hub yet."""

    def __init__(self, socket: Path, feed: Feed, scene: Scene) -> None:
        self._socket = socket
        self._feed = feed
        self._scene = scene
        self._bus: Bus | None = None

    async def send(self, request: Request) -> Answer:
        """Give a command; without a hub it is refused and not kept for later."""
        bus = self._bus
        if bus is None:
            return Answer(request.number, False, _NO_HUB)
        try:
            return await to_thread.run_sync(bus.request, request)
        except BusError:
            return Answer(request.number, False, _NO_HUB)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Keep feed and scene up to date for as long as the context lasts."""
        tasks = [
            asyncio.create_task(self._connect()),
            asyncio.create_task(self._draw()),
            asyncio.create_task(to_thread.run_sync(_warm_up)),
        ]
        for task in tasks:
            task.add_done_callback(_report_failure)
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            if self._bus is not None:
                await to_thread.run_sync(self._bus.close)
            self._scene.close()

    async def _connect(self) -> None:
        bus = await self._find_hub()
        self._bus = bus
        with suppress(BusError):  # A hub without a past; the present arrives below.
            self._refill(await to_thread.run_sync(bus.backlog))
        loop = asyncio.get_running_loop()
        feed = self._feed

        def on_loop(take: Callable[[bytes], None]) -> Callable[[bytes], None]:
            return lambda payload: _call_soon(loop, take, payload)

        bus.subscribe(Topic.SIGNALS, on_loop(feed.add_signals))
        bus.subscribe(Topic.STATUS, on_loop(feed.add_status))
        bus.subscribe(Topic.EVENT, on_loop(self._take_event))
        bus.subscribe(Topic.RECORDING, on_loop(self._take_recording))

    async def _find_hub(self) -> Bus:
        while True:
            try:
                return await to_thread.run_sync(open_client, self._socket, _CONNECT_TIMEOUT_S, abandon_on_cancel=True)
            except BusError:
                await asyncio.sleep(_CONNECT_TIMEOUT_S / 10.0)

    def _refill(self, backlog: Backlog) -> None:
        feed = self._feed
        if backlog.frames:
            feed.add_signals(backlog.frames)
        for event in backlog.events:
            feed.add_event(event)
        if backlog.recording is not None:
            feed.add_recording(backlog.recording)
        if backlog.status is not None:
            feed.add_status(msgspec.json.encode(backlog.status))
        frames = [_frame(payload) for payload in feed.frames()]
        for frame in frames:
            if frames[-1][0] - frame[0] <= TRAIL_S:
                self._scene.update(frame)

    def _take_event(self, payload: bytes) -> None:
        try:
            self._feed.add_event(decode_event(payload))
        except msgspec.DecodeError:
            self._feed.malformed += 1

    def _take_recording(self, payload: bytes) -> None:
        try:
            self._feed.add_recording(decode_recording(payload))
        except msgspec.DecodeError:
            self._feed.malformed += 1

    async def _draw(self) -> None:
        shown = None
        while True:
            await asyncio.sleep(_SCENE_PERIOD_S)
            newest = self._feed.newest_frame
            if newest is not None and newest is not shown:
                shown = newest
                self._scene.update(_frame(newest))


def _frame(payload: bytes) -> Array:
    """A writable copy: the compiled kernels take no read-only arrays."""
    return np.frombuffer(payload).copy()


def _report_failure(task: asyncio.Task[None]) -> None:
    """A task that ends by an error says so at once, not when the server is stopped."""
    if not task.cancelled() and (failure := task.exception()) is not None:
        task.get_loop().call_exception_handler({"message": "station link failed", "exception": failure, "task": task})


def _call_soon(loop: asyncio.AbstractEventLoop, take: Callable[[bytes], None], payload: bytes) -> None:
    """Hand a payload from a thread of zenoh to the event loop, unless that has just been closed."""
    if not loop.is_closed():
        loop.call_soon_threadsafe(take, payload)


def _warm_up() -> None:
    """Load the code of predictions in the background, after the page can be opened."""
    from web.design import warm_up

    warm_up()
