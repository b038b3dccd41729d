"""The codec against pymavlink, both ways, and against damage."""

from __future__ import annotations

import math
import random
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Decoder, checksum, checksum_holds, decode, decode_any, parse_frame, without_signature
from gcs.mavlink.dialect import LAYOUTS, MESSAGE_IDS, MESSAGE_NAMES, message_name
from gcs.mavlink.encoder import Encoder
from gcs.mavlink.messages import MESSAGE_TYPES, Attitude

_INTEGER_BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}


def peer(system: int = 1, component: int = 1) -> Any:
    return dialect.MAVLink(None, srcSystem=system, srcComponent=component)


def random_value(kind: str, length: int, chance: random.Random) -> Any:
    if kind == "char":
        return "".join(chance.choice("abc XYZ.09") for _ in range(length)).encode()
    if kind in ("float", "double"):
        return float(round(chance.uniform(-1e3, 1e3) * 64)) / 64.0
    if kind.startswith("uint"):
        return chance.getrandbits(int(kind[4:-2]))
    bits = _INTEGER_BITS[kind]
    return chance.getrandbits(bits) - (1 << bits - 1)


def random_message(message_id: int, chance: random.Random) -> Any:
    """A pymavlink message with every field at random."""
    cls = dialect.mavlink_map[message_id]
    arguments = []
    for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
        at = cls.ordered_fieldnames.index(name)
        length, array_length = cls.lengths[at], cls.array_lengths[at]
        if length > 1:
            arguments.append([random_value(kind, 1, chance) for _ in range(length)])
        else:
            arguments.append(random_value(kind, array_length or 1, chance))
    return cls(*arguments)


def plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, str):
        return value.encode().rstrip(b"\0")
    return value.rstrip(b"\0") if isinstance(value, bytes) else value


@pytest.mark.parametrize("message_id", sorted(MESSAGE_TYPES), ids=message_name)
def test_hot_message_decodes_as_pymavlink_says(message_id: int) -> None:
    chance = random.Random(message_id)
    for version1 in (False, True):
        if version1 and message_id > 255:
            continue
        mav = peer()
        sent = random_message(message_id, chance)
        raw = bytes(sent.pack(mav, force_mavlink1=version1))
        (frame,) = Decoder().feed(raw)
        assert (frame.message_id, frame.system, frame.component) == (message_id, 1, 1)
        assert frame.version == (1 if version1 else 2)
        assert frame.raw == raw
        ours = decode(frame)
        assert ours is not None
        (theirs,) = dialect.MAVLink(None).parse_buffer(raw)
        for name in ours.__struct_fields__:
            assert plain(getattr(ours, name)) == plain(getattr(theirs, name)), name


def test_every_other_message_comes_through_pymavlink() -> None:
    chance = random.Random(7)
    mav = peer()
    for message_id in dialect.mavlink_map:
        raw = bytes(random_message(message_id, chance).pack(mav))
        (frame,) = Decoder().feed(raw)
        message = decode_any(frame)
        assert message is not None
        assert message.get_msgId() == message_id
        assert (decode(frame) is None) == (message_id not in LAYOUTS)


def test_truncated_payload_is_filled_with_zeros_and_longer_one_is_cut() -> None:
    zeros = peer().heartbeat_encode(0, 0, 0, 0, 0, 0)
    raw = bytes(zeros.pack(peer()))
    (frame,) = Decoder().feed(raw)
    assert len(frame.payload) == 1
    assert decode(frame) == MESSAGE_TYPES[0](0, 0, 0, 0, 0, 0)  # type: ignore[call-arg, arg-type]
    longer = bytes((0xFD, 13, 0, 0, 5, 1, 1, 0, 0, 0)) + bytes(range(1, 14))
    extra = dialect.mavlink_map[0].crc_extra
    raw = longer + checksum(longer[1:] + bytes((extra,))).to_bytes(2, "little")
    (frame,) = Decoder().feed(raw)
    message = decode(frame)
    assert message is not None
    assert msgspec.structs.astuple(message)[1:] == (5, 6, 7, 8, 9)


