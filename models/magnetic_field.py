"""The Earth's magnetic field from a geodetic position: World Magnetic Model 2025, degree 12 (public domain, NOAA/BGS).

A station that knows where its vehicle is needs nobody to tell it the declination.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np

from models.frames import WGS84_FLATTENING, WGS84_SEMI_MAJOR_M, Array, Geodetic, Vec3

COEFFICIENT_FILE = Path(__file__).parent / "params" / "wmm2025.cof"
REFERENCE_RADIUS_M = 6371200.0
EPOCH_YEAR = 2025.0
DEGREE = 12


@cache
def _coefficients() -> Array:
    """Schmidt semi-normalised Gauss coefficients [nT, nT/year], shape (4, 13, 13): g, h, and their rates."""
    table = np.zeros((4, DEGREE + 1, DEGREE + 1))
    for line in COEFFICIENT_FILE.read_text().splitlines()[1:]:
        n, m, *values = line.split()
        table[:, int(n), int(m)] = [float(value) for value in values]
    return table


def _schmidt_legendre(sin_latitude: float) -> tuple[Array, Array]:
    """Schmidt semi-normalised P[n, m] of the geocentric latitude and dP/d(latitude), each shape (13, 13)."""
    x, z = sin_latitude, math.sqrt(max(1.0 - sin_latitude * sin_latitude, 1e-20))
    p = np.zeros((DEGREE + 1, DEGREE + 1))
    dp = np.zeros_like(p)
    p[0, 0] = 1.0
    for n in range(1, DEGREE + 1):
        scale = math.sqrt((2.0 * n - 1.0) / (2.0 * n)) if n > 1 else 1.0
        p[n, n] = scale * z * p[n - 1, n - 1]
        dp[n, n] = scale * (z * dp[n - 1, n - 1] - x * p[n - 1, n - 1])
        for m in range(n):
            root = math.sqrt(n * n - m * m)
            k = math.sqrt((n - 1.0) ** 2 - m * m) if n - 1 > m else 0.0
            p[n, m] = ((2.0 * n - 1.0) * x * p[n - 1, m] - k * p[n - 2, m]) / root
            dp[n, m] = ((2.0 * n - 1.0) * (x * dp[n - 1, m] + z * p[n - 1, m]) - k * dp[n - 2, m]) / root
    return p, dp


def earth_field_ned_t(place: Geodetic, year: float) -> Vec3:
    """Magnetic flux density [T], north east down, at a place in a decimal year; WMM2025 report, eqs. (5)-(18).

    The model is meant for 2025.0 to 2030.0; outside these years its linear secular change is extrapolated. The height
    above sea level stands for the height above the ellipsoid (60 m change the field by 3e-5 of itself).
    """
    g0, h0, g1, h1 = _coefficients()
    g = g0 + (year - EPOCH_YEAR) * g1
    h = h0 + (year - EPOCH_YEAR) * h1
    sin_lat, cos_lat = math.sin(place.latitude_rad), math.cos(place.latitude_rad)
    e2 = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    normal_m = WGS84_SEMI_MAJOR_M / math.sqrt(1.0 - e2 * sin_lat * sin_lat)
    axis_m = (normal_m + place.height_m) * cos_lat
    polar_m = (normal_m * (1.0 - e2) + place.height_m) * sin_lat
    radius_m = math.hypot(axis_m, polar_m)
    geocentric_rad = math.asin(polar_m / radius_m)
    p, dp = _schmidt_legendre(math.sin(geocentric_rad))
    order = np.arange(DEGREE + 1)
    cos_m, sin_m = np.cos(order * place.longitude_rad), np.sin(order * place.longitude_rad)
    degree = np.arange(DEGREE + 1)[:, None]
    ratio = (REFERENCE_RADIUS_M / radius_m) ** (degree + 2.0)
    in_phase = g * cos_m + h * sin_m
    quadrature = g * sin_m - h * cos_m
    north = -float(np.sum(ratio * in_phase * dp))
    east = float(np.sum(ratio * order * quadrature * p)) / max(math.cos(geocentric_rad), 1e-10)
    down = -float(np.sum(ratio * (degree + 1.0) * in_phase * p))
    tilt = geocentric_rad - place.latitude_rad
    return (
        1e-9 * (north * math.cos(tilt) - down * math.sin(tilt)),
        1e-9 * east,
        1e-9 * (north * math.sin(tilt) + down * math.cos(tilt)),
    )
