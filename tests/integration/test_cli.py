"""The command line as a user meets it: real processes, exit status and words."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from gcs.commands import Answer, ApplyGains, FlyTrajectory, Hold, TakeControls
from gcs.offboard.trajectories import Circle
from tests.station_rig import ROOT, ImitatedFlight, running, runtime_folder, status, tick_frame


def gcs(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "COLUMNS": "80", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "gcs.cli", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, env=environment)


@pytest.mark.parametrize("command", ["", "up", "sim", "replay", "login", "status", "command"])
def test_help_fits_a_screen(command: str) -> None:
    done = gcs(*command.split(), "--help")
    assert done.returncode == 0
    lines = done.stdout.rstrip().splitlines()
    assert 5 <= len(lines) <= 24
    assert max(map(len, lines)) <= 80


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys, gcs.cli\n"
        "print([name for name in ('numpy', 'numba', 'zenoh', 'mavsdk', 'pymavlink', 'fastapi') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]"


WRONG = {
    "nothing to fly": (("up",), "nothing to fly: give --sim quadrotor, or --vehicle FILE"),
    "unknown simulation": (("up", "--sim", "zeppelin"), "there are quadrotor"),
    "no such file": (("up", "--vehicle", "none.toml"), "none.toml: No such file"),
    "bad link": (("up", "--sim", "quadrotor", "--link", "udp://1"), "Valid forms: udpin://"),
    "link for a simulation": (("up", "--sim", "quadrotor", "--link", "serial:///dev/ttyX:9600"), "udpin://[host:]port"),
    "speed": (("up", "--sim", "quadrotor", "--speed", "0"), "--speed"),
    "wind": (("up", "--sim", "quadrotor", "--wind", "1,2"), "--wind 1,2: give three numbers, north,east,down in m/s"),
    "position": (("up", "--sim", "quadrotor", "--position", "sonar"), "gnss"),
    "unknown command": (("command", "hover"), "no such command; there are apply_gains, arm"),
    "unknown field": (("command", "take_off", "heigth=3"), "unknown field `heigth`; its fields: height_m"),
    "out of range": (("command", "take_off", "height_m=300"), "height_m: Expected `float` <= 100.0"),
    "not key=value": (("command", "take_off", "3"), "not KEY=VALUE"),
    "no log": (("replay", "none.tlog"), "none.tlog: No such file"),
    "not a run": (("replay", "docs"), "docs: no flight.tlog in it; give a .tlog file or the folder of a run"),
    "not a log": (("replay", "README.md"), "is this a .tlog of a flight?"),
    "simulation option": (("sim", "--speed", "fast"), "'fast' is not a number"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_named_and_exit_with_2(case: str, tmp_path: Path) -> None:
    arguments, words = WRONG[case]
    with runtime_folder() as runtime:
        if arguments[0] == "up":
            arguments = (*arguments, "--runtime", str(runtime.folder), "--runs", str(tmp_path))
        done = gcs(*arguments)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_recordings_that_cannot_be_made_are_refused_before_anything_starts(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with runtime_folder() as runtime:
        done = gcs("up", "--sim", "quadrotor", "--runtime", str(runtime.folder), "--runs", str(file / "runs"))
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{file} is not a folder" in done.stderr


@pytest.mark.parametrize("arguments", [("status",), ("command", "hold"), ("login",)])
def test_without_a_station_it_says_how_to_start_one(arguments: tuple[str, ...]) -> None:
    with runtime_folder() as runtime:
        done = gcs(*arguments, "--runtime", str(runtime.folder))
    assert done.returncode == 1
    assert "start one with gcs up" in done.stderr


def test_status_and_commands_over_the_bus() -> None:
    with runtime_folder() as runtime, running("gcs.hub", "--runtime", str(runtime.folder)):
        folder = ("--runtime", str(runtime.folder))
        flight = ImitatedFlight(runtime)
        heard = []

        def answer_all() -> None:
            for sequence in range(5):
                request = flight.next_request()
                heard.append(request)
                accepted = not isinstance(request.command, ApplyGains)
                flight.answer_with(
                    sequence, Answer(request.number, accepted, "" if accepted else "roll.k = 9: at most 5")
                )

        flight.send(status(armed=True, state="Active"))
        flight.send(tick_frame(0))
        answering = threading.Thread(target=answer_all)
        answering.start()
        hold = gcs("command", "hold", *folder)
        circle = gcs("command", "fly_trajectory", 'trajectory={"kind": "circle", "radius_m": 2}', "--json", *folder)
        gains = gcs("command", "apply_gains", 'changes={"roll.k": 9}', "why=test", "--take", *folder)
        after = gcs("command", "hold", *folder)
        answering.join(10)
        shown = gcs("status", *folder)
        machine = json.loads(gcs("status", "--json", *folder).stdout)
        flight.close()
    assert (hold.returncode, hold.stdout) == (0, "hold: accepted.\n")
    assert json.loads(circle.stdout)["accepted"] is True
    assert (gains.returncode, gains.stdout) == (1, "apply_gains: refused. roll.k = 9: at most 5\n")
    assert after.returncode == 0
    commands = [request.command for request in heard]
    assert commands[:3] == [Hold(), FlyTrajectory(Circle(radius_m=2.0)), TakeControls()]
    assert isinstance(commands[3], ApplyGains)
    assert all(request.identity.client == "cli" and request.identity.role == "operator" for request in heard)
    assert "test quad" in shown.stdout and "armed" in shown.stdout
    assert machine["status"]["armed"] is True and machine["recording"]["state"] == "off"


def test_replay_prints_json_for_a_machine() -> None:
    excerpts = sorted((ROOT / "tests" / "data").glob("*.tlog"))
    if not excerpts:
        pytest.skip("no excerpt of a recorded flight in tests/data")
    done = gcs("replay", str(excerpts[0]), "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["messages_total"] > 1000
    assert {"roll_rms_deg", "autopilot_roll_rms_deg", "position_rms_m", "messages_bad"} <= set(report)
    shown = gcs("replay", str(excerpts[0]))
    assert "roll rms, deg" in shown.stdout and "messages" in shown.stdout
