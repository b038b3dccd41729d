"""Frames, rotations and geodesy: the conventions every floor shares.

Frames
    ``ned``   north, east, down; local tangent plane at the origin.
    ``frd``   body: front, right, down.
Quaternions are ordered w, x, y, z and named ``ned_from_body``: they take body vectors to NED vectors.
Euler angles are the 3-2-1 set roll, pitch, yaw of Raja (2.1)-(2.6). Everything is SI and radians.

Units inside the project (degrees, degE7, mm, cm, mG and hPa are converted once, at the codec):

    position, height, range   m          angle                 rad
    velocity                  m/s        angular rate          rad/s
    acceleration              m/s^2      magnetic flux density T
    pressure                  Pa         temperature           K
    force                     N          torque                N m
    mass                      kg         time                  s (vehicle clock)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.arrays import Array as Array
from models.arrays import Quaternion as Quaternion
from models.arrays import Vec3 as Vec3
from models.kernel import kernel

STANDARD_GRAVITY_M_S2 = 9.80665
WGS84_SEMI_MAJOR_M = 6378137.0
WGS84_FLATTENING = 1.0 / 298.257223563


@kernel("f8(f8)")
def wrap_angle(angle_rad: float) -> float:
    """Angle folded into [-pi, pi) [rad]."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@kernel("f8[:,::1](f8[::1])")
def rotation_from_quaternion(ned_from_body: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion w, x, y, z; Raja (2.6)."""
    w, x, y, z = ned_from_body[0], ned_from_body[1], ned_from_body[2], ned_from_body[3]
    r = np.empty((3, 3))
    r[0, 0] = w * w + x * x - y * y - z * z
    r[0, 1] = 2.0 * (x * y - w * z)
    r[0, 2] = 2.0 * (x * z + w * y)
    r[1, 0] = 2.0 * (x * y + w * z)
    r[1, 1] = w * w - x * x + y * y - z * z
    r[1, 2] = 2.0 * (y * z - w * x)
    r[2, 0] = 2.0 * (x * z - w * y)
    r[2, 1] = 2.0 * (y * z + w * x)
    r[2, 2] = w * w - x * x - y * y + z * z
    return r


@kernel("f8[::1](f8, f8, f8)")
def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Unit quaternion w, x, y, z from 3-2-1 Euler angles [rad]; Raja (2.5)."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    q = np.empty(4)
    q[0] = cr * cp * cy + sr * sp * sy
    q[1] = sr * cp * cy - cr * sp * sy
    q[2] = cr * sp * cy + sr * cp * sy
    q[3] = cr * cp * sy - sr * sp * cy
    return q


@kernel("f8[::1](f8[::1])")
def euler_from_quaternion(ned_from_body: Array) -> Array:
    """Roll, pitch, yaw [rad] of a unit quaternion; pitch is clipped to [-pi/2, pi/2]."""
    w, x, y, z = ned_from_body[0], ned_from_body[1], ned_from_body[2], ned_from_body[3]
    e = np.empty(3)
    e[0] = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    e[1] = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    e[2] = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return e


@kernel("f8[::1](f8[::1], f8[::1])")
def quaternion_multiply(left: Array, right: Array) -> Array:
    """Hamilton product left * right, shape (4,)."""
    a, b, c, d = left[0], left[1], left[2], left[3]
    w, x, y, z = right[0], right[1], right[2], right[3]
    q = np.empty(4)
    q[0] = a * w - b * x - c * y - d * z
    q[1] = a * x + b * w + c * z - d * y
    q[2] = a * y - b * z + c * w + d * x
    q[3] = a * z + b * y - c * x + d * w
    return q


@kernel("f8[::1](f8[::1])")
def quaternion_from_rotation_vector(rotation_rad: Array) -> Array:
    """Unit quaternion of a rotation vector [rad] (exponential map), exact for any angle."""
    x, y, z = rotation_rad[0], rotation_rad[1], rotation_rad[2]
    angle = math.sqrt(x * x + y * y + z * z)
    half_sinc = 0.5 - angle * angle / 48.0 if angle < 1e-6 else math.sin(0.5 * angle) / angle
    q = np.empty(4)
    q[0] = math.cos(0.5 * angle)
    q[1] = half_sinc * x
    q[2] = half_sinc * y
    q[3] = half_sinc * z
    return q


class Geodetic(NamedTuple):
    """Latitude and longitude [rad], height above mean sea level [m]."""

    latitude_rad: float
    longitude_rad: float
    height_m: float


def ned_from_geodetic(point: Geodetic, origin: Geodetic) -> Vec3:
    """Local NED position [m] of a point about an origin, by the WGS-84 radii of curvature at the origin.

    Good to a millimetre within a kilometre and to .1 m within ten; raises nothing.
    """
    sin_lat = math.sin(origin.latitude_rad)
    eccentricity_sq = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    w = math.sqrt(1.0 - eccentricity_sq * sin_lat * sin_lat)
    meridian_m = WGS84_SEMI_MAJOR_M * (1.0 - eccentricity_sq) / (w * w * w)
    normal_m = WGS84_SEMI_MAJOR_M / w
    return (
        (point.latitude_rad - origin.latitude_rad) * (meridian_m + origin.height_m),
        wrap_angle(point.longitude_rad - origin.longitude_rad)
        * (normal_m + origin.height_m)
        * math.cos(origin.latitude_rad),
        origin.height_m - point.height_m,
    )


def geodetic_from_ned(position_ned_m: Vec3, origin: Geodetic) -> Geodetic:
    """Inverse of :func:`ned_from_geodetic`."""
    sin_lat = math.sin(origin.latitude_rad)
    eccentricity_sq = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    w = math.sqrt(1.0 - eccentricity_sq * sin_lat * sin_lat)
    meridian_m = WGS84_SEMI_MAJOR_M * (1.0 - eccentricity_sq) / (w * w * w)
    normal_m = WGS84_SEMI_MAJOR_M / w
    north, east, down = position_ned_m
    return Geodetic(
        origin.latitude_rad + north / (meridian_m + origin.height_m),
        origin.longitude_rad + east / ((normal_m + origin.height_m) * math.cos(origin.latitude_rad)),
        origin.height_m - down,
    )