def test_checksum_of_the_standard_test_word() -> None:
    assert checksum(b"123456789") == 0x6F91  # CRC-16/MCRF4XX check value


def test_signed_frame_is_carried_whole_and_can_be_stripped() -> None:
    mav = peer()
    mav.signing.secret_key = bytes(range(32))
    mav.signing.sign_outgoing = True
    mav.signing.link_id = 3
    raw = bytes(mav.attitude_encode(1000, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6).pack(mav))
    (frame,) = Decoder().feed(raw)
    assert frame.signed
    assert frame.raw == raw
    message = decode(frame)
    assert message is not None
    assert isinstance(message, Attitude)
    assert message.time_boot_ms == 1000
    stripped = without_signature(raw)
    (theirs,) = dialect.MAVLink(None).parse_buffer(stripped)
    assert theirs.get_type() == "ATTITUDE"
    assert theirs.yawspeed == pytest.approx(0.6)
    assert len(stripped) == len(raw) - 13
    assert without_signature(stripped) == stripped
    broken = bytearray(raw)
    broken[12] ^= 0x40
    assert not checksum_holds(parse_frame(without_signature(bytes(broken))))


def test_signed_unknown_message_is_stripped_with_a_right_checksum() -> None:
    header, payload, extra = bytes((9, 1, 0, 4, 7, 8, 0x10, 0x27, 0x99)), b"ninebytes", b"\x55"
    crc = checksum(header + payload + extra).to_bytes(2, "little")
    stripped = without_signature(b"\xfd" + header + payload + crc + bytes(13))
    assert stripped[2] == 0
    assert int.from_bytes(stripped[-2:], "little") == checksum(stripped[1:-2] + extra)


def test_damage_is_counted_and_the_next_frame_found() -> None:
    mav = peer()
    good = []
    for second in range(3):
        good.append(bytes(mav.attitude_encode(second, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6).pack(mav)))
        mav.seq += 1
    broken = bytearray(good[1])
    broken[20] ^= 0xFF
    decoder = Decoder()
    frames = decoder.feed(b"\x00\x11noise" + good[0] + bytes(broken) + good[2])
    assert [frame.raw for frame in frames] == [good[0], good[2]]
    assert decoder.bad_crc == 1
    assert decoder.bad_bytes == 7 + len(broken)
    assert decoder.sources[1, 1].received == 2
    assert decoder.sources[1, 1].lost == 1


def test_frame_with_unknown_incompatibility_flags_is_refused() -> None:
    raw = bytearray(peer().heartbeat_encode(2, 12, 0, 0, 3, 3).pack(peer()))
    raw[2] = 0x02
    decoder = Decoder()
    assert decoder.feed(bytes(raw)) == []
    assert decoder.bad_bytes > 0
    assert decoder.bad_crc == 0


def test_unknown_message_is_handed_out_and_counted() -> None:
    unknown_id = 30000
    assert unknown_id not in MESSAGE_NAMES
    raw = bytes((0xFD, 3, 0, 0, 9, 1, 1)) + unknown_id.to_bytes(3, "little") + b"abc" + b"\x12\x34"
    good = bytes(peer().heartbeat_encode(2, 12, 0, 0, 3, 3).pack(peer()))
    decoder = Decoder()
    frames = decoder.feed(raw + good)
    assert [frame.message_id for frame in frames] == [unknown_id, 0]
    assert decoder.unknown == 1
    assert decode(frames[0]) is None
    assert decode_any(frames[0]) is None
    assert message_name(unknown_id) == "UNKNOWN_30000"


@pytest.mark.parametrize(
    ("sequences", "lost", "late"),
    [
        ((0, 1, 2, 3), 0, 0),
        ((254, 255, 0, 1), 0, 0),
        ((0, 1, 5, 6), 3, 0),
        ((250, 4, 5), 9, 0),
        ((0, 1, 1, 2), 0, 1),
        ((0, 2, 1, 3), 1, 1),
    ],
)
def test_sequence_loss_per_source(sequences: tuple[int, ...], lost: int, late: int) -> None:
    decoder = Decoder()
    for component in (1, 2):
        mav = peer(component=component)
        for sequence in sequences:
            mav.seq = sequence
            decoder.feed(bytes(mav.heartbeat_encode(2, 12, 0, 0, 3, 3).pack(mav)))
    for component in (1, 2):
        source = decoder.sources[1, component]
        assert (source.received, source.lost, source.late) == (len(sequences), lost, late)


