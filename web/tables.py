"""What pages need to know of controllers and trajectories: tables and live gain sets. Light: it loads no kernels."""

from __future__ import annotations

from typing import Any, get_args

import msgspec

from controllers.gains import GainSet, edited, gain_set_names, load_gain_set, table_of, values
from gcs.commands import ControllerKind
from gcs.offboard.trajectories import FIELDS, StepResponse, Trajectory

KINDS: tuple[ControllerKind, ...] = ("lqr", "pid")
_LABELS = {"hover": "Hover", "go_to": "Go to", "circle": "Circle", "figure_eight": "Figure-eight", "step": "Step"}
_START_SET = "default"


class DesignError(ValueError):
    """A staged change that cannot be predicted; the message names key, value and range."""


class DesignRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes relative to the live gain set of a controller, by key of the gain table."""

    controller: ControllerKind
    changes: dict[str, float] = {}


def trajectory_table() -> list[dict[str, Any]]:
    """Every kind of trajectory with its numbers, their units, ranges and defaults, and its choices."""
    return [
        {
            "kind": kind.__struct_config__.tag,
            "label": _LABELS[str(kind.__struct_config__.tag)],
            "fields": _fields(kind),
            "choices": {"axis": list(get_args(_step_axis()))} if kind is StepResponse else {},
        }
        for kind in get_args(Trajectory)
    ]


def _step_axis() -> Any:
    return next(field.type for field in msgspec.structs.fields(StepResponse) if field.name == "axis")


def _fields(kind: type[Trajectory]) -> list[dict[str, Any]]:
    defaults = {field.encode_name: field.default for field in msgspec.structs.fields(kind)}
    return [
        {
            "name": field.name,
            "label": field.label,
            "unit": field.unit,
            "minimum": field.minimum,
            "maximum": field.maximum,
            "default": None if defaults[field.name] is msgspec.NODEFAULT else defaults[field.name],
        }
        for field in FIELDS[kind]
    ]


def newest_set(kind: ControllerKind, status: dict[str, Any] | None) -> tuple[str, GainSet]:
    """The newest gain set of a controller in this run, with its name; before it has flown, the one it starts with."""
    base = load_gain_set(kind, _START_SET)
    for record in reversed((status or {}).get("gain_history", [])):
        if record["controller"] == kind:
            return f"set {record['number']}, {record['name']}", edited(base, record["gains"])
    return _START_SET, base


def gains_answer(status: dict[str, Any] | None) -> dict[str, Any]:
    """Table, named sets and newest values of each controller, and which one flies."""
    answer: dict[str, Any] = {
        "live": {
            "controller": (status or {}).get("controller"),
            "gain_set": (status or {}).get("gain_set"),
        },
        "controllers": {},
    }
    for kind in KINDS:
        name, gain_set = newest_set(kind, status)
        answer["controllers"][kind] = {
            "table": [
                {
                    "key": entry.key,
                    "label": entry.label,
                    "symbol": entry.symbol,
                    "unit": entry.unit,
                    "minimum": entry.minimum,
                    "maximum": entry.maximum,
                    "group": entry.group,
                }
                for entry in table_of(kind)
            ],
            "sets": {name: values(load_gain_set(kind, name)) for name in gain_set_names(kind)},
            "newest": {"name": name, "values": values(gain_set)},
        }
    return answer
