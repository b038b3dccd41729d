"""Kalman primitives that every filter here shares: the gated update in Joseph form, gate thresholds, covariance resets.

All kernels work in place on arrays owned by the caller, use explicit loops (the same bits on every BLAS), and treat
``covariance`` as symmetric.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from models.frames import Array
from models.kernel import kernel

MAX_ROWS = 6


def gate_thresholds(false_alarm: float) -> Array:
    """Chi-square thresholds of the NIS for 1 to 6 rows, shape (7,); entry 0 is unused.

    ``false_alarm`` is the probability that a good measurement is rejected.
    """
    thresholds = np.full(MAX_ROWS + 1, np.inf)
    thresholds[1:] = chdtri(np.arange(1, MAX_ROWS + 1), false_alarm)
    return thresholds


@kernel("b1(f8[:,::1], i8)")
def cholesky_in_place(matrix: Array, size: int) -> bool:
    """Lower Cholesky factor of the leading block, written over it; False if it is not positive definite."""
    for j in range(size):
        for i in range(j, size):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                matrix[j, j] = np.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    return True


@kernel("void(f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1])")
def innovation_covariance(covariance: Array, jacobian: Array, variance: Array, hp: Array, s: Array) -> None:
    """H P into ``hp`` (m, n) and S = H P H' + diag(variance) into ``s`` (m, m), of the first m rows of H."""
    rows, n = hp.shape
    hp[:, :] = 0.0
    s[:, :] = 0.0
    for r in range(rows):
        for k in range(n):
            h = jacobian[r, k]
            if h != 0.0:
                for j in range(n):
                    hp[r, j] += h * covariance[k, j]
    for r in range(rows):
        for c in range(rows):
            for k in range(n):
                s[r, c] += hp[r, k] * jacobian[c, k]
        s[r, r] += variance[r]


@kernel("f8(f8[:,::1], f8[::1])")
def normalised_square(factor: Array, innovation: Array) -> float:
    """e' S^-1 e from the lower Cholesky factor (m, m) of S and the first m entries of ``innovation``."""
    rows = factor.shape[0]
    white = np.empty(rows)
    total = 0.0
    for r in range(rows):
        entry = innovation[r]
        for k in range(r):
            entry -= factor[r, k] * white[k]
        white[r] = entry / factor[r, r]
        total += white[r] * white[r]
    return total


@kernel("void(f8[:,::1], f8[:,::1])")
def solve_rows(factor: Array, rows_of: Array) -> None:
    """S^-1 X in place of X = ``rows_of`` (m, n): forward and back substitution, inner loops along memory."""
    rows, n = rows_of.shape
    for r in range(rows):
        for k in range(r):
            for j in range(n):
                rows_of[r, j] -= factor[r, k] * rows_of[k, j]
        for j in range(n):
            rows_of[r, j] /= factor[r, r]
    for r in range(rows - 1, -1, -1):
        for k in range(r + 1, rows):
            for j in range(n):
                rows_of[r, j] -= factor[k, r] * rows_of[k, j]
        for j in range(n):
            rows_of[r, j] /= factor[r, r]


@kernel("b1(f8[:,::1], f8[::1], f8[:,::1], f8[::1], i8, f8, f8[::1], f8[::1])")
def joseph_update(
    covariance: Array,
    innovation: Array,
    jacobian: Array,
    variance: Array,
    rows: int,
    threshold: float,
    correction: Array,
    report: Array,
) -> bool:
    """Gated update with independent measurement rows, Raja (3.4)-(3.6) with the covariance in Joseph form.

    S = H P H' + diag(variance), K = P H' S^-1, dx = K e, P = (I - K H) P (I - K H)' + K R K', written as
    P - K (H P) - (H P)' K' + K S K'. Nothing changes when the NIS e' S^-1 e exceeds ``threshold``.

    ``innovation`` (6,), ``jacobian`` (6, n), ``variance`` (6,): the first ``rows`` are used. ``correction`` (n,)
    receives dx; ``report`` (8,) receives the NIS, NIS / threshold, and the diagonal of S. Returns whether it was
    accepted.
    """
    n = covariance.shape[0]
    hp = np.empty((rows, n))
    s = np.empty((rows, rows))
    innovation_covariance(covariance, jacobian, variance, hp, s)
    for r in range(rows):
        report[2 + r] = s[r, r]
    factor = s.copy()
    nis = normalised_square(factor, innovation) if cholesky_in_place(factor, rows) else np.inf
    report[0] = nis
    report[1] = nis / threshold
    if not nis <= threshold:
        return False
    gain = hp.copy()  # K' = S^-1 H P
    solve_rows(factor, gain)
    correction[:] = 0.0
    spread = np.zeros((rows, n))  # S K' - H P
    for r in range(rows):
        for j in range(n):
            correction[j] += gain[r, j] * innovation[r]
            spread[r, j] -= hp[r, j]
        for k in range(rows):
            for j in range(n):
                spread[r, j] += s[r, k] * gain[k, j]
    for i in range(n):
        for r in range(rows):
            left, right = spread[r, i], gain[r, i]
            for j in range(i, n):
                covariance[i, j] += left * gain[r, j] - right * hp[r, j]
        for j in range(i + 1, n):
            covariance[j, i] = covariance[i, j]
    return True


@kernel("void(f8[:,::1], i8, f8[::1])")
def reset_block(covariance: Array, first: int, variance: Array) -> None:
    """Forget what is known about some states: their rows and columns become zero, their diagonal ``variance`` (m,)."""
    n = covariance.shape[0]
    for r in range(variance.shape[0]):
        i = first + r
        for j in range(n):
            covariance[i, j] = 0.0
            covariance[j, i] = 0.0
    for r in range(variance.shape[0]):
        covariance[first + r, first + r] = variance[r]
