"""Whatever the bytes: nothing raised, nothing lost that is whole, every byte accounted for."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Decoder, Frame, decode, without_signature
from gcs.mavlink.encoder import Encoder
from gcs.mavlink.messages import Attitude, GpsRawInt, Message

FLOAT = st.floats(width=32, allow_nan=False)
ATTITUDES = st.builds(Attitude, st.integers(0, 2**32 - 1), FLOAT, FLOAT, FLOAT, FLOAT, FLOAT, FLOAT)


@st.composite
def streams(draw: st.DrawFn) -> tuple[bytes, list[Attitude], list[bytes]]:
    """Packets of a vehicle, version 1, 2 and signed in any mix: the stream, attitude stamps, single packets."""
    mav = dialect.MAVLink(None, srcSystem=draw(st.integers(1, 255)), srcComponent=1)
    mav.signing.secret_key = bytes(32)
    packets, stamps = [], []
    for attitude in draw(st.lists(ATTITUDES, min_size=1, max_size=8)):
        kind = draw(st.sampled_from(("v1", "v2", "signed")))
        mav.signing.sign_outgoing = kind == "signed"
        packets.append(
            bytes(mav.attitude_encode(*msgspec.structs.astuple(attitude)).pack(mav, force_mavlink1=kind == "v1"))
        )
        stamps.append(attitude)
        mav.seq = (mav.seq + 1) & 0xFF
    return b"".join(packets), stamps, packets


@given(streams(), st.lists(st.integers(0, 2000), max_size=12))
def test_any_chunking_gives_the_same_frames(stream: tuple[bytes, list[Attitude], list[bytes]], cuts: list[int]) -> None:
    data, attitudes, packets = stream
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    decoder = Decoder()
    frames = [frame for start, end in pairwise(edges) for frame in decoder.feed(data[start:end])]
    assert [frame.raw for frame in frames] == packets
    assert [decode(frame) for frame in frames] == attitudes
    assert (decoder.bad_bytes, decoder.bad_crc) == (0, 0)
    (source,) = decoder.sources.values()
    assert (source.received, source.lost, source.late) == (len(packets), 0, 0)


@given(st.binary(max_size=600), st.lists(st.integers(0, 600), max_size=5))
def test_noise_never_raises_and_every_byte_is_accounted_for(noise: bytes, cuts: list[int]) -> None:
    edges = sorted({0, len(noise), *(min(cut, len(noise)) for cut in cuts)})
    decoder = Decoder()
    frames = [frame for start, end in pairwise(edges) for frame in decoder.feed(noise[start:end])]
    decoder.flush()
    assert sum(len(frame.raw) for frame in frames) + decoder.bad_bytes == len(noise)


@given(streams(), st.data())
def test_one_damaged_byte_costs_at_most_its_own_packet(
    stream: tuple[bytes, list[Attitude], list[bytes]], data: st.DataObject
) -> None:
    whole, _, packets = stream
    at = data.draw(st.integers(0, len(whole) - 1))
    flip = data.draw(st.integers(1, 255))
    damaged = whole[:at] + bytes((whole[at] ^ flip,)) + whole[at + 1 :]
    decoder = Decoder()
    # Packets of a second sender behind the damage let a header that promises too much come to its end.
    tail = Encoder(9, 9)
    raws = [frame.raw for frame in decoder.feed(damaged + b"".join(tail.heartbeat() for _ in range(20)))]
    begin = 0
    for packet in packets:
        untouched = not begin <= at < begin + len(packet)
        if untouched:
            assert packet in raws
        begin += len(packet)


@given(streams(), st.binary(max_size=60))
def test_frames_are_found_behind_noise(stream: tuple[bytes, list[Attitude], list[bytes]], noise: bytes) -> None:
    data, _, packets = stream
    decoder = Decoder()
    raws = [frame.raw for frame in decoder.feed(noise + data + bytes(300))]
    # Noise may end in what looks like the header of a packet of a message we do not know; it then takes what it
    # promises. Without such a header, every packet is there.
    if decoder.unknown == 0:
        assert raws[-len(packets) :] == packets


@given(
    st.tuples(*[st.floats(-1.0, 1.0, width=32)] * 4),
    st.tuples(*[FLOAT] * 3),
    st.floats(0.0, 1.0, width=32),
    st.floats(0.0, 1e6),
    st.integers(0, 255),
)
def test_setpoint_packets_round_trip_through_pymavlink(
    quaternion: tuple[float, float, float, float],
    rates: tuple[float, float, float],
    thrust: float,
    time_s: float,
    mask: int,
) -> None:
    packet = Encoder().set_attitude_target((1, 1), time_s, mask, quaternion, rates, thrust)
    (message,) = dialect.MAVLink(None).parse_buffer(packet)
    assert tuple(message.q) == quaternion
    assert (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate) == rates
    assert (message.thrust, message.type_mask) == (thrust, mask)
    assert math.isclose(message.time_boot_ms, time_s * 1e3, abs_tol=0.51)


@given(streams())
@settings(max_examples=50)
def test_stripping_signatures_leaves_valid_unsigned_packets(
    stream: tuple[bytes, list[Attitude], list[bytes]],
) -> None:
    _, attitudes, packets = stream
    frames = Decoder().feed(b"".join(map(without_signature, packets)))
    assert [decode(frame) for frame in frames] == attitudes
    assert not any(frame.signed for frame in frames)


@given(st.binary(min_size=0, max_size=52))
def test_any_payload_of_a_hot_message_decodes(payload: bytes) -> None:
    message: Message | None = decode(Frame(24, 0, 0x0101, payload, b""))
    assert isinstance(message, GpsRawInt)
