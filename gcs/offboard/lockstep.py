"""Lockstep flight: a station and a simulated vehicle take turns, both on vehicle time, with nobody waiting for a clock.

The bytes between them are the same MAVLink as over a socket. Each turn grants the vehicle a step, hands its packets to
the station, ticks if an IMU sample came, and hands the station's packets back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from gcs.commands import Answer, AnyCommand, Identity, Request
from gcs.offboard.station import Station
from gcs.records import ActionRequest, TickFrame

STEP_US = 10_000
COMPONENT_ARM_DISARM = 400
NAV_TAKEOFF = 22
FORCE_DISARM = 21196.0
ANSWER_TICKS = 100


class SteppedVehicle(Protocol):
    """A vehicle whose time moves only when it is granted."""

    def advance(self, until_us: int) -> list[bytes]:
        """Run to ``until_us`` and return every datagram it sent."""
        ...

    def send(self, packet: bytes) -> None:
        """Hand one datagram to the vehicle; it acts on it in its next step."""
        ...


class LockstepError(RuntimeError):
    """The flight did not get where it should within its time."""


class LockstepFlight:
    """Drives one flight; every tick's frame goes to ``record``."""

    def __init__(
        self,
        station: Station,
        vehicle: SteppedVehicle,
        *,
        record: Callable[[TickFrame], None] | None = None,
        step_us: int = STEP_US,
    ) -> None:
        self.station = station
        self.vehicle = vehicle
        self.time_us = 0
        self.answers: dict[int, Answer] = {}
        self._record = record
        self._step_us = step_us
        self._numbers = 0

    @property
    def time_s(self) -> float:
        """Vehicle time granted so far [s]."""
        return self.time_us * 1e-6

    def step(self) -> None:
        """One turn."""
        self.time_us += self._step_us
        for packet in self.vehicle.advance(self.time_us):
            self.station.receive(packet, self.time_s)
        turnout = self.station.tick(self.time_s)
        for packet in turnout.packets:
            self.vehicle.send(packet)
        for action in turnout.output.actions:
            self._act(action)
        for answer in turnout.output.answers:
            self.answers[answer.number] = answer
        if self._record is not None:
            self._record(self.station.frame(turnout, self.time_s, math.nan))

    def run(self, duration_s: float) -> None:
        """Fly on for ``duration_s`` of vehicle time."""
        end_us = self.time_us + round(duration_s * 1e6)
        while self.time_us < end_us:
            self.step()

    def run_until(self, reached: Callable[[Station], bool], within_s: float, what: str) -> None:
        """Fly on until ``reached``; raises LockstepError naming ``what`` if that takes longer than ``within_s``."""
        end_us = self.time_us + round(within_s * 1e6)
        while not reached(self.station):
            if self.time_us >= end_us:
                raise LockstepError(f"not within {within_s:g} s: {what}")
            self.step()

    def command(self, command: AnyCommand, identity: Identity) -> Answer:
        """Give a command and step until it is answered."""
        self._numbers += 1
        number = self._numbers
        self.station.submit(Request(number=number, identity=identity, command=command, utc_s=self.time_s))
        for _ in range(ANSWER_TICKS):
            if number in self.answers:
                return self.answers.pop(number)
            self.step()
        raise LockstepError(f"{type(command).__name__} was not answered in {ANSWER_TICKS} ticks")

    def _act(self, action: ActionRequest) -> None:
        """What the actions process does through MAVSDK on a live flight, as plain MAVLink commands."""
        link = self.station.link
        match action.action:
            case "arm":
                self.vehicle.send(link.encode_command(COMPONENT_ARM_DISARM, (1.0,)))
            case "disarm":
                self.vehicle.send(link.encode_command(COMPONENT_ARM_DISARM, (0.0,)))
            case "force_disarm":
                self.vehicle.send(link.encode_command(COMPONENT_ARM_DISARM, (0.0, FORCE_DISARM)))
            case "take_off":
                origin = self.station.state.view.origin
                ground_m = 0.0 if origin is None else origin.height_m
                self.vehicle.send(link.encode_command(COMPONENT_ARM_DISARM, (1.0,)))
                nan = math.nan
                self.vehicle.send(
                    link.encode_command(NAV_TAKEOFF, (nan, nan, nan, nan, nan, nan, ground_m + action.height_m))
                )
            case "land" | "hold":
                raise AssertionError("land and hold are sent by the tick itself")
