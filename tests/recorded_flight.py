"""Reads a run back as evidence: re-ticks its inputs, compares every hash, looks at the torque where gains changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs.offboard.configure import read_offboard_config
from gcs.offboard.tick import initial, tick
from gcs.recording_inputs import read_inputs
from gcs.signals import SLICES
from models.arrays import Array


def reticked(run: Path, vehicle: Path) -> Array:
    """Signal frames (ticks, size) of a recorded run, ticked anew; fails where one differs by a bit."""
    config = read_offboard_config(vehicle)
    state = initial(config, 0.0)
    frames: list[Array] = []
    for record in read_inputs(run / "inputs.mpk"):
        assert record.sequence == len(frames) + 1, f"tick {len(frames) + 1} was not recorded"
        state, output = tick(state, record.inputs, record.t_s, config=config)
        assert output.hash == record.output_hash, f"tick {record.sequence} at {record.t_s:.2f} s differs"
        frames.append(output.signals)
    return np.array(frames)


def assert_no_torque_jump(frames: Array, changes: int) -> None:
    """At each of ``changes`` or more changes of gain set in flight the torque moves no more than elsewhere."""
    torque = frames[:, SLICES["control.torque_body"]]
    number = frames[:, SLICES["control.gain_set"]][:, 0]
    steps = np.abs(np.diff(torque, axis=0)).max(axis=1)
    flying = np.isfinite(steps)
    at_change = np.flatnonzero((np.diff(number) != 0) & flying)
    assert len(at_change) >= changes
    ordinary = float(np.quantile(steps[flying], 0.99))
    worst = float(steps[at_change].max())
    assert worst <= ordinary, f"torque jumps {worst:.4f} N m at a change, {ordinary:.4f} N m elsewhere (99 %)"
