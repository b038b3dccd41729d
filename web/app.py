"""The web application: login, REST, stream, scene and pages, all behind one gate."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import FastAPI, WebSocket
from fastapi.openapi.utils import get_openapi
from fastapi.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from fastapi.staticfiles import StaticFiles

from web.auth import AttemptLimiter, LoginLink, SessionStore, Users
from web.gate import Gate
from web.login import Login
from web.proxy import create_scene_router
from web.reference import reference_page
from web.routes import Station, create_router, struct_schemas
from web.stream import serve_stream

STATIC = Path(__file__).parent / "static"
_NOT_BUILT = "The browser bundle is not built. Run make setup, then reload.\n"

Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]


@dataclass(frozen=True, slots=True)
class Access:
    """Everything that decides who comes in."""

    sessions: SessionStore
    link: LoginLink
    users: Users
    limiter: AttemptLimiter
    hosts: frozenset[str]
    cookie: str


def create_app(station: Station, access: Access, lifespan: Lifespan | None = None, static: Path = STATIC) -> FastAPI:
    """The ASGI application. ``lifespan`` brings the station's feed to life and takes it down."""
    app = FastAPI(
        title="rotorlab",
        description="Ground station of one vehicle. State changes need a session and the X-CSRF-Token of /api/session.",
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.include_router(
        Login(
            sessions=access.sessions,
            link=access.link,
            users=access.users,
            limiter=access.limiter,
            cookie=access.cookie,
        ).router
    )
    app.include_router(create_router(station))
    app.include_router(create_scene_router(station.scene))
    _add_pages(app, static)

    @app.websocket("/ws/stream")
    async def stream(socket: WebSocket) -> None:
        await serve_stream(socket, station.feed, socket.scope["state"]["session"], access.sessions)

    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]
    app.add_middleware(Gate, sessions=access.sessions, hosts=access.hosts, cookie=access.cookie)
    return app


def _add_pages(app: FastAPI, static: Path) -> None:
    @app.get("/", include_in_schema=False)
    async def index() -> Response:
        page = static / "index.html"
        if not page.is_file():
            return PlainTextResponse(_NOT_BUILT, status_code=503)
        return FileResponse(page)

    @app.get("/api/docs", include_in_schema=False)
    async def docs() -> Response:
        return HTMLResponse(reference_page(app.openapi()))

    app.mount("/static", StaticFiles(directory=static, check_dir=False), name="static")


def _openapi(app: FastAPI) -> dict[str, Any]:
    """FastAPI's document with the schemas of commands, which msgspec knows and pydantic does not."""
    if app.openapi_schema is None:
        document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        _, _, components = struct_schemas()
        document.setdefault("components", {}).setdefault("schemas", {}).update(components)
        app.openapi_schema = document
    return app.openapi_schema
