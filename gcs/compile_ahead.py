"""Compile every numba kernel now, with a progress bar, so that no flight waits for a compiler.

numba's cache knows the file of a kernel but not the kernels that file imports: a change of any of them clears it whole.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
import time
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

PACKAGES = ("models", "estimators", "controllers", "sitl", "gcs")


def kernel_modules() -> list[str]:
    """Names of all modules whose source uses the kernel decorator, lowest floor first."""
    names: list[str] = []
    for package_name in PACKAGES:
        package = importlib.import_module(package_name)
        for found in pkgutil.walk_packages(package.__path__, package_name + "."):
            spec = found.module_finder.find_spec(found.name, None)
            if spec is None or spec.origin is None or found.name.endswith("__main__"):
                continue
            with open(spec.origin, encoding="utf-8") as source:
                if "models.kernel import" in source.read():
                    names.append(found.name)
    return names


def clear_stale_cache(names: list[str]) -> bool:
    """Delete the kernel cache if any kernel source differs from the one it was made of; True if it was deleted."""
    digest = hashlib.sha256()
    folders: set[Path] = set()
    for name in names:
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        path = Path(spec.origin)
        folders.add(path.parent / "__pycache__")
        digest.update(path.read_bytes())
    stamp = Path(__file__).parent / "__pycache__" / "kernels.sha256"
    if stamp.is_file() and stamp.read_text() == digest.hexdigest():
        return False
    for folder in folders:
        for pattern in ("*.nbi", "*.nbc"):
            for cached in folder.glob(pattern):
                cached.unlink(missing_ok=True)
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(digest.hexdigest())
    return True


def main() -> None:
    """Import the kernel modules one by one: explicit signatures make the import compile or load the cache."""
    started = time.monotonic()
    names = kernel_modules()
    clear_stale_cache(names)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console()) as progress:
        task = progress.add_task("compiling kernels", total=len(names))
        for name in names:
            progress.update(task, description=name)
            importlib.import_module(name)
            progress.advance(task)
        progress.update(task, description="kernels ready")
    print(f"{len(names)} kernel modules ready in {time.monotonic() - started:.1f} s")


if __name__ == "__main__":
    main()
