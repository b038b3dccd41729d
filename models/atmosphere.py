"""International Standard Atmosphere (ISO 2533), troposphere: what a barometer reading means in height.

Good from -1 to 11 km geopotential height. Height here is above mean sea level of the standard atmosphere; a weather
offset is for an estimator to find.
"""

from __future__ import annotations

SEA_LEVEL_PRESSURE_PA = 101325.0
SEA_LEVEL_TEMPERATURE_K = 288.15
LAPSE_RATE_K_M = 0.0065
GAS_CONSTANT_J_KG_K = 287.053
PRESSURE_EXPONENT = 5.25588


def temperature_k(height_m: float) -> float:
    """Standard air temperature [K] at a height [m]: T0 - L h."""
    return SEA_LEVEL_TEMPERATURE_K - LAPSE_RATE_K_M * height_m


def pressure_pa(height_m: float) -> float:
    """Standard static pressure [Pa] at a height [m]: p0 (1 - L h / T0)^5.25588."""
    ratio: float = (1.0 - LAPSE_RATE_K_M * height_m / SEA_LEVEL_TEMPERATURE_K) ** PRESSURE_EXPONENT
    return SEA_LEVEL_PRESSURE_PA * ratio


def height_m(static_pressure_pa: float) -> float:
    """Height [m] at which the standard atmosphere has this static pressure [Pa]; raises ValueError unless positive."""
    if static_pressure_pa <= 0.0:
        raise ValueError(f"static pressure must be positive, got {static_pressure_pa} Pa")
    ratio: float = (static_pressure_pa / SEA_LEVEL_PRESSURE_PA) ** (1.0 / PRESSURE_EXPONENT)
    return SEA_LEVEL_TEMPERATURE_K / LAPSE_RATE_K_M * (1.0 - ratio)


def density_kg_m3(static_pressure_pa: float, air_temperature_k: float) -> float:
    """Density of dry air [kg/m^3] by the ideal gas law: p / (R T)."""
    return static_pressure_pa / (GAS_CONSTANT_J_KG_K * air_temperature_k)
