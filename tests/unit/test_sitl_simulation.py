"""The simulation core: determinism, modes, refusals, failsafes in vehicle time, every kind of setpoint."""

from __future__ import annotations

import itertools
import math

import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as dialect

from models.frames import euler_from_quaternion, quaternion_from_euler
from sitl.simulation import Simulation, SimulationConfig
from sitl.wind import Wind
from tests.unit.sitl_rig import (
    ARM,
    INTERVAL,
    LAND,
    REQUEST,
    TAKEOFF,
    Station,
    actuator_target,
    attitude_target,
    hover_thrust,
    local_target,
    rates_target,
)

GUSTY = Wind((2.0, -1.0, 0.0), 0.8)


def flight_bytes(seed: int) -> bytes:
    station = Station(seed=seed, position="both", wind=GUSTY)
    station.fly()
    station.offboard(lambda: attitude_target(hover_thrust(station.simulation)), 2.0)
    return bytes(station.data)


def test_same_seed_same_bytes_and_another_seed_others():
    first = flight_bytes(5)
    assert first == flight_bytes(5)
    assert first != flight_bytes(6)


def test_flight_does_not_depend_on_how_time_is_granted():
    def run(step_us: int) -> bytes:
        simulation = Simulation(SimulationConfig(seed=4, position="both", wind=GUSTY))
        data = b""
        for until_us in range(step_us, 2_000_001, step_us):
            data += b"".join(packet.data for packet in simulation.advance(until_us))
        return data

    assert run(10_000) == run(2_000_000) == run(5_000)


def test_truth_does_not_depend_on_which_messages_are_asked_for():
    def run(rate_us: float) -> list[float]:
        station = Station(seed=4, wind=GUSTY)
        station.command(INTERVAL, 105, rate_us)
        station.fly()
        return station.state.tolist()

    assert run(4000) == run(-1)


def test_unknown_position_source_is_refused():
    with pytest.raises(ValueError, match="gnss, mocap, both"):
        SimulationConfig(position="radar")


# Arming and modes


def test_take_off_hold_and_land():
    station = Station(wind=GUSTY)
    station.fly()
    assert -station.state[2] == pytest.approx(2.5, abs=0.5)
    station.run(5.0)
    assert math.hypot(station.state[0], station.state[1]) < 1.0
    assert station.command(LAND) == 0
    station.run(14.0)
    assert not station.simulation.autopilot.armed
    assert station.state[2] == 0.0
    assert {m.landed_state for m in station.all("EXTENDED_SYS_STATE")} == {1, 2, 3, 4}
    assert "Disarmed by landing" in station.texts()


def test_take_off_refused_while_disarmed():
    station = Station()
    assert station.command(TAKEOFF) == 1
    assert station.texts() == ["Takeoff denied: disarmed"]


def test_offboard_refused_without_setpoints_and_below_two_hertz():
    station = Station()
    station.run(0.5)
    assert station.mode(6) == 1
    station.run(4.0, lambda: station.send(attitude_target(0.0)), period_s=0.6)
    assert station.mode(6) == 1
    assert station.texts() == ["Offboard denied: no setpoints above 2 Hz"] * 2
    station.run(1.0, lambda: station.send(attitude_target(0.0)), period_s=0.3)
    assert station.mode(6) == 0


def test_arming_refusals_name_their_reason():
    station = Station()
    station.run(1.0)
    station.mode(4, 6)
    assert station.command(ARM, 1, 0) == 1
    assert "LAND" in station.texts()[-1]
    station.mode(4, 3)
    station.state[6:10] = quaternion_from_euler(1.3, 0.0, 0.0)
    station.run(0.01)
    assert station.command(ARM, 1, 0) == 1
    assert station.texts()[-1] == "Arming denied: vehicle is not level"
    assert station.command(ARM, 1, 21196) == 0


def test_disarming_in_the_air_needs_force():
    station = Station()
    station.fly()
    assert station.command(ARM, 0, 0) == 1
    assert station.texts()[-1] == "Disarming denied: not landed"
    assert station.command(ARM, 0, 21196) == 0
    station.run(0.5)
    assert_allclose(station.simulation.vehicle.rotor_command_rad_s, 0.0)


def test_disarms_by_itself_when_nobody_takes_off():
    station = Station()
    station.run(0.1)
    station.command(ARM, 1, 0)
    station.run(9.0)
    assert station.simulation.autopilot.armed
    station.run(1.5)
    assert not station.simulation.autopilot.armed


def test_mission_refused_without_mission_and_unknown_command_unsupported():
    station = Station()
    station.run(0.1)
    assert station.mode(4, 4) == 1
    assert station.mode(9, 0) == 2
    assert station.command(31010) == 3
    assert station.command(INTERVAL, 12345, 1000) == 3


# Offboard


