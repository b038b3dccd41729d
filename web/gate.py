"""The gate in front of every request: host, session, same origin, CSRF token, and the security headers on the way out.

One ASGI layer around the whole application, so that a route cannot forget it. Open without a session: ``/login`` and
its assets.
"""

from __future__ import annotations

import hmac
from http.cookies import CookieError, SimpleCookie

import msgspec
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from web.auth import Session, SessionStore

SAFE_METHODS = frozenset({"GET", "HEAD"})
MAX_BODY_BYTES = 65536


def page_policy(host: str) -> str:
    """Content-security policy of our own pages."""
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "font-src 'self'",
            "img-src 'self' data:",
            f"connect-src 'self' ws://{host} wss://{host}",
            "worker-src 'self'",
            "frame-src 'self'",
            "form-action 'self'",
            "base-uri 'none'",
            "frame-ancestors 'none'",
        )
    )


def scene_policy(host: str, nonce: str) -> str:
    """Policy of the scene's page.

    viser unpacks itself from one inline script, runs WebAssembly and a worker, and styles inline. The page may
    open its own WebSocket and nothing else on this host.
    """
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src 'nonce-{nonce}' 'strict-dynamic' 'wasm-unsafe-eval'",
            "style-src 'self' 'unsafe-inline'",
            "font-src data:",
            "img-src data: blob:",
            f"connect-src ws://{host}/scene wss://{host}/scene data: blob:",
            "worker-src blob: data:",
            "form-action 'none'",
            "base-uri 'none'",
            "frame-ancestors 'self'",
        )
    )


def cookie_name(port: int) -> str:
    """Cookies do not tell ports apart, so the name does: two stations on one machine keep their sessions."""
    return f"rotorlab_{port}"


class Gate:
    """ASGI layer: refuses what has no business here, and puts the session into ``scope["state"]["session"]``."""

    def __init__(self, app: ASGIApp, *, sessions: SessionStore, hosts: frozenset[str], cookie: str) -> None:
        self._app = app
        self._sessions = sessions
        self._hosts = hosts
        self._cookie = cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        session = self._session(headers)
        scope.setdefault("state", {})["session"] = session
        if scope["type"] == "websocket":
            if _name_of(host) in self._hosts and session is not None and _same_origin(scope, headers, host):
                await self._app(scope, receive, send)
            else:
                await send({"type": "websocket.close", "code": 1008, "reason": "Not allowed."})
            return
        if _name_of(host) not in self._hosts:
            send = _with_security_headers(send, "localhost", scope["path"])
            await _refuse(send, 421, "This station does not answer to that host name. Start it with --allow-host NAME.")
            return
        send = _with_security_headers(send, host, scope["path"])
        refusal = self._refusal(scope, headers, host, session)
        if refusal is not None:
            await refusal(send)
            return
        await self._app(scope, receive, send)

    def _session(self, headers: Headers) -> Session | None:
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(self._cookie)
        except CookieError:
            return None
        return self._sessions.find(morsel.value) if morsel is not None else None

    def _refusal(self, scope: Scope, headers: Headers, host: str, session: Session | None) -> _Refusal | None:
        path: str = scope["path"]
        is_login = path == "/login" or path.startswith("/login/")
        if session is None and not is_login:
            wants_page = scope["method"] in SAFE_METHODS and "text/html" in headers.get("accept", "")
            return _Refusal(303, location="/login") if wants_page else _Refusal(401, "No session. Log in first.")
        if scope["method"] in SAFE_METHODS:
            return None
        if not _same_origin(scope, headers, host):
            return _Refusal(403, "Refused: the request does not come from this station's own page (Origin).")
        if not is_login and session is not None and not _csrf_is_right(headers, session):
            return _Refusal(403, "Refused: X-CSRF-Token is missing or wrong. Reload the page.")
        length = headers.get("content-length", "")
        if not length.isdigit() or int(length) > MAX_BODY_BYTES:
            return _Refusal(413, f"Refused: the body needs a Content-Length of at most {MAX_BODY_BYTES} bytes.")
        return None


class _Refusal:
    def __init__(self, status: int, detail: str = "", location: str | None = None) -> None:
        self._status = status
        self._detail = detail
        self._location = location

    async def __call__(self, send: Send) -> None:
        await _refuse(send, self._status, self._detail, self._location)


async def _refuse(send: Send, status: int, detail: str, location: str | None = None) -> None:
    body = msgspec.json.encode({"detail": detail})
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if location is not None:
        headers.append((b"location", location.encode()))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _name_of(host: str) -> str:
    """Host header without its port: ``[::1]:8765`` is ``[::1]``."""
    head, _, tail = host.rpartition(":")
    return head if head and tail.isdigit() else host


def _same_origin(scope: Scope, headers: Headers, host: str) -> bool:
    scheme = "https" if scope["scheme"] in ("https", "wss") else "http"
    return headers.get("origin") == f"{scheme}://{host}"


def _csrf_is_right(headers: Headers, session: Session) -> bool:
    return hmac.compare_digest(headers.get("x-csrf-token", "").encode(), session.csrf.encode())


def _with_security_headers(send: Send, host: str, path: str) -> Send:
    # The bundle keeps its name from build to build, so browsers must ask whether theirs is still the one.
    cache = "no-cache" if path.startswith("/static/") else "no-store"

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("content-security-policy", page_policy(host))
            headers.setdefault("x-frame-options", "DENY")
            headers.setdefault("cache-control", cache)
            headers["x-content-type-options"] = "nosniff"
            # Not "no-referrer": with it browsers send "Origin: null" with the login form.
            headers["referrer-policy"] = "same-origin"
            headers["cross-origin-opener-policy"] = "same-origin"
            headers["cross-origin-resource-policy"] = "same-origin"
            headers["permissions-policy"] = "camera=(), geolocation=(), microphone=(), payment=(), usb=()"
        await send(message)

    return guarded
