"""The link against a scripted vehicle that speaks through pymavlink, on a ground clock of our own."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.link import Link, LinkConfig, NoVehicleError
from gcs.mavlink.link_events import (
    AutopilotChanged,
    BytesDiscarded,
    IdentityClash,
    NotGranted,
    VehicleFound,
    VehicleLost,
    VehicleRebooted,
    VehicleReturned,
)
from gcs.mavlink.modes import ModeError
from models.samples import CommandAckSample, HeartbeatSample, HomeSample, ImuSample, PoseSample
from models.setpoints import (
    ActuatorSetpoint,
    AttitudeSetpoint,
    PositionSetpoint,
    RatesSetpoint,
    VelocitySetpoint,
)

HIGHRES_IMU, ATTITUDE = 105, 30
GROUND_S = 5000.0
STEP_S = 0.01


class Vehicle:
    """A vehicle that sends on its own clock, answers as told, and reads what it is sent."""

    def __init__(self, autopilot: int = 12, system: int = 1, component: int = 1) -> None:
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.parser = dialect.MAVLink(None)
        self.autopilot = autopilot
        self.received: list[Any] = []

    def pack(self, name: str, *values: Any) -> bytes:
        raw = bytes(getattr(self.mav, f"{name}_encode")(*values).pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) & 0xFF
        return raw

    def heartbeat(self, base_mode: int = 81, custom_mode: int = 0, kind: int = 2) -> bytes:
        return self.pack("heartbeat", kind, self.autopilot, base_mode, custom_mode, 3, 3)

    def attitude(self, time_s: float) -> bytes:
        return self.pack("attitude", round(time_s * 1e3), 0, 0, 0, 0, 0, 0)

    def imu(self, time_s: float) -> bytes:
        return self.pack("highres_imu", round(time_s * 1e6), 0, 0, -9.8, *[0.0] * 10, 0x3F)

    def take(self, packets: list[bytes]) -> list[Any]:
        messages = [message for packet in packets for message in self.parser.parse_buffer(packet)]
        self.received += messages
        return messages

    def named(self, name: str) -> list[Any]:
        return [message for message in self.received if message.get_type() == name]


def fly(
    link: Link,
    vehicle: Vehicle,
    duration_s: float,
    begin_s: float = GROUND_S,
    boot_s: float = 100.0,
    answer: Callable[[Any, float], list[bytes]] | None = None,
    beats: bool = True,
) -> float:
    """Run vehicle and link together at 100 Hz of ground time; returns the ground time at the end."""
    steps = round(duration_s / STEP_S)
    for step in range(steps):
        ground_s = begin_s + step * STEP_S
        stamp_s = boot_s + step * STEP_S
        if beats and step % 100 == 0:
            link.receive(vehicle.heartbeat(), ground_s)
        if beats:
            link.receive(vehicle.imu(stamp_s), ground_s)
        for message in vehicle.take(link.poll(ground_s)):
            for raw in answer(message, stamp_s) if answer else []:
                link.receive(raw, ground_s)
    return begin_s + steps * STEP_S


def events(link: Link, kind: type) -> list[Any]:
    return [event for event in link.take_events() if isinstance(event, kind)]


def test_locks_to_the_first_autopilot_and_ignores_everyone_else() -> None:
    link = Link()
    station, gimbal, other = Vehicle(8, 255, 190), Vehicle(8, 1, 154), Vehicle(12, 2, 1)
    vehicle = Vehicle()
    assert link.receive(station.pack("heartbeat", 6, 8, 0, 0, 4, 3), GROUND_S) == []
    assert link.receive(gimbal.pack("heartbeat", 26, 8, 0, 0, 4, 3), GROUND_S) == []
    assert link.receive(vehicle.imu(5.0), GROUND_S) == []
    assert link.vehicle is None
    (heartbeat,) = link.receive(vehicle.heartbeat(), GROUND_S)
    assert isinstance(heartbeat, HeartbeatSample)
    assert link.vehicle == (1, 1)
    assert link.receive(other.heartbeat(), GROUND_S) == []
    assert link.receive(other.imu(5.0), GROUND_S) == []
    assert link.foreign == 5
    (found,) = link.take_events()
    assert isinstance(found, VehicleFound)
    assert (found.system, found.component, found.autopilot, found.vehicle_type) == (1, 1, 12, 2)
    (imu,) = link.receive(vehicle.imu(6.0), GROUND_S)
    assert isinstance(imu, ImuSample)


def test_motion_capture_of_component_197_counts_for_the_vehicle() -> None:
    link = Link()
    link.receive(Vehicle().heartbeat(), GROUND_S)
    capture, foreign = Vehicle(8, 1, 197), Vehicle(8, 2, 197)
    pose = ("att_pos_mocap", 1_000_000, [1, 0, 0, 0], 1, 2, 3)
    (sample,) = link.receive(capture.pack(*pose), GROUND_S)
    assert isinstance(sample, PoseSample)
    assert link.receive(foreign.pack(*pose), GROUND_S) == []
    assert link.receive(capture.attitude(1.0), GROUND_S) == []


def test_own_heartbeat_once_a_second_even_without_a_vehicle() -> None:
    link, vehicle = Link(), Vehicle()
    fly(link, vehicle, 5.0, beats=False)
    beats = vehicle.named("HEARTBEAT")
    assert len(beats) == 5
    assert (beats[0].type, beats[0].get_srcSystem(), beats[0].get_srcComponent()) == (6, 255, 191)
    assert {message.get_type() for message in vehicle.received} == {"HEARTBEAT"}


def test_round_trip_and_answer_to_the_vehicles_timesync() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    (request,) = [m for m in vehicle.take(link.poll(GROUND_S)) if m.get_type() == "TIMESYNC"]
    assert (request.tc1, request.ts1) == (0, round(GROUND_S * 1e9))
    link.receive(vehicle.pack("timesync", 123_000_000, request.ts1), GROUND_S + 0.035)
    assert link.status(GROUND_S + 0.035).round_trip_s == pytest.approx(0.035, abs=1e-6)
    link.receive(vehicle.pack("timesync", 123_000_000, 42), GROUND_S + 0.5)
    assert link.status(GROUND_S + 0.5).round_trip_s == pytest.approx(0.035, abs=1e-6)
    link.receive(vehicle.pack("timesync", 0, 777), GROUND_S + 0.6)
    (reply,) = [m for m in vehicle.take(link.poll(GROUND_S + 0.6)) if m.get_type() == "TIMESYNC"]
    assert (reply.tc1, reply.ts1) == (round((GROUND_S + 0.6) * 1e9), 777)


def accept(vehicle: Vehicle) -> Callable[[Any, float], list[bytes]]:
    """Grant every rate; give home, origin and version when asked."""

    def answer(message: Any, _stamp_s: float) -> list[bytes]:
        if message.get_type() != "COMMAND_LONG":
            return []
        packets = [vehicle.pack("command_ack", message.command, 0, 0, 0, 255, 191)]
        if message.command == 512:
            packets.append(
                {
                    242: lambda: vehicle.pack("home_position", 1, 2, 3, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0, 1),
                    49: lambda: vehicle.pack("gps_global_origin", 1, 2, 3, 1),
                    148: lambda: vehicle.pack("autopilot_version", 7, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 99),
                }[int(message.param1)]()
            )
        return packets

    return answer


def test_asks_for_rates_and_messages_once_when_all_are_granted() -> None:
    link, vehicle = Link(LinkConfig(rates_hz={HIGHRES_IMU: 100.0, ATTITUDE: 0.0})), Vehicle()
    fly(link, vehicle, 3.0, answer=accept(vehicle))
    asked = [(m.command, m.param1, m.param2) for m in vehicle.named("COMMAND_LONG")]
    assert asked == [(511, 105.0, 10_000.0), (511, 30.0, -1.0), (512, 242.0, 0.0), (512, 49.0, 0.0), (512, 148.0, 0.0)]
    assert link.negotiated
    assert link.autopilot_version is not None
    assert (link.autopilot_version.capabilities, link.autopilot_version.uid) == (7, 99)
    assert events(link, NotGranted) == []


def test_one_question_at_a_time_and_a_lost_answer_is_asked_again() -> None:
    link, vehicle = Link(LinkConfig(rates_hz={ATTITUDE: 50.0}, requests=())), Vehicle()
    calls = []

    def forgetful(message: Any, stamp_s: float) -> list[bytes]:
        if message.get_type() != "COMMAND_LONG":
            return []
        calls.append(stamp_s)
        return accept(vehicle)(message, stamp_s) if len(calls) == 3 else []

    fly(link, vehicle, 10.0, answer=forgetful)
    assert len(calls) == 3
    assert all(later - sooner >= 0.49 for sooner, later in pairwise(calls))
    assert link.negotiated


def test_a_rate_that_is_seen_needs_no_answer() -> None:
    link, vehicle = Link(LinkConfig(rates_hz={HIGHRES_IMU: 100.0}, requests=())), Vehicle()
    fly(link, vehicle, 6.0)
    assert len(vehicle.named("COMMAND_LONG")) <= 3
    assert link.negotiated
    assert events(link, NotGranted) == []


def test_gives_up_politely_when_never_answered_and_at_once_when_denied() -> None:
    silent, vehicle = Link(LinkConfig(rates_hz={ATTITUDE: 50.0}, requests=())), Vehicle()
    fly(silent, vehicle, 30.0)
    assert len(vehicle.named("COMMAND_LONG")) == 5
    (refusal,) = events(silent, NotGranted)
    assert (refusal.message, refusal.rate_hz, refusal.reason) == ("ATTITUDE", 50.0, "no answer")
    denying, vehicle = Link(LinkConfig(rates_hz={ATTITUDE: 50.0}, requests=())), Vehicle()
    fly(
        denying,
        vehicle,
        5.0,
        answer=lambda m, _: [vehicle.pack("command_ack", 511, 3)] if m.get_type() == "COMMAND_LONG" else [],
    )
    assert len(vehicle.named("COMMAND_LONG")) == 1
    (refusal,) = events(denying, NotGranted)
    assert refusal.reason == "unsupported"


def test_home_that_is_not_known_yet_is_asked_for_slowly_until_it_comes() -> None:
    link, vehicle = Link(LinkConfig(requests=(242,))), Vehicle()

    def later(message: Any, stamp_s: float) -> list[bytes]:
        if message.get_type() == "COMMAND_LONG" and stamp_s < 112.0:
            return [vehicle.pack("command_ack", 512, 4)]
        return accept(vehicle)(message, stamp_s)

    fly(link, vehicle, 20.0, answer=later)
    assert len(vehicle.named("COMMAND_LONG")) == 4
    assert link.negotiated


def test_answers_to_other_stations_are_not_ours() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    assert link.receive(vehicle.pack("command_ack", 400, 0, 0, 0, 245, 190), GROUND_S) == []
    (ours,) = link.receive(vehicle.pack("command_ack", 400, 0, 0, 0, 255, 191), GROUND_S)
    (broadcast,) = link.receive(vehicle.pack("command_ack", 400, 2), GROUND_S)
    assert isinstance(ours, CommandAckSample)
    assert broadcast.result == 2


def test_silence_is_a_loss_after_three_vehicle_seconds_and_the_return_is_told() -> None:
    link, vehicle = Link(), Vehicle()
    end_s = fly(link, vehicle, 2.0)
    assert link.alive
    quiet_s = fly(link, vehicle, 4.0, begin_s=end_s, beats=False)
    (lost,) = events(link, VehicleLost)
    assert 3.0 < lost.age_s < 3.1
    assert not link.alive
    assert link.vehicle_time_s(quiet_s) == pytest.approx(106.0, abs=0.05)
    link.receive(vehicle.heartbeat(), quiet_s)
    assert link.alive
    assert len(events(link, VehicleReturned)) == 1


def test_only_its_own_heartbeat_keeps_a_vehicle_alive() -> None:
    link, vehicle = Link(), Vehicle()
    other, component = Vehicle(12, 2, 1), Vehicle(8, 1, 191)
    link.receive(vehicle.heartbeat(), GROUND_S)
    for step in range(50):
        link.receive(other.heartbeat() + component.heartbeat() + vehicle.imu(1.0 + step * 0.1), GROUND_S + step * 0.1)
        link.poll(GROUND_S + step * 0.1)
    assert not link.alive


def test_reboot_is_told_and_everything_asked_again() -> None:
    link, vehicle = Link(LinkConfig(rates_hz={HIGHRES_IMU: 100.0})), Vehicle()
    end_s = fly(link, vehicle, 3.0, answer=accept(vehicle))
    asked = len(vehicle.named("COMMAND_LONG"))
    assert link.negotiated
    fly(link, vehicle, 3.0, begin_s=end_s, boot_s=0.5, answer=accept(vehicle))
    (reboot,) = events(link, VehicleRebooted)
    assert reboot.before_s == pytest.approx(102.99)
    assert reboot.time_s == pytest.approx(0.5)
    assert len(vehicle.named("COMMAND_LONG")) == 2 * asked
    assert link.vehicle_time_s(end_s + 3.0) == pytest.approx(3.5, abs=0.02)


def test_another_autopilot_behind_the_same_id_is_told() -> None:
    link = Link()
    link.receive(Vehicle(12).heartbeat(), GROUND_S)
    link.receive(Vehicle(3).heartbeat(), GROUND_S + 1.0)
    (changed,) = events(link, AutopilotChanged)
    assert changed.autopilot == 3


def test_somebody_with_our_id_is_told_once() -> None:
    link, twin = Link(), Vehicle(8, 255, 191)
    for _ in range(3):
        link.receive(twin.pack("heartbeat", 6, 8, 0, 0, 4, 3), GROUND_S)
    assert len(events(link, IdentityClash)) == 1


def test_status_counts_rates_and_loss() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    for step in range(301):
        ground_s = GROUND_S + step * STEP_S
        raw = vehicle.imu(100.0 + step * STEP_S)
        if step % 4:
            link.receive(raw, ground_s)
        if step % 50 == 0:
            link.receive(vehicle.heartbeat(), ground_s)
        link.poll(ground_s)
    status = link.status(GROUND_S + 3.0)
    assert status.alive
    assert status.received_fraction == pytest.approx(0.75, abs=0.02)
    assert status.rates_hz["HIGHRES_IMU"] == pytest.approx(75.0, rel=0.05)
    assert status.messages_per_s == pytest.approx(77.0, rel=0.05)
    assert status.heartbeat_age_s == pytest.approx(0.0, abs=0.02)
    assert (status.bad_bytes, status.bad_checksums) == (0, 0)


def test_bad_bytes_are_an_event_at_most_once_a_second() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    link.take_events()
    for step in range(150):
        link.receive(b"\x00\x01\x02", GROUND_S + step * STEP_S)
        link.poll(GROUND_S + step * STEP_S)
    discarded = events(link, BytesDiscarded)
    assert len(discarded) == 2
    assert discarded[0].bad_bytes == 3
    assert discarded[1].bad_bytes == 300


@pytest.mark.parametrize("speed", [1.0, 20.0, 0.25])
def test_vehicle_clock_follows_a_simulation_at_any_speed_and_runs_on_in_silence(speed: float) -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    for step in range(401):
        ground_s = GROUND_S + step * STEP_S
        link.receive(vehicle.imu(10.0 + step * STEP_S * speed), ground_s)
    assert link.clock.rate == pytest.approx(speed, rel=0.01)
    assert link.vehicle_time_s(ground_s + 0.5) == pytest.approx(10.0 + 4.5 * speed, rel=0.01)


def test_late_messages_do_not_pull_the_clock_back() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    delays_s = (0.0, 0.03, 0.01, 0.05, 0.02)
    arrivals = []
    for step in range(2000):
        ground_s = GROUND_S + step * STEP_S
        for sample in link.receive(vehicle.imu(10.0 + step * STEP_S - delays_s[step % 5]), ground_s):
            arrivals.append(sample.arrival_s)
            assert sample.arrival_s - sample.time_s == pytest.approx(delays_s[step % 5], abs=1e-3)
    assert arrivals == sorted(arrivals)
    assert len(arrivals) == 2000


def test_paused_simulation_is_neither_reboot_nor_delay() -> None:
    link, vehicle = Link(), Vehicle()
    end_s = fly(link, vehicle, 3.0)
    fly(link, vehicle, 3.0, begin_s=end_s + 20.0, boot_s=103.0)
    assert events(link, VehicleRebooted) == []
    assert link.vehicle_time_s(end_s + 23.0) == pytest.approx(106.0, abs=0.05)


def test_setpoints_carry_the_masks_of_the_ladder() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    packets = [
        link.encode_setpoint(setpoint, 12.5)
        for setpoint in (
            PositionSetpoint((1.0, 2.0, -3.0), (0.5, 0.0, 0.0), (0.0, 0.25, 0.0), 0.5),
            VelocitySetpoint((1.0, -2.0, 0.5), 0.25),
            AttitudeSetpoint((0.5, 0.5, 0.5, 0.5), 0.75),
            RatesSetpoint((0.5, -0.5, 0.25), 0.5),
            ActuatorSetpoint((0.5, -0.5, 0.25, 0.75)),
        )
    ]
    position, velocity, attitude, rates, actuator = vehicle.take(packets)
    assert (position.type_mask, position.x, position.vx, position.afy, position.yaw) == (2048, 1.0, 0.5, 0.25, 0.5)
    assert (velocity.type_mask, velocity.vy, velocity.yaw, velocity.coordinate_frame) == (2503, -2.0, 0.25, 1)
    assert (attitude.type_mask, list(attitude.q), attitude.thrust) == (7, [0.5] * 4, 0.75)
    assert (rates.type_mask, rates.body_pitch_rate, rates.thrust) == (128, -0.5, 0.5)
    assert list(actuator.controls)[:4] == [0.5, -0.5, 0.25, 0.75]
    assert actuator.time_usec == 12_500_000
    for message in (position, velocity, attitude, rates):
        assert message.time_boot_ms == 12_500
    for message in (position, velocity, attitude, rates, actuator):
        assert (message.target_system, message.target_component) == (1, 1)


@pytest.mark.parametrize(
    ("autopilot", "name", "parameters"),
    [(12, "OFFBOARD", (129, 6, 0)), (12, "LAND", (129, 4, 6)), (3, "GUIDED", (129, 4, 0)), (3, "RTL", (129, 6, 0))],
)
def test_modes_by_name(autopilot: int, name: str, parameters: tuple[int, int, int]) -> None:
    link, vehicle = Link(), Vehicle(autopilot)
    link.receive(vehicle.heartbeat(base_mode=209), GROUND_S)
    (command,) = vehicle.take([link.encode_set_mode(name)])
    assert (command.command, command.param1, command.param2, command.param3) == (176, *parameters)
    with pytest.raises(ModeError, match=r"'WARP'.*LAND"):
        link.encode_set_mode("WARP")


def test_commands_and_other_messages() -> None:
    link, vehicle = Link(), Vehicle()
    with pytest.raises(NoVehicleError):
        link.encode_command(400, (1.0,))
    link.receive(vehicle.heartbeat(), GROUND_S)
    (command,) = vehicle.take([link.encode_command(400, (1.0,))])
    assert (command.command, command.param1, command.param2, command.target_system) == (400, 1.0, 0.0, 1)
    (request,) = vehicle.take([link.encode_any(dialect.MAVLink_param_request_list_message(1, 1))])
    assert request.get_type() == "PARAM_REQUEST_LIST"


def test_packets_of_both_directions_for_the_log() -> None:
    link, vehicle = Link(LinkConfig(keep_packets=True, packet_memory=4)), Vehicle()
    beat = vehicle.heartbeat()
    link.receive(beat[:7], GROUND_S)
    link.receive(beat[7:], GROUND_S)
    sent = link.poll(GROUND_S)
    packets = link.take_packets()
    assert [(packet.inbound, packet.raw) for packet in packets] == [(True, beat), *[(False, raw) for raw in sent]]
    assert link.take_packets() == []
    for _ in range(6):
        link.receive(vehicle.heartbeat(), GROUND_S)
    assert len(link.take_packets()) == 4
    assert link.packets_forgotten == 2
    silent = Link()
    silent.receive(beat, GROUND_S)
    assert silent.take_packets() == []


def test_home_goes_on_to_the_samples() -> None:
    link, vehicle = Link(), Vehicle()
    link.receive(vehicle.heartbeat(), GROUND_S)
    raw = vehicle.pack("home_position", 473977420, 85455940, 488000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0, 1)
    (home,) = link.receive(raw, GROUND_S)
    assert isinstance(home, HomeSample)