def test_position_setpoint_with_yaw():
    station = Station()
    station.fly()
    station.offboard(lambda: local_target(2552, x=2.0, y=-1.0, z=-4.0, yaw=0.8), 10.0)
    assert_allclose(station.state[:3], [2.0, -1.0, -4.0], atol=0.6)
    assert euler_from_quaternion(station.state[6:10])[2] == pytest.approx(0.8, abs=0.05)


def test_velocity_setpoint():
    station = Station(position="mocap")
    station.fly()
    station.offboard(lambda: local_target(2503, vx=1.0, vy=0.5, vz=-0.2), 6.0)
    assert_allclose(station.state[3:6], [1.0, 0.5, -0.2], atol=0.06)


def test_body_velocity_setpoint_turns_with_the_heading():
    station = Station(position="mocap", yaw_rad=math.pi / 2)
    station.fly()
    station.offboard(lambda: local_target(1479, frame=8, vx=1.0, yaw_rate=0.0), 5.0)
    assert_allclose(station.state[3:6], [0.0, 1.0, 0.0], atol=0.06)


def test_acceleration_setpoint():
    station = Station(position="mocap")
    station.fly()
    station.offboard(lambda: local_target(3135, afx=1.0, afz=-0.3), 2.0)
    assert station.state[3] == pytest.approx(1.5, abs=0.5)
    assert station.state[5] < -0.3


def test_position_with_feed_forward_leaves_no_lag():
    """Position, velocity and acceleration together, as our station sends them: a ramp is followed without lag."""
    station = Station(position="mocap")
    station.fly()
    start = station.time_s

    def ramp():
        return local_target(2048, x=0.5 * (station.time_s - start), vx=0.5, z=-2.5)

    station.offboard(ramp, 8.0)
    assert station.state[0] == pytest.approx(0.5 * (station.time_s - start), abs=0.05)


def test_attitude_setpoint():
    station = Station(position="mocap")
    station.fly()
    wanted = (0.1, -0.15, 0.4)
    thrust = hover_thrust(station.simulation)
    station.offboard(lambda: attitude_target(thrust, tuple(quaternion_from_euler(*wanted))), 2.0)
    assert_allclose(euler_from_quaternion(station.state[6:10]), wanted, atol=0.05)


def test_rates_setpoint():
    station = Station(position="mocap")
    station.fly()
    station.offboard(lambda: rates_target(hover_thrust(station.simulation), (0.0, 0.0, 0.5)), 1.5)
    assert station.state[12] == pytest.approx(0.5, abs=0.03)


def test_actuator_setpoint_goes_straight_to_the_mixer():
    station = Station(position="mocap")
    station.fly()
    vehicle = station.simulation.vehicle
    thrust = hover_thrust(station.simulation)
    station.offboard(lambda: actuator_target(0.0, 0.0, 0.1, thrust), 0.3, period_s=0.01)
    forces = vehicle.parameters.rotor_force_coefficient_n_s2 * vehicle.rotor_command_rad_s**2
    assert forces.sum() == pytest.approx(thrust * 28.0, rel=1e-5)
    yaw = vehicle.parameters.rotor_torque_coefficient_n_m_s2 * vehicle.rotor_command_rad_s**2 @ [1, -1, 1, -1]
    assert yaw == pytest.approx(0.1 * 0.4, rel=1e-5)


def test_setpoints_with_masks_it_does_not_know_are_left_alone():
    station = Station()
    station.fly()
    for message in (
        local_target(4095),
        local_target(2552, frame=9, x=1.0),
        attitude_target(0.5, (0.0, 0.0, 0.0, 0.0)),
        attitude_target(math.nan),
        rates_target(0.5, (math.nan, 0.0, 0.0)),
    ):
        station.run(0.4, lambda message=message: station.send(message))
        assert station.mode(6) == 1


@pytest.mark.parametrize("gap_s", [0.4, 0.7])
def test_offboard_loss_holds_then_lands_by_vehicle_time(gap_s):
    station = Station()
    station.fly()
    station.offboard(lambda: local_target(2552, z=-2.5), 1.0)
    station.run(gap_s)
    assert station.simulation.autopilot.mode.name == ("OFFBOARD" if gap_s < 0.5 else "LOITER")
    station.run(0.5)
    assert "Offboard control lost: holding" in station.texts()
    assert station.mode(6) == 1
    station.run(4.0)
    assert station.simulation.autopilot.mode.name == "LAND"
    station.run(14.0)
    assert not station.simulation.autopilot.armed
    assert station.simulation.autopilot.landed


def test_parameter_sets_the_loss_time():
    station = Station()
    station.fly()
    station.simulation.autopilot.parameters.set("COM_OF_LOSS_T", 2.0)
    station.offboard(lambda: local_target(2552, z=-2.5), 0.5)
    station.run(1.8)
    assert station.simulation.autopilot.mode.name == "OFFBOARD"


