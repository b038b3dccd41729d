"""The login page: one-time link or password in, session cookie out. The only routes that are open without a session."""

from __future__ import annotations

import html
import math
import string
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import parse_qs

from anyio import to_thread
from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response

from web.auth import AttemptLimiter, LoginLink, Session, SessionStore, Users

PAGES = Path(__file__).parent / "pages"
_ASSETS = {"login.css": "text/css", "login.js": "text/javascript"}
_PAGE = string.Template((PAGES / "login.html").read_text())

_ONLY_HERE = "The one-time link works on the computer that runs the station. Elsewhere, log in with name and password."
LINK_HELP = "Print a new link on the computer that runs the station: gcs login"
_ONE_TIME_FORM = (
    '<form id="one-time" method="post" action="/login">'
    '<input type="hidden" name="token" value="{token}"><button>Log in</button></form>'
)
_PASSWORD_FORM = (
    '<form method="post" action="/login">'
    '<label for="name">Name</label><input id="name" name="name" autocomplete="username" maxlength="64" required>'
    '<label for="password">Password</label>'
    '<input id="password" name="password" type="password" autocomplete="current-password" maxlength="256" required>'
    "<button>Log in</button></form>"
)


def _is_local(request: Request) -> bool:
    """Whether the request comes from this computer: from loopback, or from the very address it was sent to."""
    if request.client is None:
        return False
    return ip_address(request.client.host).is_loopback or request.client.host == request.scope["server"][0]


class Login:
    """Routes of ``/login``; see :mod:`web.auth` for what they check."""

    def __init__(
        self, *, sessions: SessionStore, link: LoginLink, users: Users, limiter: AttemptLimiter, cookie: str
    ) -> None:
        self._sessions = sessions
        self._link = link
        self._users = users
        self._limiter = limiter
        self._cookie = cookie
        self.router = APIRouter(include_in_schema=False)
        self.router.add_api_route("/login", self.show, methods=["GET"])
        self.router.add_api_route("/login", self.enter, methods=["POST"])
        self.router.add_api_route("/login/{asset}", self.asset, methods=["GET"])

    def _page(self, message: str, forms: str | None = None, status: int = 200) -> HTMLResponse:
        """The page with a message; without other forms it has the password form, if anybody has a password."""
        if forms is None:
            forms = _PASSWORD_FORM if self._users.any else ""
        return HTMLResponse(_PAGE.substitute(message=html.escape(message), forms=forms), status_code=status)

    async def show(self, token: str = "") -> Response:
        """The page. Reading it uses nothing up, so a link that is prefetched stays good."""
        if token:
            return self._page("One-time link.", _ONE_TIME_FORM.format(token=html.escape(token, quote=True)))
        password = "with your name and password, or " if self._users.any else ""
        return self._page(f"Log in {password}by a one-time link. {LINK_HELP}")

    async def asset(self, asset: str) -> Response:
        if asset not in _ASSETS:
            return Response(status_code=404)
        return FileResponse(PAGES / asset, media_type=_ASSETS[asset])

    async def enter(self, request: Request) -> Response:
        """Check the token or the password; open a session, or say what to do."""
        address = request.client.host if request.client else ""
        wait_s = self._limiter.wait_s(address)
        if wait_s > 0.0:
            refused = self._page(f"Too many failed attempts. Try again in {math.ceil(wait_s)} s.", status=429)
            refused.headers["retry-after"] = str(math.ceil(wait_s))
            return refused
        try:
            fields = parse_qs((await request.body()).decode("utf-8", "replace"), max_num_fields=4)
        except ValueError:
            return self._page("The form could not be read.", status=400)
        token = fields.get("token", [""])[0]
        if token:
            if not _is_local(request):
                return self._page(_ONLY_HERE, status=403)
            if self._link.consume(token):
                return self._admit(request, *self._sessions.open_by_link())
            self._limiter.failed(address)
            return self._page(f"This link has been used or is out of date. {LINK_HELP}", status=403)
        name, password = fields.get("name", [""])[0], fields.get("password", [""])[0]
        # Counted before the check: attempts made in parallel must not all pass the limit while the hash is computed.
        self._limiter.failed(address)
        role = await to_thread.run_sync(self._users.check, name, password)
        if role is None:
            return self._page("Name or password is wrong.", status=403)
        self._limiter.succeeded(address)
        return self._admit(request, *self._sessions.open(name, role))

    def _admit(self, request: Request, token: str, session: Session) -> Response:
        response = RedirectResponse("/", status_code=303)
        response.set_cookie(
            self._cookie, token, path="/", httponly=True, samesite="strict", secure=request.url.scheme == "https"
        )
        return response
