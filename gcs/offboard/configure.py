"""From a vehicle file to what the tick and the link need, all read and checked before the first byte moves."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from controllers.authority import VehicleScales, scales_of
from controllers.gains import GainError, GainSet, edited, gain_set_names, load_gain_set
from estimators.ekf_parameters import EkfParameters, ImuSampling
from gcs.config import ConfigError, VehicleFile, load_vehicle, parameter_file
from gcs.mavlink.dialect import MESSAGE_IDS
from gcs.mavlink.link import LinkConfig
from gcs.offboard.state import OffboardConfig
from models.frames import STANDARD_GRAVITY_M_S2
from models.parameters import ParameterError, QuadrotorParameters, load_quadrotor


def read_offboard_config(path: Path) -> OffboardConfig:
    """Read a vehicle file and everything it names. Raises ConfigError naming file, key and valid choices."""
    vehicle = load_vehicle(path)
    if vehicle.type != "quadrotor":
        raise ConfigError(f"{path}: type = {vehicle.type}: only a quadrotor can be flown offboard so far")
    try:
        parameters = load_quadrotor(parameter_file(vehicle, path))
    except ParameterError as error:
        raise ConfigError(str(error)) from error
    return OffboardConfig(
        vehicle=vehicle,
        parameters=parameters,
        ekf=_ekf_parameters(vehicle),
        scales=_scales(vehicle, parameters),
        gain_sets=_gain_sets(vehicle, path),
    )


def link_config(vehicle: VehicleFile, *, clock_rate: float | None = None) -> LinkConfig:
    """What the link asks of this vehicle; packets are kept for the .tlog."""
    rates = {MESSAGE_IDS[name]: rate_hz for name, rate_hz in vehicle.message_rates.items()}
    return LinkConfig(rates_hz=rates, clock_rate=clock_rate, keep_packets=True)


def _ekf_parameters(vehicle: VehicleFile) -> EkfParameters:
    estimator = vehicle.estimator
    parameters = EkfParameters(
        gnss_delay_s=estimator.gnss_delay_s,
        imu_sampling=ImuSampling.INSTANT if vehicle.autopilot == "ardupilot" else ImuSampling.MEAN,
        declination_rad=math.radians(estimator.declination_deg),
    )
    if estimator.gyro_noise_rad_s_sqrt_hz is not None:
        parameters = replace(parameters, gyro_noise=estimator.gyro_noise_rad_s_sqrt_hz)
    if estimator.accel_noise_m_s2_sqrt_hz is not None:
        parameters = replace(parameters, accel_noise=estimator.accel_noise_m_s2_sqrt_hz)
    return parameters


def _scales(vehicle: VehicleFile, parameters: QuadrotorParameters) -> VehicleScales:
    lag_s = vehicle.scales.rate_loop_lag_s
    return replace(
        scales_of(parameters),
        max_thrust_n=vehicle.scales.full_thrust_n(parameters.mass_kg * STANDARD_GRAVITY_M_S2),
        torque_scale_n_m=vehicle.scales.torque_scale_n_m,
        rate_loop_lag_s=(lag_s, lag_s, 2.0 * lag_s),
        max_speed_m_s=vehicle.limits.speed_max_m_s,
    )


def _gain_sets(vehicle: VehicleFile, path: Path) -> dict[tuple[str, str], GainSet]:
    """Every named set; those the vehicle file names take its choice of feed-forward."""
    sets: dict[tuple[str, str], GainSet] = {}
    try:
        for kind in ("lqr", "pid"):
            for name in gain_set_names(kind):
                sets[kind, name] = load_gain_set(kind, name)
        for kind, name in (("lqr", vehicle.controller.lqr_gains), ("pid", vehicle.controller.pid_gains)):
            if (kind, name) not in sets:
                names = ", ".join(n for k, n in sets if k == kind)
                raise ConfigError(f"{path}: [controller] {kind}_gains = {name}: no such set; there are {names}")
            sets[kind, name] = edited(sets[kind, name], {"feed_forward": float(vehicle.controller.feed_forward)})
    except GainError as error:
        raise ConfigError(str(error)) from error
    return sets
