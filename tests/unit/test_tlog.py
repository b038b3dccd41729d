"""Logs: written as any ground station reads them, and read even when damaged or cut."""

from __future__ import annotations

import struct
from pathlib import Path

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Decoder
from gcs.mavlink.encoder import Encoder
from gcs.mavlink.tlog import TlogReader, TlogWriter

START_US = 1_790_000_000_000_000


def packets(count: int) -> list[bytes]:
    encoder = Encoder(1, 1)
    return [encoder.timesync(0, (1 << 62) + number) for number in range(count)]


def write(path: Path, raws: list[bytes]) -> bytes:
    with path.open("wb") as stream:
        writer = TlogWriter(stream)
        for number, raw in enumerate(raws):
            writer.append(START_US + 1000 * number, raw)
        writer.flush()
        assert writer.records == len(raws)
    return path.read_bytes()


def test_what_is_written_is_read_here_and_by_pymavlink(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    raws = packets(50)
    write(path, raws)
    assert list(TlogReader(path)) == [(START_US + 1000 * number, raw) for number, raw in enumerate(raws)]
    log = mavutil.mavlink_connection(str(path))
    read = list(iter(log.recv_msg, None))
    assert [bytes(message.get_msgbuf()) for message in read] == raws
    assert abs(read[3]._timestamp - (START_US + 3000) * 1e-6) < 1e-5
    log.close()


def test_signatures_are_stripped(tmp_path: Path) -> None:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(32)
    mav.signing.sign_outgoing = True
    signed = bytes(mav.heartbeat_encode(2, 12, 81, 0, 3, 3).pack(mav))
    path = tmp_path / "signed.tlog"
    write(path, [signed])
    ((_, raw),) = TlogReader(path)
    (frame,) = Decoder().feed(raw)
    assert not frame.signed
    assert len(raw) == len(signed) - 13


def test_empty_and_tiny_files(tmp_path: Path) -> None:
    path = tmp_path / "empty.tlog"
    path.write_bytes(b"")
    assert list(TlogReader(path)) == []
    path.write_bytes(b"\x00\x01\x02")
    reader = TlogReader(path)
    assert list(reader) == []
    assert reader.bad_bytes == 3


def test_every_cut_gives_all_whole_records(tmp_path: Path) -> None:
    path = tmp_path / "cut.tlog"
    raws = packets(4)
    whole = write(path, raws)
    ends = []
    size = 0
    for raw in raws:
        size += 8 + len(raw)
        ends.append(size)
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        reader = TlogReader(path)
        found = [raw for _, raw in reader]
        assert found == raws[: sum(end <= length for end in ends)], length
        assert sum(8 + len(raw) for raw in found) + reader.bad_bytes == length


def test_resynchronises_after_lost_and_inserted_bytes(tmp_path: Path) -> None:
    path = tmp_path / "damaged.tlog"
    raws = packets(30)
    whole = write(path, raws)
    record = 8 + len(raws[0])
    assert len({len(raw) for raw in raws}) == 1
    path.write_bytes(
        whole[: 10 * record + 5] + whole[10 * record + 12 : 20 * record] + b"\xfd\x09junk" + whole[20 * record :]
    )
    reader = TlogReader(path)
    found = [raw for _, raw in reader]
    assert found == raws[:10] + raws[11:]
    assert reader.damaged == 2
    assert sum(8 + len(raw) for raw in found) + reader.bad_bytes == path.stat().st_size


def test_packet_with_a_bad_checksum_in_its_place_is_left_to_the_decoder(tmp_path: Path) -> None:
    path = tmp_path / "bad.tlog"
    raws = packets(5)
    raws[2] = raws[2][:12] + bytes((raws[2][12] ^ 0x55,)) + raws[2][13:]
    write(path, raws)
    reader = TlogReader(path)
    decoder = Decoder()
    frames = [frame for _, raw in reader for frame in decoder.feed(raw)]
    assert (reader.records, reader.damaged, len(frames), decoder.bad_crc) == (5, 0, 4, 1)


def test_damaged_length_byte_costs_one_record(tmp_path: Path) -> None:
    path = tmp_path / "length.tlog"
    raws = packets(6)
    whole = bytearray(write(path, raws))
    record = 8 + len(raws[0])
    whole[2 * record + 8 + 1] = 200
    path.write_bytes(bytes(whole))
    reader = TlogReader(path)
    assert [raw for _, raw in reader] == raws[:2] + raws[3:]
    assert reader.bad_bytes == record


def test_version_1_packets_and_long_files_across_read_blocks(tmp_path: Path) -> None:
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    raw = bytes(mav.statustext_encode(6, b"x" * 49).pack(mav, force_mavlink1=True))
    count = (1 << 20) // (8 + len(raw)) * 2 + 10
    path = tmp_path / "long.tlog"
    path.write_bytes(b"".join(struct.pack(">Q", START_US + number) + raw for number in range(count)))
    reader = TlogReader(path)
    assert [stamp for stamp, _ in reader] == [START_US + number for number in range(count)]
    assert reader.bad_bytes == 0
