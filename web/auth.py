"""Who may come in: the one-time login link, password users, sessions and their CSRF tokens.

Secrets are compared in constant time. Sessions are kept on disk as SHA-256 digests in the runtime folder (mode 0700),
so that a web process restarted by its supervisor in flight does not throw its operator out.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import tomllib
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import argon2
import msgspec

from gcs.commands import Identity

Role = Literal["observer", "operator"]
Clock = Callable[[], float]

SESSION_IDLE_S = 12.0 * 3600.0
_SAVE_EVERY_S = 600.0
_ATTEMPTS_PER_CLIENT = 5
_ATTEMPTS_IN_ALL = 30
_ATTEMPT_WINDOW_S = 60.0


class UsersError(ValueError):
    """A users file that cannot be used; the message names file, key and what is wrong."""


def write_private(path: Path, text: str) -> None:
    """Replace a file atomically, readable by its owner alone (mode 0600)."""
    draft = path.with_name(path.name + ".new")
    draft.unlink(missing_ok=True)
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as stream:
        stream.write(text)
    draft.replace(path)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


class Session(msgspec.Struct):
    """One logged-in browser. ``token_sha256`` identifies it; the token itself is known to the browser alone."""

    token_sha256: str
    name: str
    role: Role
    csrf: str
    used_s: float

    @property
    def client(self) -> str:
        """Short public identifier of this browser session, as written into the recording."""
        return f"browser-{self.token_sha256[:8]}"

    @property
    def identity(self) -> Identity:
        return Identity(name=self.name, role=self.role, client=self.client)


class _Saved(msgspec.Struct):
    sessions: list[Session]
    links_used: int


class SessionStore:
    """Sessions by token, dropped after twelve idle hours, kept in one private file."""

    def __init__(self, path: Path, clock_s: Clock) -> None:
        self._path = path
        self._clock_s = clock_s
        self._saved_s = clock_s()
        self._sessions: dict[str, Session] = {}
        self._links_used = 0
        try:
            saved = msgspec.json.decode(path.read_bytes(), type=_Saved)
        except (FileNotFoundError, msgspec.DecodeError):
            return
        self._sessions = {session.token_sha256: session for session in saved.sessions}
        self._links_used = saved.links_used

    def open(self, name: str, role: Role) -> tuple[str, Session]:
        """A new session and its token, which is returned this once only."""
        token = secrets.token_urlsafe(32)
        session = Session(_digest(token), name, role, secrets.token_urlsafe(32), self._clock_s())
        self._sessions[session.token_sha256] = session
        self._save()
        return token, session

    def open_by_link(self) -> tuple[str, Session]:
        """A session for whoever held the one-time link: ``operator 1``, ``operator 2``, ..."""
        self._links_used += 1
        return self.open(f"operator {self._links_used}", "operator")

    def find(self, token: str) -> Session | None:
        """The live session of a token, its idle time set back to zero."""
        session = self._sessions.get(_digest(token))
        now_s = self._clock_s()
        if session is None or now_s - session.used_s > SESSION_IDLE_S:
            return None
        session.used_s = now_s
        if now_s - self._saved_s > _SAVE_EVERY_S:
            self._save()
        return session

    def is_open(self, session: Session) -> bool:
        return session.token_sha256 in self._sessions

    def close(self, session: Session) -> None:
        self._sessions.pop(session.token_sha256, None)
        self._save()

    def _save(self) -> None:
        now_s = self._clock_s()
        self._saved_s = now_s
        self._sessions = {k: s for k, s in self._sessions.items() if now_s - s.used_s <= SESSION_IDLE_S}
        saved = _Saved(list(self._sessions.values()), self._links_used)
        write_private(self._path, msgspec.json.encode(saved).decode())


class LoginLink:
    """A link that logs in once. When it has been used, the next one is written into the same private file."""

    def __init__(self, path: Path, base_url: str) -> None:
        self._path = path
        self._base_url = base_url
        self._token = ""
        self._renew()

    @property
    def url(self) -> str:
        return f"{self._base_url}/login?token={self._token}"

    def consume(self, token: str) -> bool:
        """True once per link; false for any other token, and then the link stays valid."""
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return False
        self._renew()
        return True

    def _renew(self) -> None:
        self._token = secrets.token_urlsafe(32)
        write_private(self._path, self.url + "\n")


class User(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One entry of the users file."""

    role: Role
    password_argon2: str


