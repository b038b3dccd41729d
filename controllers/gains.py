"""Gain sets: every number an operator may tune, its range and unit, and the named sets in ``models/params/gain_sets``.

A gain set is immutable; :func:`edited` gives a new one, or raises and changes nothing. LQR sets are tuned by their
weights Q and R (the gains follow from them), PID sets by their gains per unit of inertia or mass.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec

from models.parameters import PARAMETER_FOLDER

GAIN_SET_FOLDER = PARAMETER_FOLDER / "gain_sets"
Kind: TypeAlias = Literal["lqr", "pid"]


class GainError(ValueError):
    """A gain or gain set that cannot be used; the message names key, value and range."""


class _Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class AttitudeWeights(_Table, frozen=True, kw_only=True):
    """Diagonals of Q (states, then integrals) and R of the attitude loop, Raja (4.14)."""

    q_roll: float
    q_pitch: float
    q_yaw: float
    q_roll_rate: float
    q_pitch_rate: float
    q_yaw_rate: float
    q_velocity_x: float
    q_velocity_y: float
    q_roll_integral: float
    q_pitch_integral: float
    q_yaw_integral: float
    r_roll: float
    r_pitch: float
    r_yaw: float


class HeightWeights(_Table, frozen=True, kw_only=True):
    """Diagonals of Q and R of the height loop, Raja (4.19)."""

    q_height: float
    q_climb: float
    q_integral: float
    r_thrust: float


class PositionWeights(_Table, frozen=True, kw_only=True):
    """Diagonals of Q and R of the horizontal loop in the heading frame, Raja (4.24)."""

    q_x: float
    q_y: float
    q_velocity_x: float
    q_velocity_y: float
    q_x_integral: float
    q_y_integral: float
    r_roll: float
    r_pitch: float


class LqrWeights(_Table, frozen=True, kw_only=True, tag_field="kind", tag="lqr"):
    """Weights of the LQR with integral action; ``feed_forward`` adds reference velocity and acceleration."""

    name: str
    feed_forward: bool
    attitude: AttitudeWeights
    height: HeightWeights
    position: PositionWeights


class AxisGains(_Table, frozen=True, kw_only=True):
    """Proportional [1/s^2], integral [1/s^3] and rate [1/s] gain from error to acceleration of one axis."""

    p: float
    i: float
    d: float


class PidGains(_Table, frozen=True, kw_only=True, tag_field="kind", tag="pid"):
    """PI/PID cascade: P and I on the error, D on the rate; horizontal position gives an acceleration, hence tilt."""

    name: str
    feed_forward: bool
    roll: AxisGains
    pitch: AxisGains
    yaw: AxisGains
    height: AxisGains
    position: AxisGains


GainSet: TypeAlias = LqrWeights | PidGains


@dataclass(frozen=True, slots=True)
class GainEntry:
    """One tunable number: dotted key, label and symbol for people, unit, range, and the group it is shown in."""

    key: str
    label: str
    symbol: str
    unit: str
    minimum: float
    maximum: float
    group: Literal["roll", "pitch", "yaw", "height", "position"]


_FEED_FORWARD = GainEntry("feed_forward", "reference feed-forward", "FF", "0 or 1", 0.0, 1.0, "position")

LQR_TABLE: tuple[GainEntry, ...] = (
    GainEntry("attitude.q_roll", "roll", "Q_φ", "1/rad²", 0.0, 1e4, "roll"),
    GainEntry("attitude.q_roll_rate", "roll rate", "Q_p", "s²/rad²", 0.0, 1e3, "roll"),
    GainEntry("attitude.q_roll_integral", "roll integral", "Q_∫φ", "1/(rad s)²", 0.01, 1e5, "roll"),
    GainEntry("attitude.q_velocity_y", "side velocity", "Q_vy", "s²/m²", 0.0, 1e3, "roll"),
    GainEntry("attitude.r_roll", "roll torque", "R_φ", "1/(N m)²", 0.1, 1e4, "roll"),
    GainEntry("attitude.q_pitch", "pitch", "Q_θ", "1/rad²", 0.0, 1e4, "pitch"),
    GainEntry("attitude.q_pitch_rate", "pitch rate", "Q_q", "s²/rad²", 0.0, 1e3, "pitch"),
    GainEntry("attitude.q_pitch_integral", "pitch integral", "Q_∫θ", "1/(rad s)²", 0.01, 1e5, "pitch"),
    GainEntry("attitude.q_velocity_x", "forward velocity", "Q_vx", "s²/m²", 0.0, 1e3, "pitch"),
    GainEntry("attitude.r_pitch", "pitch torque", "R_θ", "1/(N m)²", 0.1, 1e4, "pitch"),
    GainEntry("attitude.q_yaw", "yaw", "Q_ψ", "1/rad²", 0.0, 1e4, "yaw"),
    GainEntry("attitude.q_yaw_rate", "yaw rate", "Q_r", "s²/rad²", 0.0, 1e3, "yaw"),
    GainEntry("attitude.q_yaw_integral", "yaw integral", "Q_∫ψ", "1/(rad s)²", 0.01, 1e5, "yaw"),
    GainEntry("attitude.r_yaw", "yaw torque", "R_ψ", "1/(N m)²", 0.1, 1e4, "yaw"),
    GainEntry("height.q_height", "height", "Q_z", "1/m²", 0.0, 1e3, "height"),
    GainEntry("height.q_climb", "climb rate", "Q_vz", "s²/m²", 0.0, 1e3, "height"),
    GainEntry("height.q_integral", "height integral", "Q_∫z", "1/(m s)²", 0.001, 1e3, "height"),
    GainEntry("height.r_thrust", "thrust", "R_T", "1/N²", 0.001, 1e3, "height"),
    GainEntry("position.q_x", "forward position", "Q_x", "1/m²", 0.0, 1e2, "position"),
    GainEntry("position.q_y", "side position", "Q_y", "1/m²", 0.0, 1e2, "position"),
    GainEntry("position.q_velocity_x", "forward velocity", "Q_vx", "s²/m²", 0.0, 1e2, "position"),
    GainEntry("position.q_velocity_y", "side velocity", "Q_vy", "s²/m²", 0.0, 1e2, "position"),
    GainEntry("position.q_x_integral", "forward integral", "Q_∫x", "1/(m s)²", 1e-4, 1e2, "position"),
    GainEntry("position.q_y_integral", "side integral", "Q_∫y", "1/(m s)²", 1e-4, 1e2, "position"),
    GainEntry("position.r_roll", "roll command", "R_φ", "1/rad²", 0.01, 1e3, "position"),
    GainEntry("position.r_pitch", "pitch command", "R_θ", "1/rad²", 0.01, 1e3, "position"),
    _FEED_FORWARD,
)
PID_TABLE: tuple[GainEntry, ...] = (
    GainEntry("roll.p", "roll P", "P_φ", "1/s²", 0.0, 1000.0, "roll"),
    GainEntry("roll.i", "roll I", "I_φ", "1/s³", 0.0, 2000.0, "roll"),
    GainEntry("roll.d", "roll D", "D_φ", "1/s", 0.0, 100.0, "roll"),
    GainEntry("pitch.p", "pitch P", "P_θ", "1/s²", 0.0, 1000.0, "pitch"),
    GainEntry("pitch.i", "pitch I", "I_θ", "1/s³", 0.0, 2000.0, "pitch"),
    GainEntry("pitch.d", "pitch D", "D_θ", "1/s", 0.0, 100.0, "pitch"),
    GainEntry("yaw.p", "yaw P", "P_ψ", "1/s²", 0.0, 500.0, "yaw"),
    GainEntry("yaw.i", "yaw I", "I_ψ", "1/s³", 0.0, 500.0, "yaw"),
    GainEntry("yaw.d", "yaw D", "D_ψ", "1/s", 0.0, 100.0, "yaw"),
    GainEntry("height.p", "height P", "P_z", "1/s²", 0.0, 100.0, "height"),
    GainEntry("height.i", "height I", "I_z", "1/s³", 0.0, 100.0, "height"),
    GainEntry("height.d", "height D", "D_z", "1/s", 0.0, 50.0, "height"),
    GainEntry("position.p", "position P", "P_xy", "1/s²", 0.0, 50.0, "position"),
    GainEntry("position.i", "position I", "I_xy", "1/s³", 0.0, 20.0, "position"),
    GainEntry("position.d", "position D", "D_xy", "1/s", 0.0, 20.0, "position"),
    _FEED_FORWARD,
)


def table_of(kind: Kind) -> tuple[GainEntry, ...]:
    """Every tunable number of a kind of controller, in display order."""
    return LQR_TABLE if kind == "lqr" else PID_TABLE


def kind_of(gain_set: GainSet) -> Kind:
    """``lqr`` or ``pid``."""
    return "lqr" if isinstance(gain_set, LqrWeights) else "pid"


def values(gain_set: GainSet) -> dict[str, float]:
    """Flat {key: value} of a gain set, in the order of its table."""
    return {entry.key: _value(gain_set, entry.key) for entry in table_of(kind_of(gain_set))}


def edited(gain_set: GainSet, changes: Mapping[str, float]) -> GainSet:
    """A copy with some entries changed; raises GainError naming key, value and range, and then nothing is changed."""
    entries = {entry.key: entry for entry in table_of(kind_of(gain_set))}
    new = gain_set
    for key, value in changes.items():
        entry = entries.get(key)
        if entry is None:
            raise GainError(f"unknown gain '{key}' of {kind_of(gain_set)}; valid keys: {', '.join(entries)}")
        _check(entry, value)
        new = _replaced(new, key, value)
    return new


def load_gain_set(kind: Kind, name: str, folder: Path = GAIN_SET_FOLDER) -> GainSet:
    """Read a named gain set; raises GainError naming file, key and the valid choices."""
    path = folder / f"{kind}_{name}.toml"
    if not path.is_file():
        raise GainError(f"no gain set '{name}' for {kind}; valid choices: {', '.join(gain_set_names(kind, folder))}")
    try:
        tables: dict[str, Any] = tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise GainError(f"{path}: cannot be read as TOML: {error}") from error
    if "source" not in tables:
        raise GainError(f"{path}: needs a source")
    del tables["source"]
    try:
        gain_set: GainSet = msgspec.convert({**tables, "kind": kind, "name": name}, GainSet)
    except msgspec.ValidationError as error:
        raise GainError(f"{path}: {error}") from error
    for entry in table_of(kind):
        try:
            _check(entry, _value(gain_set, entry.key))
        except GainError as error:
            raise GainError(f"{path}: {error}") from error
    return gain_set


def gain_set_names(kind: Kind, folder: Path = GAIN_SET_FOLDER) -> tuple[str, ...]:
    """Names of the sets on disk for one kind of controller."""
    return tuple(sorted(path.stem.removeprefix(f"{kind}_") for path in folder.glob(f"{kind}_*.toml")))


def _check(entry: GainEntry, value: float) -> None:
    if not (math.isfinite(value) and entry.minimum <= value <= entry.maximum):
        raise GainError(f"{entry.key} = {value:g} {entry.unit} is outside {entry.minimum:g} to {entry.maximum:g}")
    if entry is _FEED_FORWARD and value not in (0.0, 1.0):
        raise GainError(f"{entry.key} = {value:g} must be 0 (off) or 1 (on)")


def _value(gain_set: GainSet, key: str) -> float:
    value: Any = gain_set
    for part in key.split("."):
        value = getattr(value, part)
    return float(value)


def _replaced(gain_set: GainSet, key: str, value: float) -> GainSet:
    if key == _FEED_FORWARD.key:
        return msgspec.structs.replace(gain_set, feed_forward=bool(value))
    table, _, field = key.partition(".")
    changed = msgspec.structs.replace(getattr(gain_set, table), **{field: float(value)})
    return msgspec.structs.replace(gain_set, **{table: changed})
