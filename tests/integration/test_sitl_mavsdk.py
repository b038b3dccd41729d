"""The real MAVSDK against the simulated vehicle in its own process: discovery to landing, over UDP."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync, ActionError
from mavsdk.asyncio.plugins.mission_raw import MissionItem, MissionRawAsync
from mavsdk.asyncio.plugins.offboard import (
    AccelerationNed,
    ActuatorControl,
    ActuatorControlGroup,
    Attitude,
    AttitudeRate,
    OffboardAsync,
    OffboardError,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.asyncio.plugins.param import ParamAsync, ParamError
from mavsdk.asyncio.plugins.telemetry import FlightMode, LandedState, TelemetryAsync

ROOT = Path(__file__).parents[2]
SPEED = "3"
HOVER = 1.27551 * 9.80665 / 28.0


@contextlib.contextmanager
def vehicle(*options: str) -> Iterator[dict[str, Any]]:
    """A simulated vehicle in its own process; gives its ready line."""
    command = [sys.executable, "-m", "sitl", "--json", *options]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
            process.wait(10)


class Client:
    def __init__(self, system: Any) -> None:
        self.action = ActionAsync(system)
        self.offboard = OffboardAsync(system)
        self.telemetry = TelemetryAsync(system)
        self.param = ParamAsync(system)
        self.mission = MissionRawAsync(system)

    def destroy(self) -> None:
        for plugin in (self.action, self.offboard, self.telemetry, self.param, self.mission):
            plugin.destroy()


@contextlib.asynccontextmanager
async def connected(speed: str = SPEED) -> AsyncIterator[Client]:
    with vehicle("--link", "udpin://127.0.0.1:0", "--speed", speed, "--seed", "3", "--position", "both") as ready:
        configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(configuration) as mavsdk:
            await mavsdk.add_any_connection(ready["links"][0].replace("udpin", "udpout"))
            system = await mavsdk.first_autopilot(timeout_s=20.0)
            assert system is not None
            client = Client(system)
            try:
                yield client
            finally:
                client.destroy()


async def until(stream: AsyncIterator[Any], condition: Callable[[Any], bool], timeout_s: float = 40.0) -> Any:
    """The first value of a stream that meets the condition."""
    seen = None
    try:
        async with asyncio.timeout(timeout_s):
            async for value in stream:
                seen = value
                if condition(value):
                    return value
    except TimeoutError:
        pytest.fail(f"not within {timeout_s} s; last: {seen}")
    return pytest.fail("stream ended")


async def flying(client: Client) -> None:
    telemetry = client.telemetry
    await until(telemetry.subscribe_health_all_ok(), bool)
    # A busy machine may hold MAVSDK up for longer than the half second of vehicle time; not what is tested here.
    await client.param.set_param_float("COM_OF_LOSS_T", 10.0)
    await client.action.arm()
    await client.action.takeoff()
    await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
    await until(telemetry.subscribe_position(), lambda p: abs(p.relative_altitude_m - 2.5) < 0.4)


async def landed(client: Client) -> None:
    await client.action.land()
    await until(client.telemetry.subscribe_landed_state(), lambda s: s == LandedState.ON_GROUND)
    await until(client.telemetry.subscribe_armed(), lambda armed: not armed)


async def test_discovery_telemetry_and_refusals() -> None:
    async with connected() as client:
        telemetry, action = client.telemetry, client.action
        home = await until(telemetry.subscribe_home(), lambda _: True)
        assert home.latitude_deg == pytest.approx(47.397742, abs=1e-6)
        assert home.absolute_altitude_m == pytest.approx(488.0, abs=0.01)
        gps = await until(telemetry.subscribe_raw_gps(), lambda _: True)
        assert gps.longitude_deg == pytest.approx(8.545594, abs=1e-4)
        imu = await until(telemetry.subscribe_imu(), lambda _: True)
        assert imu.acceleration_frd.down_m_s2 == pytest.approx(-9.81, abs=0.6)
        battery = await until(telemetry.subscribe_battery(), lambda _: True)
        assert 15.0 < battery.voltage_v < 17.0
        await telemetry.set_rate_odometry(20.0)
        await until(telemetry.subscribe_odometry(), lambda o: abs(o.position_body.z_m) < 1.0)
        with pytest.raises(ActionError, match="DENIED"):
            await action.takeoff()
        await client.param.set_param_float("MIS_TAKEOFF_ALT", 4.0)
        assert await client.param.get_param_float("MIS_TAKEOFF_ALT") == 4.0
        assert await action.get_takeoff_altitude() == 4.0
        assert await client.param.get_param_int("SYS_AUTOSTART") == 4001
        await client.param.set_param_int("COM_RC_OVERRIDE", 1)
        assert await client.param.get_param_int("COM_RC_OVERRIDE") == 1
        with pytest.raises(ParamError):
            await client.param.get_param_float("NO_SUCH_PARAM")
        with pytest.raises(OffboardError, match="NO_SETPOINT"):
            await client.offboard.start()


async def fly_offboard(client: Client, setpoint: Callable[[], Awaitable[Any]], done: Callable[[Any], bool]) -> None:
    """Offboard with one kind of setpoint until the local state shows what it does; then hold again."""
    await setpoint()
    await client.offboard.start()
    await until(client.telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
    await until(client.telemetry.subscribe_position_velocity_ned(), done)
    await client.action.hold()
    await until(client.telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)


async def test_takes_off_flies_every_offboard_setpoint_and_lands() -> None:
    async with connected() as client:
        await flying(client)
        offboard = client.offboard
        await fly_offboard(
            client,
            lambda: offboard.set_position_ned(PositionNedYaw(2.0, 1.0, -3.0, 30.0)),
            lambda s: abs(s.position.north_m - 2.0) < 0.3 and abs(s.position.east_m - 1.0) < 0.3,
        )
        await fly_offboard(
            client,
            lambda: offboard.set_velocity_ned(VelocityNedYaw(0.0, 1.0, -0.3, 0.0)),
            lambda s: abs(s.velocity.east_m_s - 1.0) < 0.2,
        )
        await fly_offboard(
            client,
            lambda: offboard.set_velocity_body(VelocityBodyYawspeed(0.8, 0.0, 0.0, 10.0)),
            lambda s: abs(s.velocity.north_m_s**2 + s.velocity.east_m_s**2 - 0.64) < 0.2,
        )
        await fly_offboard(
            client,
            lambda: offboard.set_acceleration_ned(AccelerationNed(-0.8, 0.0, 0.0)),
            lambda s: s.velocity.north_m_s < -0.8,
        )
        await fly_offboard(
            client,
            lambda: offboard.set_attitude(Attitude(0.0, -6.0, 0.0, HOVER * 1.02)),
            lambda s: s.velocity.north_m_s > 0.8,
        )
        await fly_offboard(
            client,
            lambda: offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 20.0, HOVER * 1.1)),
            lambda s: s.velocity.down_m_s < -0.6,
        )
        controls = ActuatorControl([ActuatorControlGroup([0.0, 0.0, 0.0, HOVER * 1.15, *[float("nan")] * 4])])
        await fly_offboard(
            client,
            lambda: offboard.set_actuator_control(controls),
            lambda s: s.velocity.down_m_s < -0.6,
        )
        await landed(client)


async def test_goto_return_and_mission() -> None:
    async with connected() as client:
        action, telemetry = client.action, client.telemetry
        await client.param.set_param_float("RTL_RETURN_ALT", 4.0)
        items = [
            MissionItem(i, 6, command, int(i == 0), 1, 0.0, 0.5, 0.0, float("nan"), *at, 3.0, 0)
            for i, (command, at) in enumerate(
                [(22, (473977420, 85455940)), (16, (473977780, 85455940)), (16, (473977780, 85456470))]
            )
        ]
        await client.mission.upload_mission(items)
        assert [(i.command, i.x, i.y) for i in await client.mission.download_mission()] == [
            (i.command, i.x, i.y) for i in items
        ]
        await action.arm()
        await client.mission.start_mission()
        await until(client.mission.subscribe_mission_progress(), lambda p: p.current >= 2)
        await until(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
        position = await until(telemetry.subscribe_position_velocity_ned(), lambda _: True)
        assert position.position.north_m == pytest.approx(4.0, abs=1.0)
        assert position.position.east_m == pytest.approx(4.0, abs=1.0)
        await action.goto_location(47.397760, 8.545594, 490.5, float("nan"))
        await until(
            telemetry.subscribe_position_velocity_ned(),
            lambda s: abs(s.position.north_m - 2.0) < 0.4 and abs(s.position.east_m) < 0.4,
        )
        await action.return_to_launch()
        await until(telemetry.subscribe_armed(), lambda armed: not armed, timeout_s=60.0)
        home = await until(telemetry.subscribe_position_velocity_ned(), lambda _: True)
        assert abs(home.position.north_m) < 1.0
        await client.mission.clear_mission()
        assert await client.mission.download_mission() == []
