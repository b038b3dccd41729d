"""What a bit-for-bit replay depends on outside the recording: processor, BLAS kernel, package versions."""

from __future__ import annotations

import ctypes
import importlib.metadata
import platform
import sys
from functools import cache
from pathlib import Path

import numpy as np

_PACKAGES = ("rotorlab", "numpy", "scipy", "numba", "llvmlite", "pymavlink", "mavsdk", "eclipse-zenoh", "msgspec")
_CORE_NAME_SYMBOLS = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")


@cache
def package_versions() -> dict[str, str]:
    """Versions of what computes a flight; a package that is not installed as such is left out."""
    versions = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


@cache
def describe_machine() -> dict[str, str]:
    """Processor and the kernel OpenBLAS chose for it ("unknown" where it does not say)."""
    return {
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "processor": _processor(),
        "blas_core": _blas_core(),
    }


def _processor() -> str:
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _blas_core() -> str:
    """Core type of the OpenBLAS that comes inside numpy's wheel."""
    package = Path(np.__file__).parent
    for library in sorted([*(package.parent / "numpy.libs").glob("*openblas*"), *package.glob(".dylibs/*openblas*")]):
        loaded = ctypes.CDLL(str(library))
        for symbol in _CORE_NAME_SYMBOLS:
            core_name = getattr(loaded, symbol, None)
            if core_name is not None:
                core_name.restype = ctypes.c_char_p
                core_name.argtypes = []
                return bytes(core_name()).decode("ascii", "replace")
    return "unknown"
