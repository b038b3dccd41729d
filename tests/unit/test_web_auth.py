"""Sessions, one-time link, password users and the limit on attempts, without a server."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from web.auth import (
    SESSION_IDLE_S,
    AttemptLimiter,
    LoginLink,
    SessionStore,
    Users,
    UsersError,
    add_user,
)


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def token_of(link: LoginLink) -> str:
    return link.url.partition("token=")[2]


def test_link_works_once_and_is_replaced_by_a_new_one_in_the_same_private_file(tmp_path: Path) -> None:
    path = tmp_path / "login_url"
    link = LoginLink(path, "http://127.0.0.1:1")
    first = token_of(link)
    assert not link.consume("something else")
    assert link.consume(first)
    assert not link.consume(first)
    second = path.read_text().strip().partition("token=")[2]
    assert second != first
    assert link.consume(second)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_session_survives_a_restart_of_the_process_but_its_token_is_not_on_disk(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    clock = Clock()
    token, session = SessionStore(path, clock).open_by_link()
    assert token not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    restarted = SessionStore(path, clock)
    found = restarted.find(token)
    assert found is not None
    assert (found.name, found.role, found.csrf) == ("operator 1", "operator", session.csrf)
    assert restarted.open_by_link()[1].name == "operator 2"


def test_session_ends_after_idle_time_and_when_closed(tmp_path: Path) -> None:
    clock = Clock()
    store = SessionStore(tmp_path / "sessions.json", clock)
    token, _ = store.open("ada", "observer")
    clock.now_s += SESSION_IDLE_S - 1.0
    assert store.find(token) is not None
    clock.now_s += SESSION_IDLE_S - 1.0
    assert store.find(token) is not None
    clock.now_s += SESSION_IDLE_S + 1.0
    assert store.find(token) is None
    token, session = store.open("ada", "observer")
    store.close(session)
    assert store.find(token) is None
    assert not store.is_open(session)


def test_damaged_session_file_means_nobody_is_logged_in(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    token, _ = SessionStore(path, Clock()).open("ada", "operator")
    path.write_text(path.read_text()[:40])
    assert SessionStore(path, Clock()).find(token) is None


def test_password_users(tmp_path: Path) -> None:
    path = tmp_path / "config" / "users.toml"
    add_user(path, "ada", "observer", "correct horse")
    add_user(path, "grace h.", "operator", "battery staple")
    users = Users.load(path)
    assert users.check("ada", "correct horse") == "observer"
    assert users.check("grace h.", "battery staple") == "operator"
    assert users.check("ada", "battery staple") is None
    assert users.check("nobody", "correct horse") is None
    assert "correct horse" not in path.read_text()
    with pytest.raises(UsersError, match="exists already"):
        add_user(path, "ada", "operator", "x")
    with pytest.raises(UsersError, match="not usable"):
        add_user(path, 'a"]\nrole', "operator", "x")


def test_no_users_file_admits_nobody(tmp_path: Path) -> None:
    assert Users.load(tmp_path / "none.toml").check("", "") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[users.ada]\nrole = "admiral"\npassword_argon2 = "x"', "role"),
        ('[users.ada]\nrole = "observer"\npassword_argon2 = "secret"', "users.ada.password_argon2"),
        ('[users.ada]\nrole = "observer"\npassword = "secret"', "password"),
        ("[users", "users.toml"),
    ],
)
def test_wrong_users_file_names_file_and_key(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "users.toml"
    path.write_text(text)
    with pytest.raises(UsersError, match=words) as caught:
        Users.load(path)
    assert str(path) in str(caught.value)


def test_sixth_attempt_of_an_address_waits_and_others_do_not() -> None:
    clock = Clock()
    limiter = AttemptLimiter(clock)
    for _ in range(5):
        assert limiter.wait_s("10.0.0.1") == 0.0
        limiter.failed("10.0.0.1")
        clock.now_s += 1.0
    assert limiter.wait_s("10.0.0.1") == pytest.approx(55.0)
    assert limiter.wait_s("10.0.0.2") == 0.0
    clock.now_s += 56.0
    assert limiter.wait_s("10.0.0.1") == 0.0


def test_success_is_not_held_against_an_address_and_many_addresses_are_limited_together() -> None:
    limiter = AttemptLimiter(Clock())
    for _ in range(20):
        limiter.failed("10.0.0.1")
        limiter.succeeded("10.0.0.1")
    assert limiter.wait_s("10.0.0.1") == 0.0
    for number in range(30):
        limiter.failed(f"10.0.1.{number}")
    assert limiter.wait_s("10.0.0.1") > 0.0
