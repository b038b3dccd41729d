"""The authenticated way to the scene: page and WebSocket of viser under ``/scene``.

The gate in front has checked session and origin. Towards viser only camera messages pass; everything else a page
might send is dropped.
"""

from __future__ import annotations

import asyncio
import re
import secrets
from pathlib import Path

import httpx
import msgspec
import websockets
from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import ClientConnection
from websockets.typing import Subprotocol

from web.auth import Session
from web.gate import scene_policy
from web.scene import Scene

_FOLDER = Path(__file__).parent
_ASSETS = {"bridge.js": ("scene_bridge.js", "text/javascript"), "scene.css": ("scene.css", "text/css")}
_SCRIPT_TAG = re.compile(r"<script(?=[\s>])")
_PASSED_ON = "ViewerCameraMessage"
_MAX_FROM_VISER = 50 * 1024 * 1024


class _ViserMessage(msgspec.Struct):
    type: str


def scene_page(viser_page: str, nonce: str) -> str:
    """viser's page with our style and key bridge in front, every script carrying the nonce of the policy."""
    page = _SCRIPT_TAG.sub(f'<script nonce="{nonce}"', viser_page)
    ours = f'<link rel="stylesheet" href="/scene/scene.css"><script nonce="{nonce}" src="/scene/bridge.js"></script>'
    return page.replace("<head>", f"<head>{ours}", 1)


def is_camera_message(raw: bytes) -> bool:
    """Whether a message of viser's client is one that may pass."""
    try:
        return msgspec.msgpack.decode(raw, type=_ViserMessage).type == _PASSED_ON
    except msgspec.DecodeError:
        return False


def create_scene_router(scene: Scene) -> APIRouter:
    """Routes of the scene; the WebSocket is ``/scene``, where viser's client looks for it."""
    router = APIRouter(include_in_schema=False)
    viser_page = httpx.AsyncClient(base_url=f"http://127.0.0.1:{scene.port}", trust_env=False)

    @router.get("/scene")
    async def without_slash() -> Response:
        return RedirectResponse("/scene/")

    @router.get("/scene/")
    async def page(request: Request) -> Response:
        upstream = await viser_page.get("/")
        upstream.raise_for_status()
        nonce = secrets.token_urlsafe(16)
        headers = {
            "content-security-policy": scene_policy(request.headers["host"], nonce),
            "x-frame-options": "SAMEORIGIN",
        }
        return HTMLResponse(scene_page(upstream.text, nonce), headers=headers)

    @router.get("/scene/{asset}")
    async def asset(asset: str) -> Response:
        if asset not in _ASSETS:
            return Response(status_code=404)
        name, media_type = _ASSETS[asset]
        return FileResponse(_FOLDER / name, media_type=media_type)

    @router.websocket("/scene")
    async def stream(socket: WebSocket) -> None:
        session: Session = socket.scope["state"]["session"]
        offered = [Subprotocol(name) for name in socket.scope["subprotocols"]]
        async with websockets.connect(
            f"ws://127.0.0.1:{scene.port}",
            subprotocols=offered,
            compression=None,
            max_size=_MAX_FROM_VISER,
            proxy=None,
        ) as upstream:
            local_port = upstream.local_address[1]
            scene.own(local_port, session.client)
            try:
                await socket.accept(subprotocol=upstream.subprotocol)
                await _relay(socket, upstream)
            finally:
                scene.disown(local_port)

    return router


async def _relay(socket: WebSocket, upstream: ClientConnection) -> None:
    """Pass messages both ways until either side leaves."""
    tasks = {asyncio.create_task(_down(socket, upstream)), asyncio.create_task(_up(socket, upstream))}
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            failure = task.exception()
            if failure is not None and not isinstance(failure, (WebSocketDisconnect, websockets.ConnectionClosed)):
                raise failure
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _down(socket: WebSocket, upstream: ClientConnection) -> None:
    async for message in upstream:
        if isinstance(message, bytes):
            await socket.send_bytes(message)
    code = upstream.close_code
    await socket.close(code if code is not None and code != 1006 else 1011, upstream.close_reason or "")


async def _up(socket: WebSocket, upstream: ClientConnection) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        raw = message.get("bytes")
        if raw is not None and is_camera_message(raw):
            await upstream.send(raw)
