"""Vehicle files: one TOML per vehicle, checked whole before anything starts.

A wrong file names itself, the key, the value and what is valid; nothing of it is applied.
"""

from __future__ import annotations

import difflib
import math
import tomllib
import types
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from gcs.mavlink.urls import LinkUrlError, parse_link_url
from models.arrays import Vec3
from models.setpoints import Authority

VEHICLE_FOLDER = Path(__file__).parent / "vehicles"
PARAMETER_FOLDER = Path(__file__).parents[1] / "models" / "params"
LARGEST_RATE_HZ = 400.0

VehicleType = Literal["quadrotor", "helicopter", "fixed-wing"]


def _unit(unit: str, low: float, high: float) -> Meta:
    return Meta(ge=low, le=high, extra={"unit": unit})


class ConfigError(Exception):
    """A configuration that must not be used: names the file, the key, the value and the valid choices."""


class Scales(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What normalised commands mean. Give ``max_thrust_n``, or ``hover_thrust`` (0..1) where only that is known."""

    max_thrust_n: Annotated[float, _unit("N", 0.1, 1e5)] | None = None
    hover_thrust: Annotated[float, _unit("of full thrust", 0.05, 0.95)] | None = None
    torque_scale_n_m: Vec3 = (2.0, 2.0, 0.4)
    rate_loop_lag_s: Annotated[float, _unit("s", 0.0, 1.0)] = 0.05

    def full_thrust_n(self, weight_n: float) -> float:
        """Thrust at control 1 [N], from the hover thrust and the weight [N] if it is not given."""
        if self.max_thrust_n is not None:
            return self.max_thrust_n
        assert self.hover_thrust is not None, "one of the two is checked when a file is read"
        return weight_n / self.hover_thrust


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Flight limits; a breach makes the vehicle hold, then land. Height and radius count from home."""

    height_max_m: Annotated[float, _unit("m", 0.5, 1000.0)] = 50.0
    radius_max_m: Annotated[float, _unit("m", 1.0, 10000.0)] = 100.0
    tilt_max_deg: Annotated[float, _unit("deg", 5.0, 80.0)] = 50.0
    speed_max_m_s: Annotated[float, _unit("m/s", 0.1, 60.0)] = 15.0
    climb_max_m_s: Annotated[float, _unit("m/s", 0.1, 20.0)] = 5.0

    @property
    def tilt_max_rad(self) -> float:
        return math.radians(self.tilt_max_deg)


class Estimator(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the estimator must know of the vehicle; noise None takes the reference model's."""

    position_source: Literal["gnss", "mocap", "any"] = "any"
    gnss_delay_s: Annotated[float, _unit("s", 0.0, 1.0)] = 0.1
    declination_deg: Annotated[float, _unit("deg", -180.0, 180.0)] = 0.0
    gyro_noise_rad_s_sqrt_hz: Annotated[float, _unit("rad/s/sqrt(Hz)", 1e-6, 1.0)] | None = None
    accel_noise_m_s2_sqrt_hz: Annotated[float, _unit("m/s^2/sqrt(Hz)", 1e-5, 10.0)] | None = None

    @property
    def declination_rad(self) -> float:
        return math.radians(self.declination_deg)


class Controller(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The controller in use at the start, and the named gain sets loaded."""

    kind: Literal["lqr", "pid"] = "lqr"
    lqr_gains: str = "default"
    pid_gains: str = "default"
    feed_forward: bool = True


class Loss(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When the vehicle's own failsafe takes over after our last setpoint."""

    setpoint_timeout_s: Annotated[float, _unit("s", 0.05, 5.0)] = 0.5


class VehicleFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A vehicle as its file describes it. ``system_id`` 0 takes the first autopilot heard.

    ``message_rates`` are asked of the autopilot, in Hz by MAVLink message name; ``parameters`` is a set that comes
    with rotorlab or the path of a TOML file (relative paths count from the vehicle file).
    """

    name: Annotated[str, Meta(min_length=1, max_length=40)]
    type: VehicleType
    autopilot: Literal["px4", "ardupilot"]
    authority: Authority
    parameters: str
    link: str
    scales: Scales
    system_id: Annotated[int, Meta(ge=0, le=254)] = 0
    message_rates: dict[str, float] = msgspec.field(default_factory=dict)
    limits: Limits = Limits()
    estimator: Estimator = Estimator()
    controller: Controller = Controller()
    loss: Loss = Loss()


def simulated_vehicle(kind: str) -> Path:
    """Vehicle file of the simulated vehicle ``kind``; raises ConfigError naming those there are."""
    known = sorted(path.stem.removeprefix("sim_") for path in VEHICLE_FOLDER.glob("sim_*.toml"))
    if kind not in known:
        raise ConfigError(f"--sim {kind}: no such simulated vehicle; there are {', '.join(known)}")
    return VEHICLE_FOLDER / f"sim_{kind}.toml"


def load_vehicle(path: Path) -> VehicleFile:
    """Read and check a vehicle file.

    Raises ConfigError for a file that cannot be read, unknown keys, wrong types, values out of range, an invalid link
    URL, an unknown MAVLink message or a missing parameter file.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path}: not a TOML file: {error}") from error
    vehicle = _convert_struct(path, "", table, VehicleFile)
    _check_scales(path, vehicle.scales)
    _check_rates(path, vehicle.message_rates)
    check_link(vehicle.link, f"{path}: link")
    parameter_file(vehicle, path)
    return vehicle


def parameter_file(vehicle: VehicleFile, vehicle_path: Path) -> Path:
    """Path of the parameter file a vehicle names; raises ConfigError when there is none."""
    shipped = PARAMETER_FOLDER / f"{vehicle.parameters}.toml"
    if shipped.is_file():
        return shipped
    own = vehicle_path.parent / vehicle.parameters
    if own.is_file():
        return own
    known = ", ".join(sorted(path.stem for path in PARAMETER_FOLDER.glob("*.toml")))
    raise ConfigError(
        f'{vehicle_path}: parameters = "{vehicle.parameters}": neither a set that comes with rotorlab ({known}) '
        f"nor a file at {own}"
    )


def check_link(url: str, where: str) -> None:
    """Raise ConfigError, beginning with ``where``, unless ``url`` is a link URL."""
    try:
        parse_link_url(url)
    except LinkUrlError as error:
        raise ConfigError(f"{where}: {error}") from error


def _check_scales(path: Path, scales: Scales) -> None:
    given = [name for name in ("max_thrust_n", "hover_thrust") if getattr(scales, name) is not None]
    if len(given) != 1:
        raise ConfigError(
            f"{path}: [scales] has {' and '.join(given) or 'no thrust scale'}; give one of "
            "max_thrust_n (N, thrust at control 1) and hover_thrust (of full thrust)"
        )
    if not all(0.0 < scale <= 1e4 for scale in scales.torque_scale_n_m):
        raise ConfigError(
            f"{path}: [scales] torque_scale_n_m = {list(scales.torque_scale_n_m)}: each above 0, to 10000 N m"
        )


def _check_rates(path: Path, rates: dict[str, float]) -> None:
    from gcs.mavlink.dialect import MESSAGE_IDS

    for name, rate_hz in rates.items():
        if name not in MESSAGE_IDS:
            near = difflib.get_close_matches(name, MESSAGE_IDS, n=3)
            hint = f"; near it: {', '.join(near)}" if near else ""
            raise ConfigError(f"{path}: [message_rates] {name}: no such MAVLink message{hint}")
        if not 0.0 < rate_hz <= LARGEST_RATE_HZ:
            raise ConfigError(f"{path}: [message_rates] {name} = {rate_hz}: above 0, to {LARGEST_RATE_HZ:g} Hz")


_Table = TypeVar("_Table", bound=msgspec.Struct)


def _convert_struct(path: Path, section: str, table: dict[str, Any], target: type[_Table]) -> _Table:
    """Build ``target`` key by key, so that an error can name key, value and valid choices."""
    hints = get_type_hints(target, include_extras=True)
    place = f"{path}: [{section}] " if section else f"{path}: "
    for key in table:
        if key not in hints:
            near = difflib.get_close_matches(key, hints, n=1)
            meant = f" (near it: {near[0]})" if near else ""
            raise ConfigError(f"{place}{key}: unknown key{meant}; valid keys: {', '.join(hints)}")
    values: dict[str, Any] = {}
    for field in msgspec.structs.fields(target):
        if field.name not in table:
            if field.required:
                raise ConfigError(f"{place}{field.name} is missing: {_expected(hints[field.name])}")
            continue
        values[field.name] = _convert_value(path, place, field.name, table[field.name], hints[field.name])
    return target(**values)


def _convert_value(path: Path, place: str, key: str, value: Any, hint: Any) -> Any:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        if not isinstance(value, dict):
            raise ConfigError(f"{place}{key} = {value!r}: must be a table, [{key}]")
        return _convert_struct(path, key, value, hint)
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{place}{key} = {value!r}: {_expected(hint)}") from error


def _expected(hint: Any) -> str:
    """What a value of this type must be, with its unit and range or its choices."""
    if get_origin(hint) in (Union, types.UnionType):
        return _expected(next(part for part in get_args(hint) if part is not type(None)))
    if get_origin(hint) is Literal:
        return "one of " + ", ".join(map(str, get_args(hint)))
    if isinstance(hint, type) and issubclass(hint, Authority):
        return "one of " + ", ".join(hint)
    if get_origin(hint) is Annotated:
        base, meta = get_args(hint)[:2]
        if base is str:
            return f"text of {meta.min_length} to {meta.max_length} characters"
        unit = (meta.extra or {}).get("unit", "")
        word = "whole number" if base is int else "number"
        return f"must be a {word} from {meta.ge:g} to {meta.le:g} {unit}".rstrip()
    if hint == Vec3:
        return "must be three numbers"
    if get_origin(hint) is dict:
        return "must be a table of numbers"
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return f"the table needs {', '.join(field.name for field in msgspec.structs.fields(hint))}"
    return {str: "must be text", bool: "must be true or false"}.get(hint, "must be a number")
