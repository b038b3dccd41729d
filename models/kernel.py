"""One typed door to numba: every kernel states its signature, so it is ready at import and never compiles in flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")


def kernel(signature: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for one explicit numba signature, such as ``"f8[::1](f8[::1], f8)"``.

    The explicit signature makes compilation eager: importing a module compiles its kernels or loads them from
    the cache on disk, so nothing is left to compile once telemetry streams. The Python original stays reachable
    as ``function.py_func`` for the readable twin in the tests.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        compiled: Callable[P, R] = numba.njit(signature, cache=True, nogil=True, error_model="numpy")(function)
        return compiled

    return decorate
