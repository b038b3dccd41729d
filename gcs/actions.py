"""The actions process: ``python -m gcs.actions``. MAVSDK arms, takes off, lands and holds, behind the flight process.

The flight process passes raw packets between the vehicle and a loopback UDP port, on which MAVSDK listens. Requests
come over the bus from the hub, after the flight process has accepted them; each is answered with what the vehicle said.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from mavsdk import LogLevel, log_subscribe
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkConnectionError, System
from mavsdk.asyncio.plugins.action import ActionAsync, ActionError
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionResult as Verdict
from mavsdk.plugins.telemetry import StatusTextType

from gcs.bus import Bus, BusError, open_client
from gcs.records import ActionRequest, ActionResult
from gcs.runtime import RuntimeFolderError, end_with_parent, open_runtime

HUB_TIMEOUT_S = 30.0
DISCOVERY_TURN_S = 5.0
# The vehicle's own words come just before or after its refusal.
WORDS_BEFORE_S = 1.0
WORDS_AFTER_S = 0.3

Reply = Callable[[ActionResult], None]

NAMES = {
    "arm": "Arm",
    "disarm": "Disarm",
    "force_disarm": "Forced disarm",
    "take_off": "Take-off",
    "land": "Land",
    "hold": "Hold",
}

REASONS = {
    Verdict.NO_SYSTEM: "no vehicle is connected",
    Verdict.CONNECTION_ERROR: "the connection to the vehicle failed",
    Verdict.BUSY: "the vehicle is busy, try again",
    Verdict.COMMAND_DENIED: "the vehicle denied it",
    Verdict.COMMAND_DENIED_LANDED_STATE_UNKNOWN: "the vehicle does not know whether it has landed",
    Verdict.COMMAND_DENIED_NOT_LANDED: "the vehicle has not landed",
    Verdict.TIMEOUT: "the vehicle did not answer",
    Verdict.PARAMETER_ERROR: "a parameter could not be written",
    Verdict.UNSUPPORTED: "the vehicle does not support it",
    Verdict.FAILED: "it failed in the vehicle",
    Verdict.INVALID_ARGUMENT: "the vehicle takes no such value",
}


class VehicleActions:
    """Actions on one vehicle, once MAVSDK has found it."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._action = ActionAsync(system)
        self._telemetry = TelemetryAsync(system)
        self._words: tuple[float, str] = (float("-inf"), "")

    async def listen(self) -> None:
        """Keep the vehicle's latest complaint, for the reason of a refusal. Runs until cancelled."""
        async for message in self._telemetry.subscribe_status_text():
            if message.type >= StatusTextType.WARNING:
                self._words = (time.monotonic(), message.text)

    async def run(self, request: ActionRequest) -> ActionResult:
        """Do it and say how it went."""
        name = NAMES[request.action]
        if not await self._system.is_connected():
            return ActionResult(request.number, False, f"{name} refused: no vehicle is connected.")
        asked_s = time.monotonic()
        try:
            text = await self._steps(request)
        except ActionError as error:
            return ActionResult(request.number, False, f"{name} refused: {await self._reason(error, asked_s)}.")
        return ActionResult(request.number, True, text)

    async def _steps(self, request: ActionRequest) -> str:
        action = self._action
        match request.action:
            case "arm":
                await action.arm()
                return "Armed."
            case "disarm":
                await action.disarm()
                return "Disarmed."
            case "force_disarm":
                await action.kill()
                return "Motors stopped by forced disarm."
            case "land":
                await action.land()
                return "Landing."
            case "hold":
                await action.hold()
                return "Holding."
            case "take_off":
                return await self._take_off(request.height_m)

    async def _take_off(self, height_m: float) -> str:
        await self._action.set_takeoff_altitude(height_m)
        armed_before = await self._telemetry.armed()
        if not armed_before:
            await self._action.arm()
        try:
            await self._action.takeoff()
        except ActionError:
            if not armed_before:
                await self._undo(self._action.disarm)
            raise
        return f"Taking off to {height_m:.1f} m."

    async def _undo(self, step: Callable[[], Awaitable[Any]]) -> None:
        try:
            await step()
        except ActionError as error:
            print(f"actions: {error}", file=sys.stderr)

    async def _reason(self, error: ActionError, asked_s: float) -> str:
        if self._words[0] < asked_s - WORDS_BEFORE_S:
            await asyncio.sleep(WORDS_AFTER_S)
        said_s, words = self._words
        reason = REASONS.get(error.result, str(error.result.name).lower().replace("_", " "))
        if said_s >= asked_s - WORDS_BEFORE_S:
            return f'{reason}, "{words.rstrip(".")}"'
        return reason


class ActionDesk:
    """Takes requests off the bus, whether or not there is a vehicle yet."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._vehicle: VehicleActions | None = None
        self._running: set[asyncio.Task[None]] = set()

    def submit(self, request: ActionRequest, reply: Reply) -> None:
        """Take a request (any thread)."""
        self._loop.call_soon_threadsafe(self._start, request, reply)

    def _start(self, request: ActionRequest, reply: Reply) -> None:
        # Not queued behind each other: Land must not wait for a take-off that hangs.
        task = self._loop.create_task(self._answer(request, reply))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _answer(self, request: ActionRequest, reply: Reply) -> None:
        if self._vehicle is None:
            text = f"{NAMES[request.action]} refused: MAVSDK has not found the vehicle yet. Check the link."
            reply(ActionResult(request.number, False, text))
            return
        reply(await self._vehicle.run(request))

    async def find_vehicle(self, mavsdk: Mavsdk) -> None:
        """Wait for the vehicle, then listen to it. Runs until cancelled; MAVSDK reconnects by itself."""
        system = None
        while system is None:
            system = await mavsdk.first_autopilot(timeout_s=DISCOVERY_TURN_S)
        self._vehicle = VehicleActions(system)
        print(f"actions: vehicle {await system.get_system_id()} found", flush=True)
        await self._vehicle.listen()


def _log(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    if level >= LogLevel.WARN:
        print(f"actions: MAVSDK: {message}", file=sys.stderr, flush=True)
    return True


async def serve(bus: Bus, port: int) -> None:
    """Serve actions until SIGTERM or SIGINT. Raises MavsdkConnectionError when the port cannot be used."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopped.set)
    log_subscribe(_log)
    desk = ActionDesk(loop)
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        bus.serve_actions(desk.submit)
        print(f"actions: ready on port {port}", flush=True)
        search = asyncio.create_task(desk.find_vehicle(mavsdk))
        waiting = asyncio.create_task(stopped.wait())
        done, _ = await asyncio.wait({search, waiting}, return_when=asyncio.FIRST_COMPLETED)
        search.cancel()
        if search in done:
            await search


def main() -> int:
    """Start the actions process; returns the exit status, 2 for a port or folder that cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m gcs.actions", description="Arm, take off, land: MAVSDK.")
    parser.add_argument("--runtime", type=Path, help="runtime folder (0700)")
    parser.add_argument("--port", type=int, required=True, help="loopback UDP port the flight process sends to")
    arguments = parser.parse_args()
    end_with_parent()
    try:
        with open_client(open_runtime(arguments.runtime).zenoh_socket, HUB_TIMEOUT_S) as bus:
            asyncio.run(serve(bus, arguments.port))
    except RuntimeFolderError as error:
        print(f"actions: {error}", file=sys.stderr)
        return 2
    except MavsdkConnectionError as error:
        print(f"actions: port {arguments.port}: {error}", file=sys.stderr)
        return 2
    except BusError as error:
        print(f"actions: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
