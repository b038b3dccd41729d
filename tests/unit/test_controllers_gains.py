"""Gain sets: files, table, editing."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from controllers.gains import (
    GAIN_SET_FOLDER,
    GainError,
    GainSet,
    edited,
    gain_set_names,
    kind_of,
    load_gain_set,
    table_of,
    values,
)


@pytest.mark.parametrize("kind", ["lqr", "pid"])
def test_named_sets_load_and_the_table_covers_every_number(kind) -> None:
    assert {"default", "published"} <= set(gain_set_names(kind))
    for name in gain_set_names(kind):
        gain_set = load_gain_set(kind, name)
        assert kind_of(gain_set) == kind
        built = msgspec.to_builtins(gain_set)
        numbers = [v for table in built.values() if isinstance(table, dict) for v in table.values()]
        assert len(table_of(kind)) == len(numbers) + 1  # and feed-forward
        assert sorted(values(gain_set).values()) == sorted([*numbers, float(gain_set.feed_forward)])


def test_default_differs_from_published_where_it_should() -> None:
    published, default = values(load_gain_set("lqr", "published")), values(load_gain_set("lqr", "default"))
    changed = {key: (published[key], default[key]) for key in published if published[key] != default[key]}
    assert changed == {
        "attitude.q_yaw": (1.0, 20.0),
        "height.q_integral": (3.0, 5.0),
        "feed_forward": (0.0, 1.0),
    }


def test_sets_survive_json() -> None:
    for kind in ("lqr", "pid"):
        gain_set = load_gain_set(kind, "default")
        assert msgspec.json.decode(msgspec.json.encode(gain_set), type=GainSet) == gain_set


def test_edit_changes_only_what_was_asked() -> None:
    before = load_gain_set("lqr", "default")
    after = edited(before, {"attitude.q_roll": 3.5, "feed_forward": 0.0})
    changed = {k: v for k, v in values(after).items() if values(before)[k] != v}
    assert changed == {"attitude.q_roll": 3.5, "feed_forward": 0.0}
    assert values(before)["attitude.q_roll"] == 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"roll.p": 150.0, "pitch.p": 5000.0}, ("pitch.p", "5000", "0 to 1000")),
        ({"roll.p": float("nan")}, ("roll.p", "nan")),
        ({"roll.q": 1.0}, ("roll.q", "valid keys", "roll.p")),
        ({"attitude.q_roll": 1.0}, ("attitude.q_roll", "pid")),
        ({"feed_forward": 0.5}, ("feed_forward", "0.5")),
    ],
)
def test_bad_edit_names_key_value_and_range_and_applies_nothing(changes, words) -> None:
    before = load_gain_set("pid", "default")
    snapshot = values(before)
    with pytest.raises(GainError) as error:
        edited(before, changes)
    assert all(word in str(error.value) for word in words)
    assert values(before) == snapshot


def test_unknown_set_names_the_choices() -> None:
    with pytest.raises(GainError, match=r"'nope'.*default, published"):
        load_gain_set("lqr", "nope")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("source = 'x'\nfeed_forward = true\n[roll]\np = 1\n", "missing required field"),
        ("source = 'x'\nnonsense = 1\n", "nonsense"),
        ("source = 'x'\nfeed_forward = tru\n", "TOML"),
        ("feed_forward = true\n", "source"),
    ],
)
def test_bad_file_names_file_and_key(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "pid_mine.toml").write_text(text)
    with pytest.raises(GainError, match=words) as error:
        load_gain_set("pid", "mine", tmp_path)
    assert "pid_mine.toml" in str(error.value)


def test_file_out_of_range_is_refused(tmp_path: Path) -> None:
    text = (GAIN_SET_FOLDER / "pid_default.toml").read_text().replace("p = 35.0", "p = 3500.0")
    (tmp_path / "pid_hot.toml").write_text(text)
    with pytest.raises(GainError, match=r"pid_hot.toml.*yaw.p = 3500.*0 to 500"):
        load_gain_set("pid", "hot", tmp_path)
