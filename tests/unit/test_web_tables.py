"""What the pages are told of signals, trajectories, gains and predictions; and how errors are worded."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from controllers.gains import edited, load_gain_set, values
from gcs.commands import AnyCommand
from gcs.signals import FRAME_SIZE, SIGNALS, SLICES, empty_frame
from web.design import predict_change, predicted_jump
from web.routes import command_types, readable, struct_schemas
from web.runs import list_runs
from web.stream import signal_table
from web.tables import DesignError, DesignRequest, gains_answer, newest_set, trajectory_table


def test_signal_table_covers_the_frame_without_gap() -> None:
    rows = signal_table()
    assert [row["name"] for row in rows] == [signal.name for signal in SIGNALS]
    end = 0
    for row in rows:
        assert row["offset"] == end
        assert len(row["labels"]) == row["size"]
        end += row["size"]
    assert end == FRAME_SIZE


def test_every_trajectory_default_is_within_its_range_and_makes_a_command() -> None:
    for kind in trajectory_table():
        fields = {
            field["name"]: field["default"] if field["default"] is not None else field["minimum"]
            for field in kind["fields"]
        }
        for field in kind["fields"]:
            assert field["minimum"] <= fields[field["name"]] <= field["maximum"], (kind["kind"], field["name"])
        body = {"type": "fly_trajectory", "trajectory": {"kind": kind["kind"], **fields}}
        msgspec.convert(body, AnyCommand)
    step = next(kind for kind in trajectory_table() if kind["kind"] == "step")
    assert step["choices"]["axis"] == ["north", "east", "height", "yaw"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b'{"type": "take_off", "height_m": 900}', "height_m: Expected float <= 100.0"),
        (b'{"type": "fly"}', "type: Invalid value 'fly'; one of take_controls"),
        (b'{"type": "apply_gains", "changes": {"x": "y"}, "why": "w"}', "changes"),
        (b'{"type": "apply_gains", "changes": {}, "why": ""}', "why: Expected str of length >= 1"),
        (b'{"type": "hold", "now": 1}', "now"),
        (b"hold", "JSON is malformed"),
        (b"{}", "type"),
    ],
)
def test_bad_commands_are_refused_in_words(body: bytes, words: str) -> None:
    with pytest.raises(msgspec.DecodeError) as caught:
        msgspec.json.decode(body, type=AnyCommand)
    text = readable(caught.value)
    assert words in text
    assert "`" not in text and "$" not in text


def test_schemas_describe_every_command() -> None:
    command, _, components = struct_schemas()
    described = {part["$ref"].rpartition("/")[2] for part in command["anyOf"]}
    assert len(described) == len(command_types())
    assert described <= set(components)
    assert components["TakeOff"]["properties"]["height_m"]["maximum"] == 100.0


def record(number: int, controller: str, gains: dict[str, float]) -> dict[str, object]:
    return {"number": number, "controller": controller, "name": "edited", "gains": gains}


def test_changes_count_from_the_newest_set_of_that_controller() -> None:
    base = load_gain_set("pid", "default")
    flown = values(edited(base, {"yaw.p": 7.0}))
    status = {
        "controller": "lqr",
        "gain_set": 3,
        "gain_history": [record(1, "pid", values(base)), record(2, "pid", flown), record(3, "lqr", {})],
    }
    name, newest = newest_set("pid", status)
    assert name == "set 2, edited"
    assert values(newest)["yaw.p"] == 7.0
    answer = gains_answer(status)
    assert answer["live"] == {"controller": "lqr", "gain_set": 3}
    assert answer["controllers"]["pid"]["newest"]["values"]["yaw.p"] == 7.0
    assert answer["controllers"]["lqr"]["newest"]["values"] == values(load_gain_set("lqr", "default"))
    assert set(answer["controllers"]["lqr"]["sets"]) >= {"default", "published"}
    for kind in ("lqr", "pid"):
        assert {row["key"] for row in answer["controllers"][kind]["table"]} == set(
            answer["controllers"][kind]["newest"]["values"]
        )


def test_prediction_shows_what_a_change_does_and_names_a_bad_one() -> None:
    same = predict_change(DesignRequest("pid"), None, None)
    assert same.live == same.staged
    assert same.jump is None
    staged = predict_change(DesignRequest("pid", {"roll.p": 900.0}), None, None)
    assert staged.live == same.live
    assert staged.staged.poles != staged.live.poles
    with pytest.raises(DesignError, match=r"roll.p = -1 .* is outside 0 to 1000"):
        predict_change(DesignRequest("pid", {"roll.p": -1.0}), None, None)
    with pytest.raises(DesignError, match=r"unknown gain 'roll.x'"):
        predict_change(DesignRequest("pid", {"roll.x": 1.0}), None, None)


def test_predicted_jump_of_a_bumpless_change_is_nothing() -> None:
    frame = empty_frame()
    rng = np.random.default_rng(8)
    for name in SLICES:
        if name.startswith(("estimate.", "reference.", "control.")):
            frame[SLICES[name]] = rng.uniform(-0.2, 0.2, frame[SLICES[name]].shape)
    frame[0] = 12.0
    frame[SLICES["control.thrust"]] = 12.0
    jump = predicted_jump(edited(load_gain_set("lqr", "default"), {"attitude.q_roll": 40.0}), frame)
    assert jump is not None
    assert jump.torque_n_m < 1e-9
    assert jump.thrust_n < 1e-9
    frame[SLICES["reference.position_ned"]] = math.nan
    assert predicted_jump(load_gain_set("lqr", "default"), frame) is None


def test_runs_are_listed_newest_first_even_when_one_is_damaged(tmp_path: Path) -> None:
    assert list_runs(tmp_path / "none") == []
    for name, summary in (
        ("20260101T000000Z-a", '{"vehicle": "a", "limits": {}}'),
        ("20260102T000000Z-b", '{"vehi'),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(summary)
    (tmp_path / "something else").mkdir()
    runs = list_runs(tmp_path)
    assert [run["name"] for run in runs] == ["20260102T000000Z-b", "20260101T000000Z-a"]
    assert runs[1]["summary"] == {"vehicle": "a"}
    assert runs[0]["summary"] == {}
    assert runs[0]["bytes"] == 6
