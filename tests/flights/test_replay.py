"""Flights of a real autopilot through our codec, fold and filter, against the truth recorded beside them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.mavlink.tlog import TlogReader, TlogWriter
from gcs.replay import ReplayError, ReplayReport, replay_log

EXCERPTS = Path(__file__).parents[1] / "data"
RECORDINGS = Path(__file__).parents[2].parent / "shared" / "data"
COPTER, HELICOPTER, PLANE = "arducopter_guided", "ardupilot_heli_cruise", "arduplane_wind"

# Root-mean-square limits: roll and pitch [deg], heading [deg], position in three dimensions [m].
LIMITS = {COPTER: (0.5, 2.0, 0.5), HELICOPTER: (1.0, 4.0, 1.0), PLANE: (1.0, 2.0, 1.5)}
MESSAGES = {COPTER: 148918, HELICOPTER: 184948, PLANE: 194812}
KEYS = ("roll_rms_deg", "pitch_rms_deg", "heading_rms_deg", "position_rms_m")


def assert_within(report: ReplayReport, name: str) -> None:
    tilt_deg, heading_deg, position_m = LIMITS[name]
    assert report.reference == "SIM_STATE"
    for error, limit in zip(
        (report.ours.roll_rms_deg, report.ours.pitch_rms_deg, report.ours.heading_rms_deg, report.ours.position_rms_m),
        (tilt_deg, tilt_deg, heading_deg, position_m),
        strict=True,
    ):
        assert error is not None
        assert 0.0 < error <= limit
    assert sum(report.accounted.values()) == report.messages_total
    assert report.time_offset_s is not None
    assert abs(report.time_offset_s) < 0.05


@pytest.mark.parametrize("name", LIMITS)
def test_excerpt_against_truth(name: str) -> None:
    report = replay_log(EXCERPTS / f"{name}_excerpt.tlog")
    assert_within(report, name)
    assert report.messages_bad == 0
    assert report.updates["gnss_position"] > 250
    # A good filter of a good flight rejects next to nothing.
    assert sum(report.rejected.values()) < 0.01 * sum(report.updates.values())
    # The simulator's receiver is some .07 s late; the search starts at .1 s.
    assert 0.05 < report.gnss_delay_s < 0.12


@pytest.mark.parametrize("name", LIMITS)
def test_whole_flight_against_truth(name: str) -> None:
    path = RECORDINGS / f"{name}.tlog"
    if not path.exists():
        pytest.skip(f"{path.name} is not at hand: the whole recordings live beside the repository")
    report = replay_log(path)
    assert_within(report, name)
    assert report.messages_total == MESSAGES[name]
    assert report.messages_bad == 0
    assert not any("rejected" in text for text in report.resets)


def test_report_as_json_has_the_promised_keys() -> None:
    progress: list[float] = []
    report = replay_log(EXCERPTS / f"{COPTER}_excerpt.tlog", progress=progress.append)
    flat = json.loads(json.dumps(report.to_json()))
    for key in ("messages_total", "messages_bad", *KEYS, *(f"autopilot_{key}" for key in KEYS)):
        assert isinstance(flat[key], int | float)
    assert progress == sorted(progress)
    assert progress
    assert progress[-1] <= 1.0


def test_the_result_depends_on_the_file_alone() -> None:
    path = EXCERPTS / f"{HELICOPTER}_excerpt.tlog"
    assert replay_log(path) == replay_log(path)


def _rewrite(source: Path, target: Path, *, without: frozenset[int] = frozenset(), damage_every: int = 0) -> int:
    """Copy a log without some messages, or with some packets damaged; returns how many were."""
    damaged = 0
    with target.open("wb") as stream:
        writer = TlogWriter(stream)
        for index, (utc_us, packet) in enumerate(TlogReader(source)):
            message_id = int.from_bytes(packet[7:10], "little")
            if message_id in without:
                continue
            if damage_every and index % damage_every == damage_every - 1:
                packet = packet[:12] + bytes([packet[12] ^ 0x5A]) + packet[13:]
                damaged += 1
            writer.append(utc_us, packet)
    return damaged


def test_without_truth_the_autopilot_is_the_reference(tmp_path: Path) -> None:
    log = tmp_path / "no_truth.tlog"
    _rewrite(EXCERPTS / f"{COPTER}_excerpt.tlog", log, without=frozenset({108}))
    report = replay_log(log)
    assert report.reference == "autopilot"
    assert report.autopilot.roll_rms_deg is None
    assert report.ours.roll_rms_deg is not None
    assert report.ours.roll_rms_deg < 0.5
    assert report.ours.position_rms_m is not None
    assert report.ours.position_rms_m < 0.5


def test_damaged_packets_are_counted_and_do_no_harm(tmp_path: Path) -> None:
    log = tmp_path / "damaged.tlog"
    damaged = _rewrite(EXCERPTS / f"{COPTER}_excerpt.tlog", log, damage_every=50)
    report = replay_log(log)
    assert damaged > 200
    assert report.messages_bad == pytest.approx(damaged, rel=0.02)
    tilt_deg, heading_deg, position_m = LIMITS[COPTER]
    assert report.ours.roll_rms_deg is not None
    assert report.ours.roll_rms_deg < tilt_deg
    assert report.ours.heading_rms_deg is not None
    assert report.ours.heading_rms_deg < heading_deg
    assert report.ours.position_rms_m is not None
    assert report.ours.position_rms_m < position_m


def test_what_cannot_be_replayed_says_why(tmp_path: Path) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    with pytest.raises(ReplayError, match="no HEARTBEAT"):
        replay_log(empty)
    blind = tmp_path / "blind.tlog"
    _rewrite(EXCERPTS / f"{PLANE}_excerpt.tlog", blind, without=frozenset({105, 27, 116, 26}))
    with pytest.raises(ReplayError, match="no IMU"):
        replay_log(blind)
    with pytest.raises(FileNotFoundError):
        replay_log(tmp_path / "missing.tlog")
