"""The runtime folder is private, its sockets fit, and one station holds it."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from gcs.runtime import RuntimeFolderError, default_folder, hold_lock, open_runtime


def test_a_new_folder_is_private(tmp_path: Path) -> None:
    runtime = open_runtime(tmp_path / "a" / "b")
    assert stat.S_IMODE(runtime.folder.stat().st_mode) == 0o700
    assert runtime.flight_socket.parent == runtime.folder


def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "open"
    folder.mkdir(mode=0o755)
    with pytest.raises(RuntimeFolderError, match="others may enter"):
        open_runtime(folder)


def test_a_file_or_a_link_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RuntimeFolderError):
        open_runtime(tmp_path / "file")
    (tmp_path / "private").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "private")
    with pytest.raises(RuntimeFolderError, match="not a folder"):
        open_runtime(tmp_path / "link")


def test_a_path_too_long_for_a_socket_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuntimeFolderError, match="too long for a socket by"):
        open_runtime(tmp_path / ("x" * 120))


def test_the_default_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert default_folder() == tmp_path / "rotorlab"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_folder().name == f"rotorlab-{os.getuid()}"


def test_one_station_holds_the_folder(tmp_path: Path) -> None:
    runtime = open_runtime(tmp_path / "r")
    lock = hold_lock(runtime)
    with pytest.raises(RuntimeFolderError, match=f"process {os.getpid()}"):
        hold_lock(runtime)
    os.close(lock)
    os.close(hold_lock(runtime))
