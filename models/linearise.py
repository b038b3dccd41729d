"""Linearisation of a nonlinear model about an operating point, Raja (4.8)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from models.frames import Array


def linearise(
    derivative: Callable[[Array, Array], Array], state: Array, inputs: Array, *, relative_step: float = 1e-6
) -> tuple[Array, Array]:
    """A = df/dx (n, n) and B = df/du (n, m) of ``derivative(x, u)`` at ``state`` (n,), ``inputs`` (m,); Raja (4.8).

    Central differences with a step of ``relative_step`` times max(1, |x_i|); exact to about 1e-9 of the largest term.
    """
    return (
        _central_differences(lambda x: derivative(x, inputs), state, relative_step),
        _central_differences(lambda u: derivative(state, u), inputs, relative_step),
    )


def _central_differences(function: Callable[[Array], Array], at: Array, relative_step: float) -> Array:
    columns = []
    for index in range(at.size):
        step = relative_step * max(1.0, abs(float(at[index])))
        upper, lower = at.copy(), at.copy()
        upper[index] += step
        lower[index] -= step
        columns.append((function(upper) - function(lower)) / (upper[index] - lower[index]))
    return np.column_stack(columns)
