"""Vehicle files: those that come with rotorlab are right; a wrong one is refused with file, key, value and choices."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.config import VEHICLE_FOLDER, ConfigError, load_vehicle, parameter_file, simulated_vehicle
from models.parameters import load_quadrotor
from models.setpoints import Authority

TEXT = (VEHICLE_FOLDER / "sim_quadrotor.toml").read_text(encoding="utf-8")


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    """The simulated quadrotor's file with lines replaced."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_vehicle(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("path", sorted(VEHICLE_FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_vehicle_files_load(path: Path) -> None:
    vehicle = load_vehicle(path)
    assert load_quadrotor(parameter_file(vehicle, path)).mass_kg > 0.0
    assert vehicle.message_rates["HIGHRES_IMU"] == 100.0


def test_authority_of_the_simulated_quadrotors() -> None:
    kinds = {
        "quadrotor": Authority.ACTUATOR,
        "quadrotor_rates": Authority.RATES,
        "quadrotor_attitude": Authority.ATTITUDE,
    }
    for kind, authority in kinds.items():
        assert load_vehicle(simulated_vehicle(kind)).authority is authority


def test_scales_agree_with_the_reference_model() -> None:
    path = simulated_vehicle("quadrotor")
    vehicle = load_vehicle(path)
    model = load_quadrotor(parameter_file(vehicle, path))
    assert vehicle.scales.full_thrust_n(weight_n=12.5) == pytest.approx(4 * model.rotor_max_force_n)
    assert vehicle.scales.torque_scale_n_m == model.torque_scale_n_m


def test_hover_thrust_gives_the_thrust_scale(tmp_path: Path) -> None:
    vehicle = load_vehicle(write(tmp_path, ("max_thrust_n = 28.0 ", "hover_thrust = 0.5 ")))
    assert vehicle.scales.full_thrust_n(weight_n=12.5) == 25.0


def test_degrees_become_radians(tmp_path: Path) -> None:
    vehicle = load_vehicle(write(tmp_path, ("declination_deg = 3.2 ", "declination_deg = 90.0 ")))
    assert vehicle.estimator.declination_rad == pytest.approx(math.pi / 2)
    assert vehicle.limits.tilt_max_rad == pytest.approx(math.radians(50.0))


REFUSED = {
    "unknown key": (("tilt_max_deg = 50.0", "tilt_max = 50.0"), ["[limits] tilt_max:", "unknown key", "tilt_max_deg"]),
    "unknown table": (("[loss]", "[losses]"), ["losses: unknown key", "near it: loss"]),
    "wrong choice": (('"px4" ', '"pixhawk" '), ["autopilot = 'pixhawk'", "one of px4, ardupilot"]),
    "wrong authority": (('"actuator" ', '"motors" '), ["authority = 'motors'", "position, velocity, attitude, rates"]),
    "out of range": (
        ("height_max_m = 50.0", "height_max_m = 5e4"),
        ["[limits] height_max_m = 50000.0", "0.5 to 1000 m"],
    ),
    "degrees for radians": (("tilt_max_deg = 50.0", "tilt_max_deg = 0.87"), ["tilt_max_deg = 0.87", "5 to 80 deg"]),
    "text for a number": (("speed_max_m_s = 15.0", 'speed_max_m_s = "fast"'), ["speed_max_m_s = 'fast'", "60 m/s"]),
    "not a number": (("speed_max_m_s = 15.0", "speed_max_m_s = nan"), ["speed_max_m_s = nan", "60 m/s"]),
    "text for true": (("feed_forward = true", 'feed_forward = "yes"'), ["feed_forward = 'yes'", "true or false"]),
    "value for a table": (("[loss]\n", "loss = 1\n[other]\n"), ["other: unknown key"]),
    "bad link": (("udpin://127.0.0.1:14550", "udp://14550"), ["link", "udpin://", "serial://device:baud"]),
    "bad port": (("127.0.0.1:14550", "127.0.0.1:145500"), ["port 145500"]),
    "unknown message": (("GPS_RAW_INT =", "GPS_RAW ="), ["[message_rates] GPS_RAW:", "GPS_RAW_INT"]),
    "rate too high": (("HIGHRES_IMU = 100.0", "HIGHRES_IMU = 1000.0"), ["HIGHRES_IMU = 1000.0", "400 Hz"]),
    "rate zero": (("HIGHRES_IMU = 100.0", "HIGHRES_IMU = 0"), ["HIGHRES_IMU = 0", "above 0"]),
    "no such parameters": (('"quadrotor"      #', '"octorotor"      #'), ["octorotor", "quadrotor"]),
    "two thrust scales": (
        ("max_thrust_n = 28.0 ", "max_thrust_n = 28.0\nhover_thrust = 0.4 "),
        ["max_thrust_n and hover_"],
    ),
    "no thrust scale": (("max_thrust_n = 28.0 ", ""), ["no thrust scale", "hover_thrust"]),
    "negative torque": (("[2.0, 2.0, 0.4]", "[2.0, -2.0, 0.4]"), ["torque_scale_n_m", "above 0"]),
    "two torques": (("[2.0, 2.0, 0.4]", "[2.0, 2.0]"), ["torque_scale_n_m", "three numbers"]),
    "system out of range": (("system_id = 0 ", "system_id = 255 "), ["system_id = 255", "0 to 254"]),
    "empty name": (('"sim quadrotor"', '""'), ["name = ''", "1 to 40 characters"]),
    "missing key": (('name = "sim quadrotor"', ""), ["name is missing", "1 to 40 characters"]),
    "not TOML": (("[loss]", "[loss"), ["not a TOML file"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_file_is_refused(case: str, tmp_path: Path) -> None:
    change, words = REFUSED[case]
    text = refusal(write(tmp_path, change))
    for word in words:
        assert word in text


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "none.toml")


def test_an_unknown_simulation_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"--sim zeppelin: .*quadrotor"):
        simulated_vehicle("zeppelin")
