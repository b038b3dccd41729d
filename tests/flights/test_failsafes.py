"""What can go wrong in flight, each against its row of the mode table, flown in lockstep."""

from __future__ import annotations

import numpy as np

from gcs import commands as c
from gcs.offboard.modes import State
from gcs.offboard.permissions import LEASE_TIMEOUT_S
from gcs.offboard.trajectories import Circle, GoTo
from sitl.simulation import Simulation, SimulationConfig
from tests.flights.station_rig import OPERATOR, Rig


def flying(seed: int = 11) -> Rig:
    rig = Rig(SimulationConfig(seed=seed, position="mocap"))
    rig.take_off()
    rig.into_offboard()
    rig.run(2.0)
    return rig


def test_position_lost_degrades_and_lands() -> None:
    rig = flying()
    rig.order(c.FlyTrajectory(Circle()))
    rig.run(5.0)
    rig.simulation.sensors.mocap.enabled = False
    lost_s = rig.flight.time_s
    rig.flight.run_until(lambda s: s.state.state is State.DEGRADED, 1.0, "degraded")
    assert rig.flight.time_s - lost_s < 0.25
    assert rig.station.state.ladder is None
    assert rig.station.state.failsafe == "Position lost: landing"
    rig.flight.run_until(lambda s: not s.state.view.armed, 30.0, "landed")
    assert rig.said("Position lost")


def test_a_pilot_who_takes_over_keeps_the_vehicle() -> None:
    rig = flying()
    rig.vehicle.send(rig.station.link.encode_set_mode("LOITER"))
    rig.flight.run_until(lambda s: s.state.state is State.RELEASED, 3.0, "released")
    rig.run(5.0)
    assert rig.state is State.RELEASED
    assert rig.station.state.view.mode == "LOITER"
    rig.into_offboard()


def test_a_dead_link_is_answered_with_silence_and_the_vehicle_lands_itself() -> None:
    rig = flying()
    rig.vehicle.cut = True
    rig.flight.run_until(lambda s: s.state.state is State.DEGRADED, 1.0, "stale estimate")
    rig.flight.run_until(lambda s: s.state.state is State.DISCONNECTED, 5.0, "link lost")
    rig.flight.run(20.0)
    assert rig.simulation.vehicle.on_ground
    rig.vehicle.cut = False
    rig.flight.run_until(lambda s: s.state.state is State.STANDBY, 5.0, "back in standby")
    assert rig.station.state.state is State.STANDBY


def test_the_offboard_mode_is_refused_without_a_vehicle_in_the_air() -> None:
    rig = Rig()
    assert "No vehicle" in rig.refused(c.Hold())
    rig.flight.run(6.0)
    rig.order(c.TakeControls())
    assert "Take off first" in rig.refused(c.StartOffboard())
    assert "offboard" in rig.refused(c.FlyTrajectory(Circle()))


def test_flight_limits_hold_the_vehicle() -> None:
    rig = flying()
    assert "limit" in rig.refused(c.FlyTrajectory(GoTo(north_m=0.0, east_m=0.0, height_m=80.0)))
    assert "limit" in rig.refused(c.FlyTrajectory(Circle(centre_north_m=150.0)))
    rig.simulation.vehicle.disturbance[2] = -25.0
    rig.flight.run_until(lambda s: s.state.state is State.STANDBY, 20.0, "limit breached")
    rig.simulation.vehicle.disturbance[2] = 0.0
    assert rig.said("limit")
    rig.run(3.0)
    assert rig.station.state.view.mode in ("LOITER", "LAND")


def test_a_silent_holder_loses_the_controls_and_the_vehicle_flies_on() -> None:
    rig = flying()
    rig.flight.run(LEASE_TIMEOUT_S + 0.5)
    assert not rig.station.state.lease.held
    assert rig.state is State.ACTIVE
    assert rig.refused(c.ApplyGains({"attitude.q_roll": 2.0}, "late")) == "Take controls first."
    rig.order(c.Hold())
    assert rig.state is State.STANDBY


def test_release_holds_first() -> None:
    rig = flying()
    rig.order(c.ReleaseControls())
    assert rig.state is State.STANDBY
    rig.run(2.0)
    assert rig.station.state.view.mode == "LOITER"


def test_a_second_operator_may_hold_but_not_steer() -> None:
    rig = flying()
    second = c.Identity(name="operator 2", role="operator", client="other")
    refused = rig.flight.command(c.SelectController("pid"), second)
    assert OPERATOR.name in refused.reason
    assert rig.flight.command(c.Hold(), second).accepted
    assert rig.state is State.STANDBY


def test_a_reboot_of_the_vehicle_starts_everything_anew() -> None:
    rig = flying()
    rig.vehicle.simulation = rig.simulation = Simulation(SimulationConfig(seed=12, position="mocap"))
    rebooted_us = rig.flight.time_us

    class Rebooted:
        def advance(self, until_us: int) -> list[bytes]:
            return [packet.data for packet in rig.simulation.advance(until_us - rebooted_us)]

        def send(self, packet: bytes) -> None:
            rig.simulation.receive(0, packet)

    rig.flight.vehicle = Rebooted()
    rig.flight.run(3.0)
    assert rig.state is State.STANDBY
    assert rig.said("rebooted")
    rig.flight.run(6.0)
    estimate = rig.station.state.estimate
    assert estimate is not None
    assert estimate.position_valid
    assert np.linalg.norm(estimate.position_ned_m) < 0.1


def test_setpoints_carry_the_time_of_their_estimate_and_stop_with_it() -> None:
    rig = flying()
    since = len(rig.frames)
    rig.vehicle.cut = True
    rig.flight.run(2.0)
    sent = [len(frame.packets) for frame in rig.frames[since:]]
    setpoint_ticks = int(np.isfinite(rig.signals("control.thrust", since)[:, 0]).sum())
    assert setpoint_ticks <= 12, "no setpoint may be repeated from an estimate older than 100 ms"
    assert len(sent) >= 190
