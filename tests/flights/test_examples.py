"""Every example runs as a user runs it and says what it promises."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_fly_circle() -> None:
    command = [sys.executable, str(ROOT / "examples" / "fly_circle.py"), "--wind", "2,0,0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True, cwd=ROOT)
    lines = done.stdout.splitlines()
    assert lines[0].startswith("LQR with integral action")
    assert lines[1].startswith("PI/PID cascade")
    assert all(float(line.split()[-3]) < 8.0 for line in lines[:2])
    assert lines[2].startswith("landed")


def test_every_example_is_run_here() -> None:
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == {"fly_circle"}
