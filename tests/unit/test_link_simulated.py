"""The link and the simulated vehicle's own MAVLink face, with no socket between them: two codecs that share no code."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import pytest

from gcs.mavlink.link import Link, LinkConfig
from gcs.mavlink.link_events import NotGranted, VehicleFound
from models.samples import (
    AutopilotAttitudeSample,
    CommandAckSample,
    GnssSample,
    HeartbeatSample,
    HomeSample,
    ImuSample,
    PoseSample,
)
from models.setpoints import AttitudeSetpoint
from sitl.simulation import Simulation, SimulationConfig

HIGHRES_IMU, ATTITUDE_QUATERNION, GPS_RAW_INT, LOCAL_POSITION_NED = 105, 31, 24, 32
STEP_US = 4000
ARM = 400


def run(link: Link, simulation: Simulation, duration_s: float) -> list[Any]:
    """Advance both in lockstep; the ground's clock is the time granted."""
    samples: list[Any] = []
    for _ in range(round(duration_s * 1e6 / STEP_US)):
        until_us = simulation.time_us + STEP_US
        for packet in simulation.advance(until_us):
            samples += link.receive(packet.data, until_us * 1e-6)
        for raw in link.poll(until_us * 1e-6):
            simulation.receive(0, raw)
    return samples


def of(samples: list[Any], kind: type) -> list[Any]:
    return [sample for sample in samples if isinstance(sample, kind)]


@pytest.fixture(scope="module")
def session() -> tuple[Link, Simulation, list[Any]]:
    rates_hz = {HIGHRES_IMU: 250.0, ATTITUDE_QUATERNION: 50.0, LOCAL_POSITION_NED: 25.0, GPS_RAW_INT: 5.0}
    link = Link(LinkConfig(rates_hz=rates_hz, clock_rate=1.0))
    simulation = Simulation(SimulationConfig(seed=1, position="both"))
    return link, simulation, run(link, simulation, 6.0)


def test_vehicle_is_found_and_grants_every_rate(session: tuple[Link, Simulation, list[Any]]) -> None:
    link, _, samples = session
    events = link.take_events()
    assert [type(event) for event in events] == [VehicleFound]
    assert not any(isinstance(event, NotGranted) for event in events)
    assert link.negotiated
    assert link.autopilot_version is not None
    status = link.status(6.0)
    assert status.rates_hz["HIGHRES_IMU"] == pytest.approx(250.0, rel=0.02)
    assert status.rates_hz["ATTITUDE_QUATERNION"] == pytest.approx(50.0, rel=0.05)
    assert status.rates_hz["LOCAL_POSITION_NED"] == pytest.approx(25.0, rel=0.05)
    assert status.received_fraction == 1.0
    assert math.isfinite(status.round_trip_s)
    assert link.telemetry.bad == Counter()
    assert {sample.mode for sample in of(samples, HeartbeatSample)} <= {"LOITER", "MANUAL", "POSCTL", "ALTCTL"}


def test_samples_at_rest_are_those_of_a_vehicle_at_home(session: tuple[Link, Simulation, list[Any]]) -> None:
    _, _, samples = session
    imu = of(samples, ImuSample)[-500:]
    down = sum(sample.accel_body_m_s2[2] for sample in imu) / len(imu)
    assert down == pytest.approx(-9.81, abs=0.3)
    (home, *_) = of(samples, HomeSample)
    assert (home.latitude_rad, home.longitude_rad) == pytest.approx(
        (math.radians(47.397742), math.radians(8.545594)), abs=1e-8
    )
    fix = of(samples, GnssSample)[-1]
    assert fix.latitude_rad == pytest.approx(home.latitude_rad, abs=2e-6)
    assert fix.height_m == pytest.approx(488.0, abs=10.0)
    pose = of(samples, PoseSample)[-1]
    assert math.dist(pose.position_ned_m, (0.0, 0.0, 0.0)) < 0.5
    attitude = of(samples, AutopilotAttitudeSample)[-1]
    assert abs(attitude.ned_from_body[0]) > 0.99
    assert all(-1e-9 <= sample.arrival_s - sample.time_s < 0.5 for sample in samples)


def test_commands_and_setpoints_are_understood(session: tuple[Link, Simulation, list[Any]]) -> None:
    link, simulation, _ = session
    setpoint = AttitudeSetpoint((1.0, 0.0, 0.0, 0.0), 0.1)
    samples: list[Any] = []
    for step in range(60):
        simulation.receive(0, link.encode_setpoint(setpoint, simulation.time_us * 1e-6))
        if step == 20:
            simulation.receive(0, link.encode_set_mode("OFFBOARD"))
        if step == 30:
            simulation.receive(0, link.encode_command(ARM, (1.0,)))
        samples += run(link, simulation, 0.04)
    assert {(ack.command, ack.result) for ack in of(samples, CommandAckSample)} == {(176, 0), (ARM, 0)}
    beat = of(samples, HeartbeatSample)[-1]
    assert (beat.mode, beat.armed) == ("OFFBOARD", True)
