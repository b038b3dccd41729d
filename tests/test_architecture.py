"""The house holds: upper floors import lower ones, rooms of one floor are strangers, truth stays in the simulator."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Which packages a package may import. Nothing else of this project.
ARROWS: dict[str, set[str]] = {
    "models": {"models"},
    "estimators": {"models", "estimators"},
    "controllers": {"models", "controllers"},
    "sitl": {"models", "sitl"},
    "gcs": {"models", "estimators", "controllers", "sitl", "gcs"},
    "web": {"models", "estimators", "controllers", "sitl", "gcs", "web"},
}

# Simulated truth shares parameters and rigid-body kinematics with the models, never what estimators or controllers use.
SITL_MAY_SHARE = {
    "models.parameters",
    "models.rigid_body",
    "models.frames",
    "models.kernel",
    "models.atmosphere",
}

FORBIDDEN_NAMES = {"utils", "helpers", "common", "misc", "manager"}


def modules(package: str) -> list[Path]:
    return sorted(p for p in (ROOT / package).rglob("*.py") if "node_modules" not in p.parts)


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the floor"
            assert node.module is not None
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("package", ARROWS)
def test_arrows(package: str) -> None:
    paths = modules(package)
    assert paths
    for path in paths:
        for name in imports(path):
            top = name.split(".")[0]
            assert top not in ARROWS or top in ARROWS[package], f"{path.relative_to(ROOT)} imports {name}"


def test_simulator_speaks_mavlink_by_itself_and_shares_no_model() -> None:
    for path in modules("sitl"):
        for name in imports(path):
            if name.startswith("models."):
                assert ".".join(name.split(".")[:2]) in SITL_MAY_SHARE, f"{path.relative_to(ROOT)} imports {name}"


def test_estimators_never_see_truth() -> None:
    for path in modules("estimators"):
        assert "truth" not in path.read_text().lower().replace("ground truth", ""), path
        assert not any(name.startswith(("sitl", "pymavlink")) for name in imports(path)), path


def test_flight_path_imports_no_front_end_and_no_bus() -> None:
    for path in [*modules("gcs/offboard"), ROOT / "gcs/flight.py", ROOT / "gcs/telemetry.py", *modules("gcs/mavlink")]:
        for name in imports(path):
            assert name.split(".")[0] not in {"zenoh", "fastapi", "viser", "mavsdk", "mcap", "asyncio"}, (path, name)


def test_mavutil_stays_out_of_the_product() -> None:
    for package in ARROWS:
        for path in modules(package):
            assert not any("mavutil" in name for name in imports(path)), path


def test_names() -> None:
    for package in ARROWS:
        for path in modules(package):
            assert path.stem not in FORBIDDEN_NAMES, path


def test_nothing_imports_tests() -> None:
    for package in ARROWS:
        for path in modules(package):
            assert not any(name.split(".")[0] in {"tests", "benchmarks", "examples"} for name in imports(path)), path
