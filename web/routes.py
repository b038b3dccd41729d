"""The REST interface: session, tables, status, commands, design and runs. Every route is behind the gate."""

from __future__ import annotations

import itertools
import re
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import msgspec
from anyio import to_thread
from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import Response

from gcs.commands import Answer, AnyCommand
from gcs.commands import Request as StationRequest
from models.arrays import Array
from web import runs, tables
from web.auth import Session, SessionStore
from web.scene import VIEWS, Scene
from web.stream import Feed, event_fields, signal_table

SCHEMA_REFERENCE = "#/components/schemas/{name}"
SendCommand = Callable[[StationRequest], Awaitable[Answer]]

_WHERE = re.compile(r" - at `\$\.?(?P<path>[^`]*)`$")


@dataclass(frozen=True, slots=True)
class Station:
    """What the routes stand on: the feed, the way for commands, the scene, the sessions and the folder of runs."""

    feed: Feed
    send: SendCommand
    scene: Scene
    sessions: SessionStore
    runs_folder: Path


def readable(error: msgspec.DecodeError) -> str:
    """An msgspec message as an operator reads it: ``height_m: Expected float <= 100.0``."""
    text = str(error)
    match = _WHERE.search(text)
    if match is None:
        return text.replace("`", "")
    what = text[: match.start()].replace("`", "")
    where = match["path"]
    if where == "type":
        what += f"; one of {', '.join(command_types())}"
    return f"{where or 'command'}: {what}"


def command_types() -> list[str]:
    """The ``type`` of every command there is."""
    return [str(kind.__struct_config__.tag) for kind in AnyCommand.__args__]


def session_of(request: Request) -> Session:
    """The session the gate found. Without one the gate has answered already."""
    session = request.scope["state"]["session"]
    if session is None:
        raise HTTPException(401, "No session. Log in first.")
    return cast(Session, session)


def json_response(value: object, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status_code=status, media_type="application/json")


def struct_schemas() -> tuple[dict[str, Any], dict[str, Any], dict[str, dict[str, Any]]]:
    """JSON schemas of the command body, of the answer, and of everything they refer to."""
    (command, answer), components = msgspec.json.schema_components((AnyCommand, Answer), ref_template=SCHEMA_REFERENCE)
    return command, answer, components


def _command_api() -> dict[str, Any]:
    command, answer, _ = struct_schemas()
    return {
        "requestBody": {"required": True, "content": {"application/json": {"schema": command}}},
        "responses": {
            "200": {"description": "Accepted, or why not", "content": {"application/json": {"schema": answer}}}
        },
    }


def create_router(station: Station) -> APIRouter:
    """All routes below ``/api``."""
    router = APIRouter(prefix="/api")
    _add_reading(router, station)
    _add_commands(router, station)
    _add_design(router, station)
    return router


def _add_reading(router: APIRouter, station: Station) -> None:
    @router.get("/session")
    async def session(request: Request) -> dict[str, str]:
        """Who is logged in here, and the token to send as X-CSRF-Token with every change."""
        own = session_of(request)
        return {"name": own.name, "role": own.role, "csrf": own.csrf, "client": own.client}

    @router.post("/logout")
    async def logout(request: Request) -> dict[str, bool]:
        """Close this session; its streams end with it."""
        station.sessions.close(session_of(request))
        return {"closed": True}

    @router.get("/signals")
    async def signals() -> list[dict[str, Any]]:
        """The signal table: place of each signal in a frame of float64."""
        return signal_table()

    @router.get("/status")
    async def status() -> dict[str, Any]:
        """Newest status of the station."""
        if station.feed.status is None:
            raise HTTPException(503, "No status yet: the flight process has not reported.")
        return station.feed.status

    @router.get("/events")
    async def events(limit: int = 100) -> list[dict[str, Any]]:
        """Newest events, oldest first."""
        if not 1 <= limit <= 1000:
            raise HTTPException(422, f"limit: {limit} is outside 1 to 1000")
        return [event_fields(event) for event in list(station.feed.events)[-limit:]]

    @router.get("/runs")
    async def list_runs() -> list[dict[str, Any]]:
        """Recorded runs, newest first."""
        return await to_thread.run_sync(runs.list_runs, station.runs_folder)


def _add_commands(router: APIRouter, station: Station) -> None:
    # Answers are matched by number; starting at the clock keeps numbers of a restarted process apart.
    numbers = itertools.count(time.time_ns() // 1000)

    @router.post("/commands", openapi_extra=_command_api())
    async def commands(request: Request) -> Response:
        """Give one command. The flight process accepts it, or refuses with a reason."""
        own = session_of(request)
        if own.role != "operator":
            raise HTTPException(403, "Observers watch. Log in as an operator to give commands.")
        try:
            command = msgspec.json.decode(await request.body(), type=AnyCommand)
        except msgspec.DecodeError as error:
            raise HTTPException(422, readable(error)) from error
        answer = await station.send(
            StationRequest(number=next(numbers), identity=own.identity, command=command, utc_s=time.time())
        )
        return json_response({"accepted": answer.accepted, "reason": answer.reason})

    @router.post("/scene/camera")
    async def camera(request: Request) -> dict[str, str]:
        """Point the camera of this session's scene: {"view": "free" | "top" | "north" | "chase", "own" to stop}."""
        try:
            wanted = msgspec.json.decode(await request.body(), type=dict[str, str])
        except msgspec.DecodeError as error:
            raise HTTPException(422, readable(error)) from error
        view = wanted.get("view", "")
        if view not in VIEWS:
            raise HTTPException(422, f"view: '{view}' is not one of {', '.join(VIEWS)}")
        station.scene.look(session_of(request).client, view)
        return {"view": view}


def _predicted(wanted: tables.DesignRequest, status: dict[str, Any] | None, frame: Array | None) -> Any:
    """A prediction; its code takes seconds to load, which is left to the warm-up so that the page opens at once."""
    from web.design import predict_change

    return predict_change(wanted, status, frame)


def _add_design(router: APIRouter, station: Station) -> None:
    @router.get("/trajectories")
    async def trajectories() -> list[dict[str, Any]]:
        """Kinds of trajectory with their fields, units, ranges and defaults."""
        return tables.trajectory_table()

    @router.get("/gains")
    async def gains() -> dict[str, Any]:
        """The table of every gain, the named sets, and the set that flies."""
        return tables.gains_answer(station.feed.status)

    @router.post("/design")
    async def predict(request: Request) -> Response:
        """Poles, margins and steps of the live and of the staged gain set: {"controller", "changes": {key: value}}."""
        try:
            wanted = msgspec.json.decode(await request.body(), type=tables.DesignRequest)
            report = await to_thread.run_sync(_predicted, wanted, station.feed.status, station.feed.newest_signals())
        except msgspec.DecodeError as error:
            raise HTTPException(422, readable(error)) from error
        except tables.DesignError as error:
            raise HTTPException(422, str(error)) from error
        return json_response(report)
