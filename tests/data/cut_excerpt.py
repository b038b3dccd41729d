"""Cuts the flight excerpts of this folder out of whole recorded flights: `python tests/data/cut_excerpt.py FOLDER`.

Whole packets are kept or left out, with their stamps and bytes as recorded; nothing is altered. FOLDER holds the three
flights named below.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from gcs.mavlink.codec import parse_frame
from gcs.mavlink.dialect import message_name
from gcs.mavlink.tlog import TlogReader, TlogWriter

LARGEST_BYTES = 1_000_000

# Where each excerpt begins, in seconds of the recording; it ends where the file is full.
BEGIN_S = {"arducopter_guided": 28.0, "ardupilot_heli_cruise": 50.0, "arduplane_wind": 10.0}

# One in so many packets is kept; 0 keeps none, and what is not named is kept one in KEEP_OTHERS.
KEEP = {
    "HIGHRES_IMU": 1,
    "GPS_RAW_INT": 1,
    "SCALED_PRESSURE": 1,
    "SIM_STATE": 1,
    "HEARTBEAT": 1,
    "SYS_STATUS": 1,
    "EXTENDED_SYS_STATE": 1,
    "HOME_POSITION": 1,
    "GPS_GLOBAL_ORIGIN": 1,
    "STATUSTEXT": 1,
    "COMMAND_LONG": 1,
    "COMMAND_ACK": 1,
    "TIMESYNC": 1,
    "WIND": 1,
    "LOCAL_POSITION_NED": 2,
    "ATTITUDE": 5,
    "SERVO_OUTPUT_RAW": 5,
    "ATTITUDE_QUATERNION": 0,
    "SIMSTATE": 0,
}
KEEP_OTHERS = 50
# From before the beginning: the first of these (a reader must know the vehicle to take anything from it) ...
CARRIED_FIRST = ("HEARTBEAT", "SYS_STATUS")
# ... and the last of these, so that the excerpt says where it is.
CARRIED_LAST = ("GPS_GLOBAL_ORIGIN", "HOME_POSITION")


def cut(source: Path, target: Path, begin_s: float) -> Counter[str]:
    """Write the excerpt of one flight; returns how many packets of each message it holds."""
    seen: Counter[str] = Counter()
    kept: Counter[str] = Counter()
    carried: dict[str, tuple[int, bytes]] = {}
    first_us: int | None = None
    size = 0
    with target.open("wb") as stream:
        writer = TlogWriter(stream)
        for utc_us, packet in TlogReader(source):
            first_us = utc_us if first_us is None else first_us
            frame = parse_frame(packet)
            name = message_name(frame.message_id)
            if utc_us - first_us < begin_s * 1e6:
                if frame.system == 1 and (name in CARRIED_LAST or (name in CARRIED_FIRST and name not in carried)):
                    carried[name] = (utc_us, packet)
                continue
            chosen = sorted(((early, *stamped) for early, stamped in carried.items()), key=lambda item: item[1])
            carried = {}
            one_in = KEEP.get(name, KEEP_OTHERS)
            if one_in and seen[name] % one_in == 0:
                chosen.append((name, utc_us, packet))
            seen[name] += 1
            for chosen_name, stamp_us, raw in chosen:
                if size + 8 + len(raw) > LARGEST_BYTES:
                    return kept
                writer.append(stamp_us, raw)
                size += 8 + len(raw)
                kept[chosen_name] += 1
    return kept


def main() -> None:
    """Cut all excerpts from the flights in the folder given on the command line."""
    folder = Path(sys.argv[1])
    for name, begin_s in BEGIN_S.items():
        target = Path(__file__).parent / f"{name}_excerpt.tlog"
        kept = cut(folder / f"{name}.tlog", target, begin_s)
        print(f"{target.name}: {target.stat().st_size} bytes, {kept.total()} packets, {dict(kept.most_common())}")


if __name__ == "__main__":
    main()
