"""World Magnetic Model against its published test values, and against the dipole it must contain."""

from __future__ import annotations

import math

import pytest

from models.frames import Geodetic
from models.magnetic_field import earth_field_ned_t


@pytest.mark.parametrize(
    ("height_km", "latitude_deg", "longitude_deg", "declination_deg", "intensity_nt"),
    [(66, 14, 143, -0.19, 35898.700342), (18, 0, 21, 1.29, 32594.761714), (39, -59, -8, -15.75, 28589.818346)],
)
def test_published_test_values(
    height_km: float, latitude_deg: float, longitude_deg: float, declination_deg: float, intensity_nt: float
) -> None:
    place = Geodetic(math.radians(latitude_deg), math.radians(longitude_deg), 1e3 * height_km)
    north, east, down = earth_field_ned_t(place, 2025.0)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(declination_deg, abs=0.006)
    assert 1e9 * math.hypot(north, east, down) == pytest.approx(intensity_nt, abs=0.01)


def test_field_is_continuous_across_the_date_line_and_finite_at_the_pole() -> None:
    west = earth_field_ned_t(Geodetic(0.3, -math.pi, 0.0), 2026.0)
    east = earth_field_ned_t(Geodetic(0.3, math.pi, 0.0), 2026.0)
    assert west == pytest.approx(east, abs=1e-15)
    pole = earth_field_ned_t(Geodetic(math.pi / 2, 0.2, 0.0), 2026.0)
    assert all(math.isfinite(value) for value in pole)
    assert 5.5e-5 < math.hypot(*pole) < 6.0e-5
