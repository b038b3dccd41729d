"""What is recorded can be read again: inputs bit for bit, packets by any ground station, signals with their units."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from pymavlink import mavutil

from gcs.recorder import Recorder, RecorderOptions
from gcs.recording import RunInfo, RunRecorder, list_runs, open_run, read_run, remove_oldest
from gcs.recording_inputs import MAGIC, InputWriter, RecordingError, read_inputs, whole_part
from gcs.recording_signals import SignalWriter, group_schema, signal_groups
from gcs.records import Event
from gcs.signals import SIGNALS
from tests.station_rig import ROOT, flight_start, tick_frame, wait_until


def record(folder: Path, count: int, *, session: str = "life-1") -> RunRecorder:
    run = open_run(folder, tick_frame(0, session=session), vehicle="Test Quad", start=flight_start(session), station={})
    for sequence in range(count):
        run.tick(tick_frame(sequence, session=session))
    return run


def test_a_run_is_a_folder_of_four_files(tmp_path: Path) -> None:
    run = record(tmp_path, 5)
    run.close(1_700_000_060.0)
    assert run.folder.name == "20231114T221330Z-test-quad"
    names = {path.name for path in run.folder.iterdir()}
    assert names == {"inputs.mpk", "flight.tlog", "signals.mcap", "run.json"}
    info = read_run(run.folder)
    assert (info.ticks, info.first_sequence, info.last_sequence, info.missing_ticks) == (5, 0, 4, 0)
    assert info.ended_utc == "2023-11-14T22:14:20.000Z"
    assert info.start == flight_start()
    assert set(info.sha256) == names - {"run.json"}
    assert info.versions["numpy"] == np.__version__ and info.machine["processor"]


def test_inputs_come_back_as_they_were(tmp_path: Path) -> None:
    run = record(tmp_path, 50)
    run.close(0.0)
    records = list(read_inputs(run.folder / "inputs.mpk"))
    for sequence, read in enumerate(records):
        frame = tick_frame(sequence)
        assert (read.sequence, read.t_s, read.utc_s) == (sequence, frame.t_s, frame.utc_s)
        assert msgspec.msgpack.encode(read.inputs) == msgspec.msgpack.encode(frame.inputs)
        assert read.output_hash == frame.output_hash
    assert len(records) == 50


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 40, 100])
def test_a_torn_tail_costs_the_torn_records_only(cut: int, tmp_path: Path) -> None:
    run = record(tmp_path, 20)
    run.close(0.0)
    path = run.folder / "inputs.mpk"
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    sequences = [record.sequence for record in read_inputs(path)]
    assert sequences == list(range(len(sequences)))
    assert 18 <= len(sequences) <= 19
    end, last, count = whole_part(path)
    assert (last, count) == (len(sequences) - 1, len(sequences)) and end <= len(whole) - cut


def test_a_damaged_record_ends_the_recording(tmp_path: Path) -> None:
    run = record(tmp_path, 20)
    run.close(0.0)
    path = run.folder / "inputs.mpk"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    assert 8 <= len(list(read_inputs(path))) <= 10


def test_a_foreign_file_is_not_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "inputs.mpk"
    path.write_bytes(b"something else entirely\n")
    with pytest.raises(RecordingError, match="not a recording"):
        list(read_inputs(path))


def test_the_tlog_opens_in_pymavlink(tmp_path: Path) -> None:
    run = record(tmp_path, 5)
    run.close(0.0)
    log = mavutil.mavlink_connection(str(run.folder / "flight.tlog"))
    stamps = []
    while (message := log.recv_match()) is not None:
        assert message.get_type() == "HEARTBEAT"
        stamps.append(message._timestamp)
    assert stamps == pytest.approx([1_700_000_000.0 + sequence * 1e-6 for sequence in range(5)], abs=1e-6)


def test_the_mcap_opens_and_its_schemas_carry_units(tmp_path: Path) -> None:
    run = record(tmp_path, 30)
    run.event(Event(10.0, "caution", "Battery low.", "hub", "anna"), 1_700_000_010.0)
    run.close(0.0)
    with (run.folder / "signals.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {f"/{group}" for group in signal_groups()} | {"/event"}
        schemas = {schema.name: json.loads(schema.data) for schema in summary.schemas.values()}
        velocity = schemas["rotorlab.estimate"]["properties"]["velocity_ned"]
        assert velocity["unit"] == "m/s" and velocity["properties"]["north"]["unit"] == "m/s"
        rows = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["/estimate"])]
        assert [row["position_ned"]["north"] for row in rows] == list(range(30))
        assert "velocity_ned" not in rows[0], "what has no value is left out, JSON has no NaN"
        (log,) = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["/event"])]
        assert log["message"] == "Battery low." and log["name"] == "hub, anna" and log["level"] == 3


def test_every_signal_of_the_table_has_its_unit_in_a_schema() -> None:
    found = {}
    for group, signals in signal_groups().items():
        for name, schema in group_schema(group, signals)["properties"].items():
            found[f"{group}.{name}" if group != name else name] = schema["unit"]
    assert found == {signal.name: signal.unit for signal in SIGNALS}


def test_an_mcap_that_was_not_closed_is_read_from_the_start(tmp_path: Path) -> None:
    with (tmp_path / "signals.mcap").open("wb") as stream:
        writer = SignalWriter(stream)
        for sequence in range(2000):
            writer.append(tick_frame(sequence))
        writer.flush()
    with (tmp_path / "signals.mcap").open("rb") as stream:
        messages = 0
        try:
            for item in StreamReader(stream).records:
                messages += type(item).__name__ == "Message"
        except McapError:
            pass  # The file ends without a footer; what came before counts.
    assert messages > 1000


def test_gaps_are_counted_and_the_session_resumes_in_its_folder(tmp_path: Path) -> None:
    run = record(tmp_path, 10)
    run.tick(tick_frame(15))
    run.flush()
    assert read_run(run.folder).missing_ticks == 5
    again = open_run(tmp_path, tick_frame(20), vehicle="Test Quad", start=None, station={})
    again.tick(tick_frame(20))
    again.close(0.0)
    assert again.folder == run.folder
    info = read_run(run.folder)
    assert (info.ticks, info.last_sequence, info.missing_ticks) == (12, 20, 9)
    assert info.start == flight_start(), "what the first hub wrote is kept"
    assert (run.folder / "signals-2.mcap").is_file()


def test_another_session_or_an_ended_run_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    first = record(tmp_path, 3)
    other = record(tmp_path, 3, session="life-2")
    other.close(0.0)
    late = open_run(tmp_path, tick_frame(9, session="life-2"), vehicle="Test Quad", start=None, station={})
    assert len({first.folder, other.folder, late.folder}) == 3


def test_old_runs_make_room_and_foreign_folders_stay(tmp_path: Path) -> None:
    runs = []
    for number in range(4):
        run = record(tmp_path, 3, session=f"life-{number}")
        run.close(0.0)
        runs.append(run.folder)
    foreign = tmp_path / "holiday pictures"
    foreign.mkdir()
    (foreign / "beach.jpg").write_bytes(b"x" * 100_000)
    size = sum(path.stat().st_size for path in runs[0].iterdir())
    assert remove_oldest(tmp_path, 2 * size + size // 2, runs[3]) == runs[:2]
    assert [folder for folder, _ in list_runs(tmp_path)] == runs[2:]
    assert (foreign / "beach.jpg").exists()
    assert remove_oldest(tmp_path, 0, runs[3]) == [runs[2]], "the run being written is kept"


DISK_LIMIT = """
import resource, sys, signal
from pathlib import Path
from gcs.recorder import Recorder, RecorderOptions
from tests.station_rig import tick_frame, wait_until
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
events = []
recorder = Recorder(RecorderOptions(Path(sys.argv[1]), 10**12, {}, 0), lambda level, text: events.append((level, text)))
for sequence in range(4000):
    recorder.put(tick_frame(sequence))
