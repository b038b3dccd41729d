"""Recorded runs on disk, as a list for the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

_SUMMARY = "run.json"


def list_runs(folder: Path) -> list[dict[str, Any]]:
    """Run folders, newest first: name, size and the plain facts of ``run.json``, none if it is damaged."""
    if not folder.is_dir():
        return []
    runs = [path for path in folder.iterdir() if (path / _SUMMARY).is_file()]
    return [_describe(path) for path in sorted(runs, key=lambda path: path.name, reverse=True)]


def _describe(path: Path) -> dict[str, Any]:
    size_bytes = sum(entry.stat().st_size for entry in path.iterdir() if entry.is_file())
    try:
        summary = msgspec.json.decode((path / _SUMMARY).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        summary = {}
    facts = {key: value for key, value in summary.items() if not isinstance(value, dict | list)}
    return {"name": path.name, "bytes": size_bytes, "summary": facts}
