"""The simulated vehicle as a sans-I/O core: bytes in, time forward, packets out.

Same configuration, same bytes in at the same vehicle times: same bytes out. Nothing here reads a clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.frames import Geodetic
from models.parameters import QuadrotorParameters, load_quadrotor
from sitl.autopilot import UPDATE_US, Autopilot
from sitl.mavlink_face import Face, Packet
from sitl.mission import Mission
from sitl.modes import Severity
from sitl.navigation import NAVIGATION_GNSS, NAVIGATION_MOCAP, Navigation
from sitl.schedule import FLY, HAND_OVER, SENSE, Schedule
from sitl.sensors import Sensor, SensorConfig, build_sensors
from sitl.telemetry import Telemetry
from sitl.vehicle import TICK_US, QuadrotorVehicle
from sitl.vehicle_parameters import VehicleParameters
from sitl.wind import Wind

POSITION_SOURCES = ("gnss", "mocap", "both")
HOME = Geodetic(math.radians(47.397742), math.radians(8.545594), 488.0)


@dataclass(frozen=True)
class SimulationConfig:
    """One simulated quadrotor. ``position`` says which position sensors it carries: gnss, mocap or both.

    ``home`` is where it stands at power-on and the origin of its local frame. Raises ValueError for a position source
    that does not exist.
    """

    seed: int = 0
    position: str = "gnss"
    wind: Wind = field(default_factory=Wind)
    sensors: SensorConfig = field(default_factory=SensorConfig)
    home: Geodetic = HOME
    yaw_rad: float = 0.0
    links: int = 1
    parameters: QuadrotorParameters = field(default_factory=load_quadrotor)

    def __post_init__(self) -> None:
        if self.position not in POSITION_SOURCES:
            raise ValueError(f"position '{self.position}' is not one of {', '.join(POSITION_SOURCES)}")


class Simulation:
    """A vehicle, its firmware and its links; ``vehicle``, ``sensors`` and ``autopilot`` are open to scenarios."""

    def __init__(self, config: SimulationConfig) -> None:
        seeds = np.random.SeedSequence(config.seed).spawn(7)
        self.vehicle = QuadrotorVehicle(
            config.parameters, config.wind, config.sensors.imu, np.random.default_rng(seeds[0]), config.yaw_rad
        )
        self.sensors = build_sensors(self.vehicle, config.sensors, seeds[2:], config.home.height_m)
        navigation = Navigation(
            self.vehicle,
            NAVIGATION_GNSS if config.position == "gnss" else NAVIGATION_MOCAP,
            np.random.default_rng(seeds[1]),
        )
        self._schedule = Schedule()
        self.autopilot = Autopilot(
            self.vehicle, navigation, self.sensors, VehicleParameters(), Mission(config.home), self._announce
        )
        telemetry = Telemetry(self.vehicle, navigation, self.sensors, config.sensors, self.autopilot, config.home)
        self.face = Face(
            self.vehicle,
            self.autopilot,
            telemetry,
            self._schedule,
            config.home,
            config.links,
            imu_delay_us=round(1e6 * config.sensors.imu.delay_s),
            imu_rate_hz=config.sensors.imu.rate_hz,
        )
        self._navigation = navigation
        self._start(config.position)

    def _announce(self, severity: Severity, text: str) -> None:
        self.face.announce(severity, text)

    def _start(self, position: str) -> None:
        sensors: dict[str, Sensor[Any]] = {
            "magnetometer": self.sensors.magnetometer,
            "barometer": self.sensors.barometer,
            "range": self.sensors.range,
            "battery": self.sensors.battery,
        }
        if position in ("gnss", "both"):
            sensors["gnss"] = self.sensors.gnss
        if position in ("mocap", "both"):
            sensors["mocap"] = self.sensors.mocap
        for name, sensor in sensors.items():
            self._schedule.add(sensor.interval_us, SENSE, self._sampler(name, sensor))
        self._schedule.add(UPDATE_US, FLY, self._fly)

    def _sampler(self, name: str, sensor: Sensor[Any]) -> Any:
        due_us = sensor.interval_us

        def sample(time_us: int) -> int:
            nonlocal due_us
            hand_over = sensor.measure(time_us)

            def ready(ready_us: int) -> None:
                hand_over()
                if sensor.enabled:
                    self.face.sensor_ready(name, ready_us)

            self._schedule.add(time_us + sensor.delay_us, HAND_OVER, ready)
            due_us += sensor.interval_us
            return due_us

        return sample

    def _fly(self, time_us: int) -> int:
        self._navigation.update(UPDATE_US * 1e-6)
        self.autopilot.update()
        return time_us + UPDATE_US

    @property
    def time_us(self) -> int:
        """Vehicle time since power-on [us]."""
        return self.vehicle.time_us

    @property
    def next_due_us(self) -> int:
        """When something next happens of itself [us]; the time at which a real-time server should wake."""
        due_us = self._schedule.next_us()
        return self.time_us if due_us is None else due_us

    def receive(self, link_index: int, datagram: bytes) -> None:
        """Bytes from the peer of a link. They act now; answers leave with the next :meth:`advance`."""
        self.face.receive(link_index, datagram)

    def advance(self, until_us: int) -> list[Packet]:
        """Run to the last whole tick up to ``until_us`` and hand out every packet sent, answers first."""
        last_tick = until_us // TICK_US
        schedule, vehicle = self._schedule, self.vehicle
        while True:
            due_us = schedule.next_us()
            if due_us is None:
                break
            tick = -(-due_us // TICK_US)
            if tick > last_tick:
                break
            vehicle.advance(tick)
            schedule.run_due(vehicle.time_us, vehicle.time_us)
        vehicle.advance(last_tick)
        packets, self.face.outbox = self.face.outbox, []
        return packets
