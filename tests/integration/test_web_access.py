"""Who gets in: a real server, real HTTP and WebSocket clients."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
import websockets
from websockets.datastructures import Headers

from tests.integration.web_rig import Rig
from web.__main__ import main


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with Rig(tmp_path_factory.mktemp("web")) as running:
        yield running


def test_link_logs_in_once_and_says_what_to_do_the_second_time(rig: Rig) -> None:
    token = rig.server.token
    with rig.server.browser() as first, rig.server.browser() as second:
        for _ in range(2):  # Looking at the link, as a prefetch does, uses nothing up.
            page = first.http.get("/login", params={"token": token})
            assert page.status_code == 200
            assert token in page.text
        entered = first.enter(token=token)
        assert entered.status_code == 303
        assert entered.headers["location"] == "/"
        cookie = entered.headers["set-cookie"].lower()
        assert "httponly" in cookie and "samesite=strict" in cookie and "path=/" in cookie
        again = second.enter(token=token)
        assert again.status_code == 403
        assert "has been used" in again.text and "gcs login" in again.text
        assert second.http.get("/api/session").status_code == 401
        assert rig.server.token != token
        assert second.enter(token=rig.server.token).status_code == 303
        assert first.http.get("/api/session").json()["name"] != second.http.get("/api/session").json()["name"]


@pytest.mark.parametrize(
    "path",
    ["/api/session", "/api/signals", "/api/status", "/api/events", "/api/gains", "/api/trajectories", "/api/runs"]
    + ["/api/openapi.json", "/api/docs", "/static/app.js", "/scene/", "/scene/bridge.js", "/"],
)
def test_nothing_without_a_session(rig: Rig, path: str) -> None:
    with rig.server.browser() as stranger:
        assert stranger.http.get(path).status_code == 401
        page = stranger.http.get(path, headers={"Accept": "text/html,*/*"})
        assert page.status_code == 303
        assert page.headers["location"] == "/login"
        assert stranger.post(path, {}).status_code == 401


@pytest.mark.parametrize("path", ["/ws/stream", "/scene"])
def test_no_stream_without_session_or_from_another_origin(rig: Rig, path: str) -> None:
    with rig.server.browser() as stranger:
        with pytest.raises(websockets.InvalidStatus) as refused:
            stranger.socket(path)
        assert refused.value.response.status_code == 403
    with rig.server.operator() as browser:
        port = browser.base.rpartition(":")[2]
        elsewhere = ["http://evil.example", f"http://localhost:{port}", f"https://127.0.0.1:{port}", "null", None]
        for origin in elsewhere:
            with pytest.raises(websockets.InvalidStatus) as refused:
                browser.socket(path, origin=origin)
            assert refused.value.response.status_code == 403


def test_state_changes_need_origin_and_csrf_token(rig: Rig) -> None:
    with rig.server.operator() as browser:
        before = len(rig.hub.requests)
        for headers in (
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
            {"Origin": browser.base + ".evil.example"},
            {"X-CSRF-Token": ""},
            {"X-CSRF-Token": browser.csrf[:-1] + "~"},
        ):
            answer = browser.post("/api/commands", {"type": "hold"}, **headers)
            assert answer.status_code == 403, headers
            assert "Refused" in answer.json()["detail"]
        bare = browser.http.post("/api/commands", json={"type": "hold"})
        assert bare.status_code == 403
        assert len(rig.hub.requests) == before


def test_token_of_another_session_is_no_csrf_token(rig: Rig) -> None:
    with rig.server.operator() as one, rig.server.operator() as other:
        answer = one.post("/api/commands", {"type": "hold"}, **{"X-CSRF-Token": other.csrf})
        assert answer.status_code == 403


def test_other_host_names_are_not_answered(rig: Rig) -> None:
    with rig.server.operator() as browser:
        answer = browser.http.get("/api/session", headers={"Host": "evil.example"})
        assert answer.status_code == 421
        assert "csrf" not in answer.text


def test_observer_watches_and_gives_no_commands(rig: Rig) -> None:
    with rig.server.browser() as observer:
        assert observer.enter(name="ada", password="watch only").status_code == 303
        assert observer.http.get("/api/session").json()["role"] == "observer"
        before = len(rig.hub.requests)
        for command in ("hold", "land", "take_controls"):
            answer = observer.post("/api/commands", {"type": command})
            assert answer.status_code == 403
            assert "operator" in answer.json()["detail"]
        assert len(rig.hub.requests) == before
        with observer.socket("/ws/stream") as stream:
            assert '"hello"' in str(stream.recv(timeout=10.0))


def test_large_or_endless_bodies_are_refused(rig: Rig) -> None:
    with rig.server.operator() as browser:
        assert browser.post("/api/commands", {"type": "mark_event", "note": "x" * 70000}).status_code == 413
        chunked = browser.http.post(
            "/api/commands",
            content=iter([b"{", b"}"]),
            headers={**browser.origin, "X-CSRF-Token": browser.csrf},
        )
        assert chunked.status_code == 413


def test_logging_out_ends_session_and_stream(rig: Rig) -> None:
    with rig.server.operator() as browser, browser.socket("/ws/stream") as stream:
        stream.recv(timeout=10.0)
        assert browser.post("/api/logout", {}).status_code == 200
        assert browser.http.get("/api/session").status_code == 401
        with pytest.raises(websockets.ConnectionClosed):
            while True:
                stream.recv(timeout=20.0)


def policy_of(headers: Headers | dict[str, str]) -> str:
    return str(headers["content-security-policy"])


def test_security_headers(rig: Rig) -> None:
    with rig.server.operator() as browser:
        host = browser.base.removeprefix("http://")
        for path in ("/", "/login", "/api/session", "/static/none"):
            answer = browser.http.get(path)
            assert policy_of(answer.headers) == (
                "default-src 'none'; script-src 'self'; style-src 'self'; font-src 'self'; img-src 'self' data:; "
                f"connect-src 'self' ws://{host} wss://{host}; worker-src 'self'; frame-src 'self'; "
                "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
            )
            assert answer.headers["x-frame-options"] == "DENY"
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["referrer-policy"] == "same-origin"
            assert answer.headers["cross-origin-opener-policy"] == "same-origin"
            assert "server" not in answer.headers


def test_guessing_passwords_is_slowed_down(tmp_path: Path) -> None:
    with Rig(tmp_path) as fresh, fresh.server.browser() as browser:
        for number in range(5):
            wrong = browser.enter(name="ada", password=f"guess {number}")
            assert wrong.status_code == 403
            assert "Name or password is wrong" in wrong.text
        waiting = browser.enter(name="ada", password="watch only")
        assert waiting.status_code == 429
        assert 0 < int(waiting.headers["retry-after"]) <= 60


def test_what_cannot_be_served_is_said_and_ends_with_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runtime = ["--runtime", str(tmp_path / "rt")]
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        assert main([*runtime, "--port", port]) == 2
        assert f"port {port} on 127.0.0.1" in capsys.readouterr().err
    assert main([*runtime, "--host", "0.0.0.0"]) == 2
    assert "--tls-cert" in capsys.readouterr().err
    assert main([*runtime, "--host", "nowhere"]) == 2
    assert "--host nowhere" in capsys.readouterr().err
    users = tmp_path / "users.toml"
    users.write_text("[users.ada]\nrole = 1\n")
    assert main([*runtime, "--users", str(users)]) == 2
    assert str(users) in capsys.readouterr().err