class _UsersFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    users: dict[str, User]


class Users:
    """Password users of a TOML file: ``[users.NAME]`` with ``role`` and ``password_argon2``."""

    def __init__(self, users: dict[str, User]) -> None:
        self._users = users
        self._hasher = argon2.PasswordHasher()
        # Unknown names are checked against this, so that the time of the answer does not tell which names exist.
        self._nobody = User("observer", self._hasher.hash(secrets.token_urlsafe(16))) if users else None

    @classmethod
    def load(cls, path: Path) -> Users:
        """Read a users file; without a file there are no password users. Raises UsersError."""
        try:
            text = path.read_text()
        except FileNotFoundError:
            return cls({})
        except OSError as error:
            raise UsersError(f"{path}: cannot be read: {error.strerror}") from error
        try:
            users = msgspec.convert(tomllib.loads(text), _UsersFile).users
        except (tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
            raise UsersError(f"{path}: {error}; expected [users.NAME] with role and password_argon2") from error
        for name, user in users.items():
            try:
                argon2.extract_parameters(user.password_argon2)
            except argon2.exceptions.InvalidHashError as error:
                raise UsersError(f"{path}: users.{name}.password_argon2 is not an argon2 hash") from error
        return cls(users)

    @property
    def any(self) -> bool:
        """Whether anyone can log in with a password at all."""
        return bool(self._users)

    def check(self, name: str, password: str) -> Role | None:
        """The role of a user whose password is right. Takes some 50 ms on purpose: run it in a thread."""
        user = self._users.get(name, self._nobody)
        if user is None:
            return None
        try:
            self._hasher.verify(user.password_argon2, password)
        except argon2.exceptions.VerificationError:
            return None
        return user.role if name in self._users else None


def add_user(path: Path, name: str, role: Role, password: str) -> None:
    """Append a password user to a users file. Raises UsersError if the name is taken or cannot be a name."""
    if not name or not all(letter.isalnum() or letter in " -_." for letter in name):
        raise UsersError(f"user name '{name}' is not usable: letters, digits, space, dot, dash and underscore only")
    Users.load(path)
    text = path.read_text() if path.exists() else ""
    if name in tomllib.loads(text).get("users", {}):
        raise UsersError(f"{path}: user '{name}' exists already")
    hashed = argon2.PasswordHasher().hash(password)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_private(path, f'{text}\n[users."{name}"]\nrole = "{role}"\npassword_argon2 = "{hashed}"\n'.lstrip())


class AttemptLimiter:
    """Failed logins in the last minute: five from one address, thirty in all, then everyone waits."""

    def __init__(self, clock_s: Clock) -> None:
        self._clock_s = clock_s
        self._failures: deque[tuple[float, str]] = deque()

    def wait_s(self, address: str) -> float:
        """Seconds until this address may try again; zero if it may now."""
        now_s = self._clock_s()
        while self._failures and now_s - self._failures[0][0] >= _ATTEMPT_WINDOW_S:
            self._failures.popleft()
        own_s = [failed_s for failed_s, client in self._failures if client == address]
        free_s = now_s
        if len(own_s) >= _ATTEMPTS_PER_CLIENT:
            free_s = own_s[-_ATTEMPTS_PER_CLIENT] + _ATTEMPT_WINDOW_S
        if len(self._failures) >= _ATTEMPTS_IN_ALL:
            free_s = max(free_s, self._failures[-_ATTEMPTS_IN_ALL][0] + _ATTEMPT_WINDOW_S)
        return max(0.0, free_s - now_s)

    def failed(self, address: str) -> None:
        self._failures.append((self._clock_s(), address))

    def succeeded(self, address: str) -> None:
        """Take back the newest failure of an address: its attempt turned out right."""
        for index in range(len(self._failures) - 1, -1, -1):
            if self._failures[index][1] == address:
                del self._failures[index]
                return
