"""Real traffic of a real autopilot: the excerpts that come with the tests, and the whole flights where they are."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest
from pymavlink import mavutil

from gcs.mavlink.codec import Decoder, decode
from gcs.mavlink.link import Link
from gcs.mavlink.link_events import VehicleRebooted
from gcs.mavlink.tlog import TlogReader
from gcs.telemetry import Telemetry
from models.samples import (
    AirspeedSample,
    BarometerSample,
    GnssSample,
    HeartbeatSample,
    ImuSample,
    MagnetometerSample,
    OriginSample,
)

EXCERPTS = sorted((Path(__file__).parents[1] / "data").glob("*_excerpt.tlog"))
FLIGHTS = Path(__file__).parents[2].parent / "shared" / "data"
COUNTS = {"arducopter_guided": 148_918, "ardupilot_heli_cruise": 184_948, "arduplane_wind": 194_812}


def pymavlink_counts(path: Path) -> Counter[str]:
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    counts = Counter(message.get_type() for message in iter(log.recv_msg, None))
    log.close()
    return counts


def fold_all(path: Path) -> tuple[Decoder, Telemetry, Counter[str]]:
    """Everything in the file through codec and fold, whoever sent it."""
    decoder, telemetry = Decoder(), Telemetry()
    for utc_us, raw in TlogReader(path):
        for frame in decoder.feed(raw):
            telemetry.fold(frame, utc_us * 1e-6)
    names: Counter[str] = Counter()
    for counter in (telemetry.folded, telemetry.repeated, telemetry.unused, telemetry.bad):
        names.update(counter)
    return decoder, telemetry, names


def replay(path: Path) -> tuple[Link, list[Any]]:
    """One log through a link, with the log's stamps as the ground's clock."""
    link = Link()
    samples: list[Any] = []
    for utc_us, raw in TlogReader(path):
        samples += link.receive(raw, utc_us * 1e-6)
    return link, samples


def of(samples: list[Any], kind: type) -> list[Any]:
    return [sample for sample in samples if isinstance(sample, kind)]


def test_there_is_an_excerpt_of_each_flight() -> None:
    assert [path.name for path in EXCERPTS] == [f"{name}_excerpt.tlog" for name in sorted(COUNTS)]
    assert all(path.stat().st_size <= 1_000_000 for path in EXCERPTS)


@pytest.mark.parametrize("path", EXCERPTS, ids=lambda path: path.stem)
def test_every_message_of_an_excerpt_is_accounted_for_as_pymavlink_counts(path: Path) -> None:
    decoder, telemetry, names = fold_all(path)
    assert names == pymavlink_counts(path)
    assert (decoder.bad_bytes, decoder.bad_crc, telemetry.bad.total()) == (0, 0, 0)


@pytest.mark.parametrize("path", EXCERPTS, ids=lambda path: path.stem)
def test_values_of_an_excerpt_are_those_of_pymavlink(path: Path) -> None:
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    compared = 0
    for number, (_, raw) in enumerate(TlogReader(path)):
        theirs = log.recv_msg()
        if number % 7:
            continue
        (frame,) = Decoder().feed(raw)
        ours = decode(frame)
        if ours is None:
            continue
        compared += 1
        for name, value in msgspec.structs.asdict(ours).items():
            expected = getattr(theirs, name)
            if isinstance(value, bytes):
                assert value.rstrip(b"\0").decode() == expected
            elif isinstance(value, tuple):
                assert list(value) == pytest.approx(list(expected), nan_ok=True)
            else:
                assert value == expected or (math.isnan(value) and math.isnan(expected))
    log.close()
    assert compared > 1500


@pytest.mark.parametrize("path", EXCERPTS, ids=lambda path: path.stem)
def test_samples_of_an_excerpt_are_physical_and_in_time(path: Path) -> None:
    link, samples = replay(path)
    imu = of(samples, ImuSample)
    assert len(imu) > 7000
    assert not any(isinstance(event, VehicleRebooted) for event in link.take_events())
    steps = [later.time_s - sooner.time_s for sooner, later in itertools.pairwise(imu)]
    assert sorted(steps)[len(steps) // 2] == pytest.approx(0.01, abs=1e-4)
    delays = sorted(sample.arrival_s - sample.time_s for sample in imu)
    assert delays[0] >= -1e-9
    assert delays[len(delays) // 2] < 0.02
    fields = [math.hypot(*sample.field_body_t) for sample in of(samples, MagnetometerSample)]
    assert all(50e-6 < field < 65e-6 for field in fields)
    assert 5.0 < len(fields) / (imu[-1].time_s - imu[0].time_s) < 11.0
    assert all(90e3 < sample.pressure_pa < 95e3 for sample in of(samples, BarometerSample))
    fixes = of(samples, GnssSample)
    assert len(fixes) > 300
    assert len({fix.time_s for fix in fixes}) == len(fixes)
    assert all(math.dist((fix.latitude_rad, fix.longitude_rad), (-0.6172053, 2.6034244)) < 3e-4 for fix in fixes)
    (origin, *_) = of(samples, OriginSample)
    assert origin.height_m == pytest.approx(584.09)
    beats = of(samples, HeartbeatSample)
    assert {beat.armed for beat in beats} == {True, False}
    assert (len(of(samples, AirspeedSample)) > 500) == ("plane" in path.stem)


@pytest.mark.parametrize(("name", "count"), COUNTS.items())
def test_whole_flights_are_counted_exactly(name: str, count: int) -> None:
    path = FLIGHTS / f"{name}.tlog"
    if not path.exists():
        pytest.skip(f"the recorded flight {path.name} is not on this machine")
    decoder, telemetry, _ = fold_all(path)
    assert telemetry.messages_total == count
    assert (decoder.bad_bytes, decoder.bad_crc, decoder.unknown, telemetry.bad.total()) == (0, 0, 0, 0)
    assert [source.lost for source in decoder.sources.values()] == [0, 0]


@pytest.mark.slow
def test_whole_flight_message_by_message_as_pymavlink_counts() -> None:
    path = FLIGHTS / "arduplane_wind.tlog"
    if not path.exists():
        pytest.skip(f"the recorded flight {path.name} is not on this machine")
    assert fold_all(path)[2] == pymavlink_counts(path)


def test_damage_to_a_real_log_costs_only_what_was_damaged(tmp_path: Path) -> None:
    whole = EXCERPTS[0].read_bytes()
    total = sum(1 for _ in TlogReader(EXCERPTS[0]))
    damaged = tmp_path / "damaged.tlog"
    holes = range(50_000, len(whole), 100_000)
    data = bytearray(whole)
    for at in reversed(holes):
        del data[at : at + 37]
    damaged.write_bytes(bytes(data))
    reader = TlogReader(damaged)
    decoder = Decoder()
    frames = sum(len(decoder.feed(raw)) for _, raw in reader)
    assert reader.damaged == len(holes)
    assert total - 3 * len(holes) <= frames < total
