"""The recorder: one folder per life of the flight process, written so that a crash loses at most a second.

``runs/<UTC>-<vehicle>/`` holds ``inputs.mpk`` (the recording, :mod:`gcs.recording_inputs`), ``flight.tlog`` (every
packet in and out, for any ground station), ``signals.mcap`` (:mod:`gcs.recording_signals`) and ``run.json``. A hub that
comes back while the same flight process runs goes on in the same folder, with a further ``signals-2.mcap``.

Files only, no threads and no sockets: :mod:`gcs.hub` drives it. A write that fails raises OSError; the hub then stops
recording and says so.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import msgspec

from gcs.machine import describe_machine, package_versions
from gcs.mavlink.tlog import TlogWriter
from gcs.recording_inputs import InputWriter, whole_part
from gcs.recording_signals import SignalWriter
from gcs.records import Event, FlightStart, GainRecord, Status, TickFrame

RUN_FORMAT = "rotorlab run 1"
LEAST_FREE_BYTES = 64 << 20
"""Room left on the disk below which recording stops, so that the machine keeps working."""

_BUFFER_BYTES = 1 << 18


class RunInfo(msgspec.Struct, kw_only=True):
    """What ``run.json`` holds. ``ended_utc`` stays empty when the recorder did not end by itself."""

    format: str = RUN_FORMAT
    session: str
    vehicle: str
    started_utc: str
    ended_utc: str = ""
    first_sequence: int = 0
    last_sequence: int = -1
    ticks: int = 0
    missing_ticks: int = 0
    last_output_hash: str = ""
    signals_left_out: int = 0
    stopped_because: str = ""
    start: FlightStart | None = None
    gain_history: tuple[GainRecord, ...] = ()
    station: dict[str, str] = {}
    versions: dict[str, str] = {}
    machine: dict[str, str] = {}
    sha256: dict[str, str] = {}


_info_decoder = msgspec.json.Decoder(RunInfo)


def read_run(folder: Path) -> RunInfo:
    """``run.json`` of a run. Raises OSError if there is none, msgspec.DecodeError if it is not one."""
    return _info_decoder.decode((folder / "run.json").read_bytes())


def list_runs(runs: Path) -> list[tuple[Path, RunInfo]]:
    """The runs below a folder, oldest first; what is not a run is passed over."""
    found = []
    for path in sorted(runs.glob("*/run.json")):
        try:
            found.append((path.parent, read_run(path.parent)))
        except (OSError, msgspec.DecodeError):
            continue
    return found


def folder_size(folder: Path) -> int:
    """Bytes in the files of a run."""
    return sum(path.stat().st_size for path in folder.iterdir() if path.is_file())


def remove_oldest(runs: Path, limit_bytes: int, keep: Path) -> list[Path]:
    """Remove the oldest runs until all together fit ``limit_bytes``; ``keep`` and foreign folders stay."""
    folders = [(folder, folder_size(folder)) for folder, _ in list_runs(runs)]
    total = sum(size for _, size in folders)
    removed = []
    for folder, size in folders:
        if total <= limit_bytes:
            break
        if folder != keep:
            shutil.rmtree(folder)
            removed.append(folder)
            total -= size
    return removed


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "vehicle"


def _utc_text(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class RunRecorder:
    """Writes one run. Raises OSError from any call when the disk does not take it."""

    def __init__(self, folder: Path, info: RunInfo) -> None:
        self.folder = folder
        self.info = info
        self._streams: list[BinaryIO] = []
        self._dirty = True
        try:
            self._inputs = InputWriter(self._open("inputs.mpk"))
            self._tlog = TlogWriter(self._open("flight.tlog"))
            self._signals = SignalWriter(self._open(_free_name(folder, "signals", ".mcap")))
            self.flush()
        except OSError:
            self._drop_streams()
            raise

    def _open(self, name: str) -> BinaryIO:
        stream = io.BufferedWriter(io.FileIO(self.folder / name, "ab"), _BUFFER_BYTES)
        stream.seek(0, os.SEEK_END)
        self._streams.append(stream)
        return stream

    def tick(self, frame: TickFrame, *, with_signals: bool = True) -> None:
        """Record a tick; ``with_signals`` False leaves it out of the MCAP export, and counts that."""
        info = self.info
        if info.ticks == 0:
            info.first_sequence = frame.sequence
        elif frame.sequence > info.last_sequence + 1:
            info.missing_ticks += frame.sequence - info.last_sequence - 1
        self._inputs.append(frame)
        for packet in frame.packets:
            self._tlog.append(packet.utc_us, packet.raw)
        if with_signals:
            self._signals.append(frame)
        else:
            info.signals_left_out += 1
        for event in frame.events:
            self._signals.append_event(event, frame.utc_s)
        info.ticks += 1
        info.last_sequence = frame.sequence
        info.last_output_hash = frame.output_hash.hex()
        self._dirty = True

    def event(self, event: Event, utc_s: float) -> None:
        """Record an event that did not come with a tick."""
        self._signals.append_event(event, utc_s)

    def status(self, status: Status) -> None:
        """Take the gain history over."""
        if status.gain_history != self.info.gain_history:
            self.info.gain_history = status.gain_history
            self._dirty = True

    def start(self, start: FlightStart) -> None:
        """Take the start over, when it comes after the first tick."""
        if self.info.start is None:
            self.info.start = start
            self._dirty = True

    def size_bytes(self) -> int:
        return folder_size(self.folder)

    def flush(self) -> None:
        """Hand everything to the operating system; the hub calls this at least once a second."""
        for stream in self._streams:
            stream.flush()
        if self._dirty:
            self._write_info()
            self._dirty = False

    def close(self, utc_s: float) -> None:
        """End the run: index, hashes, ``run.json``."""
        self._signals.close()
        for stream in self._streams:
            stream.close()
        self.info.ended_utc = _utc_text(utc_s)
        files = sorted(path for path in self.folder.iterdir() if path.name != "run.json")
        self.info.sha256 = {path.name: _sha256(path) for path in files}
        self._write_info()

    def abandon(self, reason: str) -> None:
        """End the run after a failed write, keeping what is on the disk. Does not raise."""
        self.info.stopped_because = reason
        self._drop_streams()
        try:
            self._write_info()
        except OSError:
            return

    def _drop_streams(self) -> None:
        for stream in self._streams:
            try:
                stream.close()
            except OSError:
                continue

    def _write_info(self) -> None:
        text = msgspec.json.format(msgspec.json.encode(self.info), indent=2)
        draft = self.folder / "run.json.new"
        draft.write_bytes(text + b"\n")
        draft.replace(self.folder / "run.json")


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _free_name(folder: Path, stem: str, suffix: str) -> str:
    if not (folder / f"{stem}{suffix}").exists():
        return f"{stem}{suffix}"
    number = 2
    while (folder / f"{stem}-{number}{suffix}").exists():
        number += 1
    return f"{stem}-{number}{suffix}"


def open_run(
    runs: Path, frame: TickFrame, *, vehicle: str, start: FlightStart | None, station: dict[str, str]
) -> RunRecorder:
    """The run that ``frame`` belongs to: the one of its session if it was left open, else a new one.

    Raises OSError if the folder cannot be written.
    """
    runs.mkdir(parents=True, exist_ok=True)
    resumed = _resume(runs, frame)
    if resumed is not None:
        return resumed
    stamp = datetime.fromtimestamp(frame.utc_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    folder = runs / _free_name(runs, f"{stamp}-{_slug(vehicle)}", "")
    folder.mkdir()
    info = RunInfo(
        session=frame.session,
        vehicle=vehicle,
        started_utc=_utc_text(frame.utc_s),
        start=start,
        station=station,
        versions=package_versions(),
        machine=describe_machine(),
    )
    return RunRecorder(folder, info)


def _resume(runs: Path, frame: TickFrame) -> RunRecorder | None:
    if not frame.session:
        return None
    for folder, info in reversed(list_runs(runs)):
        if info.session != frame.session or info.ended_utc or info.stopped_because:
            continue
        inputs = folder / "inputs.mpk"
        end, last, count = whole_part(inputs)
        if last is None or last >= frame.sequence:
            return None
        os.truncate(inputs, end)
        info.last_sequence, info.ticks = last, count
        info.missing_ticks = last - info.first_sequence + 1 - count
        return RunRecorder(folder, info)
    return None
