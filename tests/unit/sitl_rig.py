"""A ground station in a few lines for tests of the simulation core: pymavlink's packing and parsing, no sockets."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from models.frames import STANDARD_GRAVITY_M_S2
from sitl.simulation import Simulation, SimulationConfig

NAN = math.nan
ARM, TAKEOFF, LAND, SET_MODE, INTERVAL, REQUEST = 400, 22, 21, 176, 511, 512


class Station:
    """Drives a Simulation on link 0 and keeps what it receives."""

    def __init__(self, simulation: Simulation | None = None, **config: Any) -> None:
        self.simulation = simulation or Simulation(SimulationConfig(**config))
        self.received: list[Any] = []
        self.data = bytearray()
        self._out = dialect.MAVLink(None, 255, 190)
        self._in = dialect.MAVLink(None)
        self._in.robust_parsing = True

    @property
    def time_s(self) -> float:
        return self.simulation.time_us * 1e-6

    @property
    def state(self) -> Any:
        return self.simulation.vehicle.state

    def send(self, message: Any) -> None:
        self.simulation.receive(0, message.pack(self._out))

    def run(self, seconds: float, each: Callable[[], None] | None = None, period_s: float = 0.02) -> None:
        """Advance; ``each`` is called once per period."""
        end_us = self.simulation.time_us + round(seconds * 1e6)
        while self.simulation.time_us < end_us:
            if each is not None:
                each()
            self._collect(min(end_us, self.simulation.time_us + round(period_s * 1e6)))

    def _collect(self, until_us: int) -> None:
        for packet in self.simulation.advance(until_us):
            self.data += packet.data
            if packet.link == 0:
                self.received += self._in.parse_buffer(packet.data) or []

    def command(self, number: int, *parameters: float) -> int:
        """COMMAND_LONG; the result in its acknowledgement."""
        full = [*parameters, *[NAN] * (7 - len(parameters))]
        self.send(dialect.MAVLink_command_long_message(1, 1, number, 0, *full))
        start = len(self.received)
        self._collect(self.simulation.time_us)
        answers = [m for m in self.received[start:] if m.get_type() == "COMMAND_ACK" and m.command == number]
        assert len(answers) == 1
        return int(answers[0].result)

    def mode(self, main: int, sub: int = 0) -> int:
        return self.command(SET_MODE, 129, main, sub)

    def all(self, name: str) -> list[Any]:
        return [m for m in self.received if m.get_type() == name]

    def texts(self) -> list[str]:
        return [m.text for m in self.all("STATUSTEXT")]

    def fly(self, height_m: float = 2.5) -> None:
        """Armed, taken off, holding."""
        self.simulation.autopilot.parameters.set("MIS_TAKEOFF_ALT", height_m)
        self.run(0.5)
        assert self.command(ARM, 1, 0) == 0
        assert self.command(TAKEOFF) == 0
        self.run(5.0 + 1.5 * height_m)
        assert self.simulation.autopilot.mode.name == "LOITER", self.texts()

    def offboard(self, setpoint: Callable[[], Any], seconds: float, period_s: float = 0.02) -> None:
        """Stream a setpoint, change to OFFBOARD, keep streaming."""
        self.run(0.3, lambda: self.send(setpoint()), period_s)
        assert self.mode(6) == 0, self.texts()
        self.run(seconds, lambda: self.send(setpoint()), period_s)
        assert self.simulation.autopilot.mode.name == "OFFBOARD", self.texts()


def hover_thrust(simulation: Simulation) -> float:
    """Normalised thrust that carries the weight."""
    parameters = simulation.vehicle.parameters
    return parameters.mass_kg * STANDARD_GRAVITY_M_S2 / parameters.max_thrust_n


def local_target(mask: int, frame: int = 1, **fields: float) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED."""
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    return dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *(fields.get(name, 0.0) for name in names)
    )


def attitude_target(thrust: float, quaternion: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """SET_ATTITUDE_TARGET with attitude."""
    return dialect.MAVLink_set_attitude_target_message(0, 1, 1, 7, list(quaternion), 0, 0, 0, thrust)


def rates_target(thrust: float, rates: tuple[float, float, float]) -> Any:
    """SET_ATTITUDE_TARGET with body rates."""
    return dialect.MAVLink_set_attitude_target_message(0, 1, 1, 128, [1, 0, 0, 0], *rates, thrust)


def actuator_target(*controls: float) -> Any:
    """SET_ACTUATOR_CONTROL_TARGET, group 0."""
    return dialect.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, [*controls, 0, 0, 0, 0])
