"""Hot-path decoding beside pymavlink, on packets of a recorded flight: bytes in, typed values out.

    python benchmarks/decode_speed.py [FILE.tlog]

Both get one packet per call, as a UDP link gives them, and both check the checksum and the sequence. Ours decodes into
typed values; pymavlink's parse_buffer into its message objects. Each pass alternates between the two, and processor
time is what counts, so that other work on the machine does not decide.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from statistics import median

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Decoder, Frame, checksum, decode
from gcs.mavlink.dialect import CRC_EXTRA, LAYOUTS
from gcs.mavlink.tlog import TlogReader
from gcs.telemetry import Telemetry

PASSES = 7
PACKETS = 20_000
REACH = 5.0
EXCERPT = Path(__file__).parents[1] / "tests" / "data" / "arducopter_guided_excerpt.tlog"


def hot_packets(path: Path) -> list[bytes]:
    """Packets of messages on the hot path as they stand in the log, numbered as if nothing had been between them."""
    packets: list[bytes] = []
    sequences: Counter[int] = Counter()
    decoder = Decoder()
    for _, raw in TlogReader(path):
        for frame in decoder.feed(raw):
            if frame.message_id in LAYOUTS and frame.version == 2 and len(packets) < PACKETS:
                covered = raw[1:4] + bytes((sequences[frame.source] & 0xFF,)) + raw[5:-2]
                crc = checksum(covered + CRC_EXTRA[frame.message_id])
                packets.append(raw[:1] + covered + crc.to_bytes(2, "little"))
                sequences[frame.source] += 1
    return packets


def ours(packets: list[bytes]) -> int:
    """Frames and typed values."""
    decoder, decoded = Decoder(), 0
    for packet in packets:
        for frame in decoder.feed(packet):
            decoded += decode(frame) is not None
    return decoded


def ours_stream(packets: list[bytes]) -> int:
    """The same from a byte stream in blocks, as a serial or TCP link gives it."""
    decoder, decoded, stream = Decoder(), 0, b"".join(packets)
    for start in range(0, len(stream), 1024):
        for frame in decoder.feed(stream[start : start + 1024]):
            decoded += decode(frame) is not None
    return decoded


def ours_folded(packets: list[bytes]) -> int:
    """Frames, typed values and samples in SI: the whole way to the estimator."""
    decoder, telemetry = Decoder(), Telemetry()
    frames: list[Frame]
    for packet in packets:
        frames = decoder.feed(packet)
        for frame in frames:
            telemetry.fold(frame, 0.0)
    return telemetry.messages_total


def theirs(packets: list[bytes]) -> int:
    """pymavlink's message objects."""
    parser, decoded = dialect.MAVLink(None), 0
    for packet in packets:
        decoded += len(parser.parse_buffer(packet) or ())
    return decoded


def microseconds(work: Callable[[list[bytes]], int], packets: list[bytes]) -> float:
    """Processor time per packet [us] of one pass."""
    begin = time.process_time()
    decoded = work(packets)
    elapsed = time.process_time() - begin
    if decoded != len(packets):
        raise RuntimeError(f"{work.__name__} decoded {decoded} of {len(packets)} packets")
    return elapsed / len(packets) * 1e6


def main() -> None:
    """Print microseconds per packet, ours and pymavlink's, and the ratio."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else EXCERPT
    packets = hot_packets(path)
    contestants = {
        "rotorlab, one packet per call": ours,
        "rotorlab, byte stream": ours_stream,
        "rotorlab, folded into samples": ours_folded,
        "pymavlink parse_buffer": theirs,
    }
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(PASSES):
        for name, work in contestants.items():
            times[name].append(microseconds(work, packets))
    print(f"{path.name}: {len(packets)} hot-path packets, median and best of {PASSES} passes, us per packet")
    peer = times["pymavlink parse_buffer"]
    for name, values in times.items():
        ratio = median(peer) / median(values)
        print(f"  {name:32s} {median(values):6.2f} {min(values):6.2f}   {ratio:5.1f} x pymavlink")
    ratio = median(peer) / median(times["rotorlab, one packet per call"])
    print(f"  reach {REACH:.0f} x: {'reached' if ratio >= REACH else 'NOT reached'} ({ratio:.1f} x)")


if __name__ == "__main__":
    main()
