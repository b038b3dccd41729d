"""Wind: a steady mean and Dryden gusts (MIL-F-8785C, low altitude).

Scale lengths, h in feet within 10..1000:  L_w = h,  L_u = L_v = h / (.177 + .000823 h)^1.2;
intensities:  sigma_w / sigma_u = (.177 + .000823 h)^.4,  sigma_v = sigma_u, with sigma_u given.
Gust axes lie along the mean wind (north when calm). A hovering vehicle meets the frozen turbulence at the speed of the
air past it, so T = L / V with V the airspeed, at least 2 m/s. The mean does not change with height.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.frames import Array, Vec3
from models.kernel import kernel

GUST_STATES = 5
_SLOWEST_AIR_M_S = 2.0
_FOOT_M = 0.3048


class Wind(NamedTuple):
    """Mean wind, ned, where the air goes to [m/s], and the 1-sigma of horizontal gusts [m/s]."""

    mean_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    gust_sigma_m_s: float = 0.0


def wind_constants(wind: Wind) -> Array:
    """Mean (3), sigma, cosine and sine of the gust axes' heading: what the kernel takes, shape (6,)."""
    north, east, _ = wind.mean_ned_m_s
    heading = math.atan2(east, north)
    return np.array([*wind.mean_ned_m_s, wind.gust_sigma_m_s, math.cos(heading), math.sin(heading)])


@kernel("void(f8[::1], f8[::1], f8, f8, f8, f8[::1], f8[::1])")
def step_wind(
    gust: Array, constants: Array, height_m: float, airspeed_m_s: float, dt_s: float, noise: Array, wind_ned_m_s: Array
) -> None:
    """Advance the gust filters (5,) by ``dt_s`` with three unit normal draws and write the wind, ned [m/s].

    The along-wind filter is 1 / (1 + T s); the other two are (1 + sqrt(3) T s) / (1 + T s)^2, written as
    [sqrt(3) + (1 - sqrt(3)) / (1 + T s)] / sqrt(2) after a first-order process of unit variance:
    the variance is then one.
    """
    sigma = constants[3]
    if sigma <= 0.0:
        for i in range(3):
            wind_ned_m_s[i] = constants[i]
        return
    h_ft = max(10.0, min(1000.0, height_m / _FOOT_M))
    shape = 0.177 + 0.000823 * h_ft
    speed = max(_SLOWEST_AIR_M_S, airspeed_m_s)
    keep_u = math.exp(-dt_s * speed / (h_ft * _FOOT_M / shape**1.2))
    keep_w = math.exp(-dt_s * speed / (h_ft * _FOOT_M))
    drive_u = math.sqrt(1.0 - keep_u * keep_u)
    drive_w = math.sqrt(1.0 - keep_w * keep_w)
    gust[0] = keep_u * gust[0] + drive_u * noise[0]
    gust[2] += (1.0 - keep_u) * (gust[1] - gust[2])
    gust[1] = keep_u * gust[1] + drive_u * noise[1]
    gust[4] += (1.0 - keep_w) * (gust[3] - gust[4])
    gust[3] = keep_w * gust[3] + drive_w * noise[2]
    root3 = math.sqrt(3.0)
    along = sigma * gust[0]
    across = sigma * (root3 * gust[1] + (1.0 - root3) * gust[2]) / math.sqrt(2.0)
    down = sigma * shape**0.4 * (root3 * gust[3] + (1.0 - root3) * gust[4]) / math.sqrt(2.0)
    wind_ned_m_s[0] = constants[0] + constants[4] * along - constants[5] * across
    wind_ned_m_s[1] = constants[1] + constants[5] * along + constants[4] * across
    wind_ned_m_s[2] = constants[2] + down
