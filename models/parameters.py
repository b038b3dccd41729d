"""Parameter files: TOML, every value with its unit and its source."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.arrays import Array

PARAMETER_FOLDER = Path(__file__).parent / "params"


class ParameterError(ValueError):
    """A parameter file that cannot be used; the message names file, key and what is wrong."""


def load_values(path: Path, units: dict[str, str]) -> dict[str, Any]:
    """Read ``{key: value}`` from a parameter file whose keys and units must be exactly ``units``.

    Raises ParameterError naming the file, the key and the valid choices for an unknown or missing key, a wrong unit,
    or a value without a source.
    """
    try:
        tables = tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise ParameterError(f"{path}: cannot be read as TOML: {error}") from error
    unknown = sorted(set(tables) - set(units))
    if unknown:
        raise ParameterError(f"{path}: unknown key '{unknown[0]}'; valid keys: {', '.join(sorted(units))}")
    values: dict[str, Any] = {}
    for key, unit in units.items():
        table = tables.get(key)
        if not isinstance(table, dict) or not {"value", "unit", "source"} <= set(table):
            raise ParameterError(f'{path}: [{key}] needs value, unit = "{unit}" and source')
        if table["unit"] != unit:
            raise ParameterError(f"{path}: [{key}] unit is '{table['unit']}', expected '{unit}'")
        values[key] = table["value"]
    return values


@dataclass(frozen=True, slots=True)
class QuadrotorParameters:
    """Quadrotor of Raja (2.8)-(2.16) and (4.9)-(4.10); fields, units and sources as in ``params/quadrotor.toml``."""

    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    linear_drag_1_s: float
    aerodynamic_moments: Array
    linearisation_yaw_rad: float
    arm_m: float
    rotor_force_coefficient_n_s2: float
    rotor_torque_coefficient_n_m_s2: float
    rotor_lag_s: float
    rotor_max_force_n: float
    rotor_min_speed_rad_s: float
    torque_scale_n_m: tuple[float, float, float]

    @property
    def max_thrust_n(self) -> float:
        """Thrust with all four rotors at their limit [N]; thrust is normalised by it."""
        return 4.0 * self.rotor_max_force_n


QUADROTOR_UNITS = {
    "mass": "kg",
    "inertia": "kg m^2",
    "linear_drag": "1/s",
    "aerodynamic_moments": "(rad/s^2)/(m/s), (rad/s^2)/(rad/s)",
    "linearisation_yaw": "rad",
    "arm": "m",
    "rotor_force_coefficient": "N s^2",
    "rotor_torque_coefficient": "N m s^2",
    "rotor_lag": "s",
    "rotor_max_force": "N",
    "rotor_min_speed": "rad/s",
    "torque_scale": "N m",
}


def load_quadrotor(path: Path = PARAMETER_FOLDER / "quadrotor.toml") -> QuadrotorParameters:
    """Read quadrotor parameters; raises ParameterError (see :func:`load_values`)."""
    v = load_values(path, QUADROTOR_UNITS)
    return QuadrotorParameters(
        mass_kg=float(v["mass"]),
        inertia_kg_m2=(float(v["inertia"][0]), float(v["inertia"][1]), float(v["inertia"][2])),
        linear_drag_1_s=float(v["linear_drag"]),
        aerodynamic_moments=np.array(v["aerodynamic_moments"], dtype=np.float64),
        linearisation_yaw_rad=float(v["linearisation_yaw"]),
        arm_m=float(v["arm"]),
        rotor_force_coefficient_n_s2=float(v["rotor_force_coefficient"]),
        rotor_torque_coefficient_n_m_s2=float(v["rotor_torque_coefficient"]),
        rotor_lag_s=float(v["rotor_lag"]),
        rotor_max_force_n=float(v["rotor_max_force"]),
        rotor_min_speed_rad_s=float(v["rotor_min_speed"]),
        torque_scale_n_m=(float(v["torque_scale"][0]), float(v["torque_scale"][1]), float(v["torque_scale"][2])),
    )
