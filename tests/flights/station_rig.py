"""A whole flight in one process: the real station and the real simulated vehicle exchange MAVLink bytes in lockstep."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs import commands as c
from gcs.offboard.configure import read_offboard_config
from gcs.offboard.lockstep import LockstepFlight
from gcs.offboard.modes import State
from gcs.offboard.station import Station
from gcs.records import Event, TickFrame
from gcs.signals import SLICES
from models.arrays import Array
from sitl.simulation import Simulation, SimulationConfig

VEHICLES = Path(__file__).parents[2] / "gcs" / "vehicles"
OPERATOR = c.Identity(name="operator 1", role="operator", client="test")


class SimulatedVehicle:
    """The simulated vehicle as the lockstep driver sees it; ``cut`` drops every packet either way."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.cut = False

    def advance(self, until_us: int) -> list[bytes]:
        packets = [packet.data for packet in self.simulation.advance(until_us)]
        return [] if self.cut else packets

    def send(self, packet: bytes) -> None:
        if not self.cut:
            self.simulation.receive(0, packet)


class Rig:
    """A station, a vehicle and everything that was recorded."""

    def __init__(self, config: SimulationConfig | None = None, vehicle: str = "sim_quadrotor") -> None:
        self.simulation = Simulation(config or SimulationConfig(seed=1, position="mocap"))
        self.vehicle = SimulatedVehicle(self.simulation)
        self.station = Station(read_offboard_config(VEHICLES / f"{vehicle}.toml"), 0.0, clock_rate=1.0)
        self.frames: list[TickFrame] = []
        self.flight = LockstepFlight(self.station, self.vehicle, record=self.frames.append)

    @property
    def state(self) -> State:
        return self.station.state.state

    @property
    def events(self) -> list[Event]:
        return [event for frame in self.frames for event in frame.events]

    def said(self, text: str) -> bool:
        return any(text in event.text for event in self.events)

    def run(self, duration_s: float) -> None:
        """Fly on, keeping the controls."""
        end_s = self.flight.time_s + duration_s
        while self.flight.time_s < end_s - 1e-9:
            self.flight.run(min(1.0, end_s - self.flight.time_s))
            if self.station.state.lease.held_by(OPERATOR):
                self.flight.command(c.KeepControls(), OPERATOR)

    def order(self, command: c.AnyCommand) -> None:
        """Give a command that has to be accepted."""
        answer = self.flight.command(command, OPERATOR)
        assert answer.accepted, answer.reason

    def refused(self, command: c.AnyCommand) -> str:
        """Give a command that has to be refused; returns the reason."""
        answer = self.flight.command(command, OPERATOR)
        assert not answer.accepted
        return answer.reason

    def take_off(self, height_m: float = 2.5) -> None:
        self.flight.run_until(lambda s: _positioned(s) and s.link.negotiated, 20.0, "a position estimate")
        self.run(2.0)
        self.order(c.TakeControls())
        self.order(c.TakeOff(height_m))
        self.run(height_m + 4.0)

    def into_offboard(self) -> None:
        self.order(c.StartOffboard())
        self.flight.run_until(lambda s: s.state.state is State.ACTIVE, 5.0, "offboard")

    def signals(self, name: str, since: int = 0) -> Array:
        """Recorded values of a signal, shape (ticks, size)."""
        return np.array([np.frombuffer(frame.signals)[SLICES[name]] for frame in self.frames[since:]])


def _positioned(station: Station) -> bool:
    return station.state.estimate is not None and station.state.estimate.position_valid
