"""Compile every numba kernel now, with a progress bar, so that no flight waits for a compiler."""

from __future__ import annotations

import importlib
import pkgutil
import time

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


def main() -> None:
    """Import the kernel modules one by one: explicit signatures make the import compile or load the cache."""
    started = time.monotonic()
    names = kernel_modules()
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