wait_until(lambda: recorder.status.state == "stopped")
print(events, recorder.status.reason)
recorder.put(tick_frame(4000))
recorder.put(tick_frame(0, session="life-2"))
wait_until(lambda: recorder.status.state == "recording")
recorder.close()
"""


def test_a_disk_that_takes_no_more_stops_the_recording_not_the_process(tmp_path: Path) -> None:
    """A limit on file size stands for the full disk: the same kind of error from the same write."""
    done = subprocess.run(
        [sys.executable, "-c", DISK_LIMIT, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert "Recording stopped: File too large. Free space" in done.stdout
    assert done.stdout.count("caution") == 1, "said once, not for every tick"
    stopped, fresh = sorted((info for _, info in list_runs(tmp_path)), key=lambda info: info.session)
    assert stopped.stopped_because.startswith("File too large") and stopped.ticks > 100
    assert fresh.session == "life-2", "the next run tries again"
    assert [record.sequence for record in read_inputs(_folder(tmp_path, stopped) / "inputs.mpk")][:100] == list(
        range(100)
    )


def _folder(runs: Path, info: RunInfo) -> Path:
    return next(folder for folder, each in list_runs(runs) if each.session == info.session)


def test_too_little_room_stops_the_recording(tmp_path: Path) -> None:
    events: list[str] = []
    free = shutil.disk_usage(tmp_path).free
    options = RecorderOptions(tmp_path, 10**12, {}, least_free_bytes=2 * free)
    recorder = Recorder(options, lambda _level, text: events.append(text))
    recorder.put(tick_frame(0))
    wait_until(lambda: recorder.status.state == "stopped")
    recorder.close()
    assert "left on the disk. Free space" in events[0]


def test_a_folder_that_cannot_be_written_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file where the folder should be")
    events: list[str] = []
    recorder = Recorder(RecorderOptions(tmp_path / "runs", 10**12, {}), lambda _level, text: events.append(text))
    for sequence in range(50):
        recorder.put(tick_frame(sequence))
    wait_until(lambda: recorder.status.state == "stopped")
    recorder.close()
    assert len(events) == 1 and "Recording stopped" in events[0]


def test_the_writer_starts_a_file_once(tmp_path: Path) -> None:
    path = tmp_path / "inputs.mpk"
    for sequence in range(2):
        with path.open("ab") as stream:
            stream.seek(0, os.SEEK_END)
            InputWriter(stream).append(tick_frame(sequence))
    assert path.read_bytes().count(MAGIC) == 1
    assert [record.sequence for record in read_inputs(path)] == [0, 1]
