"""How the filter starts: level, heading, Earth field, hard iron, origin; on the ground and in motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimators.full_state_ekf import EkfParameters, initial, step
from models.frames import Geodetic, geodetic_from_ned
from models.magnetic_field import earth_field_ned_t
from models.samples import HomeSample, MagnetometerSample
from tests.unit.ekf_rig import HOME, REST, Path, Rig

PARAMS = EkfParameters()
FIELD = earth_field_ned_t(HOME, PARAMS.magnetic_year)


def test_at_rest_attitude_comes_from_gravity_and_the_world_magnetic_model() -> None:
    rig = Rig(REST, seed=1, pose_every=0, gnss_every=20, magnetometer_every=2, field_ned_t=FIELD)
    state = initial(PARAMS)
    for _, samples in rig.run(10.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    error = np.degrees(np.abs(rig.error(output.estimate)[6:9]))
    # Two degrees of tilt are the accelerometer bias it cannot yet tell; heading is from true north.
    assert np.all(error[:2] < 2.0)
    assert error[2] < 1.5


def test_before_a_fix_there_is_an_attitude_from_magnetic_north_then_a_reported_turn_to_true_north() -> None:
    rig = Rig(REST, seed=2, pose_every=0, magnetometer_every=2, field_ned_t=FIELD)
    state = initial(PARAMS)
    for _, samples in rig.run(5.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    assert output.estimate.attitude_valid
    assert not output.estimate.position_valid
    declination = math.atan2(FIELD[1], FIELD[0])
    assert output.estimate.euler_rad[2] == pytest.approx(-declination, abs=0.02)
    t, samples = rig.step()
    state, output = step(state, [*samples, rig.gnss(t)], params=PARAMS)
    turns = [reset for reset in output.resets if reset.source == "magnetometer"]
    # One reading sets the heading at once (.4 uT of noise on 21 uT); the next ones settle it.
    assert turns[0].yaw_delta_rad == pytest.approx(declination, abs=0.06)
    rig.gnss_every = 10
    for _, samples in rig.run(5.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    assert output.estimate.euler_rad[2] == pytest.approx(0.0, abs=0.02)
    assert output.estimate.position_valid


def test_declination_can_be_given() -> None:
    params = EkfParameters(declination_rad=0.2)
    rig = Rig(REST, seed=2, pose_every=0, magnetometer_every=2, field_ned_t=FIELD)
    state = initial(params)
    for _, samples in rig.run(3.0):
        state, output = step(state, samples, params=params)
    assert output.estimate is not None
    assert output.estimate.euler_rad[2] == pytest.approx(0.2 - math.atan2(FIELD[1], FIELD[0]), abs=0.02)


def test_without_any_heading_there_is_no_estimate() -> None:
    rig = Rig(REST, seed=3, pose_every=0)
    state = initial(PARAMS)
    for _, samples in rig.run(5.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is None
    assert len(state.queue) < 200


def test_start_in_motion_converges() -> None:
    path = Path(amplitude_m=(40.0, 40.0, 2.0), frequency_rad_s=(0.5, 0.5, 0.3), amplitude_rad=(0.4, 0.2, 1.5))
    rig = Rig(path, seed=4, pose_every=0, gnss_every=10, magnetometer_every=5, field_ned_t=FIELD, gnss_std_m=0.3)
    state = initial(PARAMS)
    for _, samples in rig.run(40.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    error = rig.error(output.estimate)
    assert np.all(np.degrees(np.abs(error[6:9])) < 2.0)


def test_hard_iron_is_learnt_in_flight() -> None:
    path = Path(amplitude_m=(10.0, 10.0, 2.0), frequency_rad_s=(0.5, 0.4, 0.3), amplitude_rad=(0.3, 0.2, 2.5))
    iron = (-0.2e-6, -3.5e-6, 1.0e-6)
    params = EkfParameters(magnetic_bias_std_t=4e-6)
    rig = Rig(
        path,
        seed=5,
        pose_every=0,
        gnss_every=10,
        magnetometer_every=5,
        field_ned_t=FIELD,
        hard_iron_t=iron,
        gnss_std_m=0.3,
    )
    state = initial(params)
    for _, samples in rig.run(60.0):
        state, output = step(state, samples, params=params)
    assert state.nominal[21:24] == pytest.approx(iron, abs=0.4e-6)
    assert output.estimate is not None
    assert abs(math.degrees(rig.error(output.estimate)[8])) < 1.0


def test_the_vehicles_origin_replaces_the_first_fix_without_moving_the_vehicle() -> None:
    rig = Rig(REST, seed=6, pose_every=0, gnss_every=10, magnetometer_every=2, gnss_std_m=0.1)
    state = initial(PARAMS)
    for _, samples in rig.run(5.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    assert state.origin is not None
    there = geodetic_from_ned(output.estimate.position_ned_m, state.origin)
    state, output = step(state, [rig.origin()], params=PARAMS)
    moves = [reset for reset in output.resets if reset.source == "origin"]
    assert len(moves) == 1
    assert state.origin == HOME
    assert output.estimate is not None
    here = geodetic_from_ned(output.estimate.position_ned_m, HOME)
    assert here.latitude_rad == pytest.approx(there.latitude_rad, abs=1e-10)
    assert here.height_m == pytest.approx(there.height_m, abs=1e-6)


def test_home_tells_the_origin_where_the_vehicle_does_not() -> None:
    state = initial(PARAMS)
    place = geodetic_from_ned((10.0, -4.0, -2.0), HOME)
    home = HomeSample(
        time_s=1.0,
        arrival_s=1.0,
        latitude_rad=place.latitude_rad,
        longitude_rad=place.longitude_rad,
        height_m=place.height_m,
        position_ned_m=(10.0, -4.0, -2.0),
    )
    state, _ = step(state, [home], params=PARAMS)
    assert state.origin is not None
    assert state.origin == pytest.approx(Geodetic(*HOME), rel=1e-9)


def test_a_magnet_beside_the_vehicle_is_rejected_then_forgiven() -> None:
    rig = Rig(REST, seed=7, pose_every=0, gnss_every=10, magnetometer_every=5, field_ned_t=FIELD)
    state = initial(PARAMS)
    for _, samples in rig.run(10.0):
        state, output = step(state, samples, params=PARAMS)
    assert output.estimate is not None
    yaw = output.estimate.euler_rad[2]
    for _, samples in rig.run(0.04):
        state, _ = step(state, samples[:1], params=PARAMS)
    t, samples = rig.step()
    state, output = step(
        state,
        [samples[0], MagnetometerSample(time_s=t, arrival_s=t, field_body_t=(-1e-4, 2e-4, 0.0))],
        params=PARAMS,
    )
    assert [update.accepted for update in output.innovations if update.source == "magnetometer"] == [False]
    assert output.estimate is not None
    assert output.estimate.euler_rad[2] == pytest.approx(yaw, abs=0.01)