def test_moved_sticks_take_over_from_offboard_and_their_loss_holds():
    station = Station()
    station.fly()
    station.offboard(lambda: local_target(2552, z=-2.5), 0.5)

    def sticks(forward: float) -> None:
        station.send(dialect.MAVLink_manual_control_message(1, round(1000 * forward), 0, 500, 0, 0))
        station.send(local_target(2552, z=-2.5))

    station.run(0.3, lambda: sticks(0.1))
    assert station.simulation.autopilot.mode.name == "OFFBOARD"
    station.run(2.0, lambda: sticks(0.8))
    assert station.simulation.autopilot.mode.name == "POSCTL"
    assert station.state[3] > 1.0
    station.run(1.0)
    assert station.simulation.autopilot.mode.name == "LOITER"


# Telemetry


def test_rates_are_honoured_and_stamps_evenly_spaced():
    station = Station()
    station.command(INTERVAL, 105, 4000)
    station.command(INTERVAL, 30, 20_000)
    station.command(INTERVAL, 32, -1)
    station.run(0.1)
    station.received.clear()
    station.run(2.0)
    stamps = [m.time_usec for m in station.all("HIGHRES_IMU")]
    assert {b - a for a, b in itertools.pairwise(stamps)} == {4000}
    assert len(stamps) == 500
    assert len(station.all("ATTITUDE")) == 100
    assert not station.all("LOCAL_POSITION_NED")
    station.command(INTERVAL, 105, 0)
    station.received.clear()
    station.run(1.0)
    assert len(station.all("HIGHRES_IMU")) == 100


def test_imu_samples_add_up_to_the_same_whatever_their_rate():
    """The sensor integrates: the sum of mean rates times interval is the turn, at 50 Hz as at 250."""
    simulation = Simulation(SimulationConfig(seed=2, links=2))
    fast, slow = [dialect.MAVLink(None) for _ in range(2)]
    message = dialect.MAVLink_command_long_message(1, 1, INTERVAL, 0, 105, 20_000, 0, 0, 0, 0, 0)
    simulation.receive(1, message.pack(dialect.MAVLink(None, 255, 190)))
    simulation.receive(
        0,
        dialect.MAVLink_command_long_message(1, 1, INTERVAL, 0, 105, 4000, 0, 0, 0, 0, 0).pack(
            dialect.MAVLink(None, 255, 190)
        ),
    )
    sums = [0.0, 0.0]
    for packet in simulation.advance(2_000_000):
        for m in (fast, slow)[packet.link].parse_buffer(packet.data):
            if m.get_type() == "HIGHRES_IMU":
                sums[packet.link] += m.zacc * (0.004, 0.02)[packet.link]
    assert sums[0] == pytest.approx(sums[1], abs=1e-5)
    assert sums[0] == pytest.approx(-2.0 * 9.80665, abs=0.2)


def test_position_sources_stream_as_configured():
    for position, gnss, mocap in (("gnss", True, False), ("mocap", False, True), ("both", True, True)):
        station = Station(position=position)
        station.run(1.05)
        assert bool(station.all("GPS_RAW_INT")) is gnss
        poses = station.all("VISION_POSITION_ESTIMATE")
        assert bool(poses) is mocap
        assert {m.get_srcComponent() for m in poses} <= {197}


def test_no_truth_unless_asked_for():
    station = Station()
    station.run(2.0)
    assert not station.all("SIM_STATE")
    station.command(INTERVAL, 108, 100_000)
    station.run(1.0)
    assert len(station.all("SIM_STATE")) == 10
    truth = station.all("SIM_STATE")[-1]
    assert truth.zacc == pytest.approx(-9.80665, abs=1e-4)
    assert truth.lat_int == pytest.approx(473977420, abs=2)


def test_every_message_on_request_parses():
    station = Station(position="both")
    station.run(0.5)
    from sitl.telemetry import STREAMS

    for stream in STREAMS:
        station.received.clear()
        result = station.command(REQUEST, stream.message.message_id)
        assert result == (3 if stream.message.name == "HIGHRES_IMU" else 0), stream.message.name
        if result == 0:
            assert station.all(stream.message.name)
    assert station.command(REQUEST, 148) == 0
    version = station.all("AUTOPILOT_VERSION")[-1]
    assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    assert version.uid != 0


def test_damaged_bytes_and_foreign_targets_change_nothing():
    station = Station()
    station.run(0.1)
    station.simulation.receive(0, b"\xfd\x09\x00garbage" * 20)
    good = dialect.MAVLink_command_long_message(7, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
    station.send(good)
    station.run(0.5)
    assert not station.simulation.autopilot.armed
    assert not station.all("COMMAND_ACK")
    assert station.command(ARM, 1, 0) == 0