def test_encoder_is_understood_by_pymavlink() -> None:
    encoder = Encoder(255, 191)
    target = (1, 1)
    packets = {
        "HEARTBEAT": encoder.heartbeat(),
        "TIMESYNC": encoder.timesync(0, 123456789012),
        "COMMAND_LONG": encoder.command_long(target, 400, (1.0, 21196.0)),
        "COMMAND_INT": encoder.command_int(target, 192, (-1.0, 1.0, 0.0, math.nan), (473977420, -85455940, 12.5), 6),
        "SET_ATTITUDE_TARGET": encoder.set_attitude_target(
            target, 12.345, 7, (0.5, -0.5, 0.5, -0.5), (0.1, 0.2, 0.3), 0.4
        ),
        "SET_POSITION_TARGET_LOCAL_NED": encoder.set_position_target_local_ned(
            target, 1.5, 2048, (1.0, 2.0, -3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0), 0.25
        ),
        "SET_ACTUATOR_CONTROL_TARGET": encoder.set_actuator_control_target(target, 2.5, (-1.0, 0.5, 0.25, 0.75)),
    }
    parser = dialect.MAVLink(None)
    messages = {}
    for sequence, (name, packet) in enumerate(packets.items()):
        (message,) = parser.parse_buffer(packet)
        assert message.get_type() == name
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (255, 191, sequence)
        assert bytes(message.pack(_numbered(sequence))) == packet, "pymavlink packs the same bytes"
        messages[name] = message
    assert (messages["HEARTBEAT"].type, messages["HEARTBEAT"].autopilot) == (6, 8)
    assert messages["TIMESYNC"].ts1 == 123456789012
    command = messages["COMMAND_LONG"]
    assert (command.command, command.param1, command.param2, command.param7) == (400, 1.0, 21196.0, 0.0)
    assert (command.target_system, command.target_component) == target
    reposition = messages["COMMAND_INT"]
    assert (reposition.x, reposition.y, reposition.z, reposition.frame) == (473977420, -85455940, 12.5, 6)
    assert math.isnan(reposition.param4)
    attitude = messages["SET_ATTITUDE_TARGET"]
    assert (attitude.time_boot_ms, attitude.type_mask, list(attitude.q)) == (12345, 7, [0.5, -0.5, 0.5, -0.5])
    assert attitude.thrust == pytest.approx(0.4)
    assert attitude.body_yaw_rate == pytest.approx(0.3)
    position = messages["SET_POSITION_TARGET_LOCAL_NED"]
    assert (position.x, position.vy, position.afz, position.yaw) == (1.0, 5.0, 9.0, 0.25)
    assert (position.type_mask, position.coordinate_frame) == (2048, 1)
    actuator = messages["SET_ACTUATOR_CONTROL_TARGET"]
    assert list(actuator.controls) == [-1.0, 0.5, 0.25, 0.75, 0.0, 0.0, 0.0, 0.0]
    assert (actuator.group_mlx, actuator.time_usec) == (0, 2_500_000)


def _numbered(sequence: int) -> Any:
    mav = peer(255, 191)
    mav.seq = sequence
    return mav


def test_encoder_packs_any_message_and_numbers_on() -> None:
    encoder = Encoder(250, 7)
    parser = dialect.MAVLink(None)
    (first,) = parser.parse_buffer(encoder.heartbeat())
    request = dialect.MAVLink_param_request_list_message(1, 1)
    (second,) = parser.parse_buffer(encoder.any_message(request))
    assert (first.get_seq(), second.get_seq()) == (0, 1)
    assert (second.get_type(), second.get_srcSystem(), second.get_srcComponent()) == ("PARAM_REQUEST_LIST", 250, 7)


def test_names_and_numbers_agree() -> None:
    assert MESSAGE_IDS["HIGHRES_IMU"] == 105
    assert message_name(105) == "HIGHRES_IMU"
