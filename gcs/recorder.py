"""The recorder's thread: takes frames from the hub, never holds it up, and writes them with :mod:`gcs.recording`.

The queue is bounded. Half full, the MCAP export is thinned; full, ticks are missing from the recording and counted. A
write that fails ends the recording with an event; the next run tries again.
"""

from __future__ import annotations

import queue
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gcs.recording import LEAST_FREE_BYTES, RunRecorder, open_run, remove_oldest
from gcs.records import Event, FlightStart, RecordingStatus, Status, TickFrame

FLUSH_PERIOD_S = 0.5
QUEUE_FRAMES = 8000
CLOSE_TIMEOUT_S = 10.0

_Item = TickFrame | Status | FlightStart | tuple[Event, float] | None


@dataclass(frozen=True, slots=True)
class RecorderOptions:
    """Where runs go, how much they may take together [bytes], and notes on the station for ``run.json``."""

    runs: Path
    keep_bytes: int
    station: dict[str, str]
    least_free_bytes: int = LEAST_FREE_BYTES


class Recorder:
    """Records what it is given on its own thread; ``on_event(level, text)`` is called on that thread."""

    def __init__(self, options: RecorderOptions, on_event: Callable[[str, str], None]) -> None:
        self._options = options
        self._on_event = on_event
        self._queue: queue.Queue[_Item] = queue.Queue(QUEUE_FRAMES)
        self._run: RunRecorder | None = None
        self._refused_session: str | None = None
        self._start: FlightStart | None = None
        self._vehicle = "vehicle"
        self._lost = 0
        self._status = RecordingStatus("waiting")
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecordingStatus:
        """What the recorder did up to its last flush."""
        return self._status

    def put(self, item: TickFrame | Status | FlightStart | tuple[Event, float]) -> None:
        """Hand something over; never waits. What finds the queue full is lost and shows as missing ticks."""
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Write what is waiting, end the run, and stop; gives up on a disk that hangs."""
        try:
            self._queue.put(None, timeout=CLOSE_TIMEOUT_S)
        except queue.Full:
            return
        self._thread.join(CLOSE_TIMEOUT_S)

    def _work(self) -> None:
        flush_due_s = time.monotonic() + FLUSH_PERIOD_S
        while True:
            try:
                item = self._queue.get(timeout=max(0.0, flush_due_s - time.monotonic()))
            except queue.Empty:
                pass
            else:
                if item is None:
                    self._end()
                    return
                self._guarded(partial(self._take, item))
            if time.monotonic() >= flush_due_s:
                flush_due_s = time.monotonic() + FLUSH_PERIOD_S
                self._guarded(self._flush)

    def _guarded(self, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            self._stop(f"{error.strerror or error}. Free space, then restart the flight process.")

    def _take(self, item: _Item) -> None:
        match item:
            case TickFrame():
                self._tick(item)
            case Status():
                self._vehicle = item.vehicle_name or self._vehicle
                if self._run is not None:
                    self._run.status(item)
            case FlightStart():
                self._start = item
                self._vehicle = item.vehicle_name or self._vehicle
                if self._run is not None and self._run.info.session == item.session:
                    self._run.start(item)
            case (Event() as event, float() as utc_s):
                if self._run is not None:
                    self._run.event(event, utc_s)

    def _tick(self, frame: TickFrame) -> None:
        if self._refused_session == frame.session:
            return
        run = self._run
        if run is not None and (run.info.session != frame.session or frame.sequence <= run.info.last_sequence):
            self._end()
            run = None
        if run is None:
            run = self._begin(frame)
        run.tick(frame, with_signals=self._queue.qsize() < QUEUE_FRAMES // 2)

    def _begin(self, frame: TickFrame) -> RunRecorder:
        self._refused_session = None
        start = self._start if self._start is not None and self._start.session == frame.session else None
        try:
            run = open_run(self._options.runs, frame, vehicle=self._vehicle, start=start, station=self._options.station)
        except OSError:
            self._refused_session = frame.session
            raise
        self._run = run
        for folder in remove_oldest(self._options.runs, self._options.keep_bytes, run.folder):
            self._on_event("advisory", f"Old run {folder.name} removed, limit {_size(self._options.keep_bytes)}.")
        return run

    def _flush(self) -> None:
        run = self._run
        if run is None:
            return
        run.flush()
        free = shutil.disk_usage(run.folder).free
        self._status = RecordingStatus(
            "recording",
            run=run.folder.name,
            size_bytes=run.size_bytes(),
            free_bytes=free,
            ticks=run.info.ticks,
            missing_ticks=run.info.missing_ticks,
        )
        if free < self._options.least_free_bytes:
            self._stop(f"{_size(free)} left on the disk. Free space, then restart the flight process.")

    def _stop(self, reason: str) -> None:
        run, self._run = self._run, None
        name = ""
        if run is not None:
            self._refused_session = run.info.session
            name = run.folder.name
            run.abandon(reason)
        self._status = RecordingStatus("stopped", run=name, reason=reason)
        self._on_event("caution", f"Recording stopped: {reason}")

    def _end(self) -> None:
        run, self._run = self._run, None
        if run is None:
            return
        try:
            run.close(time.time())
        except OSError as error:
            run.abandon(error.strerror or str(error))
        self._status = RecordingStatus("waiting", run=run.folder.name)


def _size(size_bytes: int) -> str:
    return f"{size_bytes / 1e9:.1f} GB" if size_bytes >= 1e9 else f"{size_bytes / 1e6:.0f} MB"
