"""The one table of signals: name, unit, shape, description. Recorder, stream, dashboard and reports use it.

A frame of signals is one flat float64 vector in table order; NaN means "no value now". Nobody invents a key.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.arrays import Array


@dataclass(frozen=True, slots=True)
class Signal:
    """One row of the table; ``labels`` name the components, one each."""

    name: str
    unit: str
    labels: tuple[str, ...]
    description: str

    @property
    def size(self) -> int:
        return len(self.labels)


_NED = ("north", "east", "down")
_BODY = ("x", "y", "z")
_EULER = ("roll", "pitch", "yaw")
_RATES = ("p", "q", "r")
_QUATERNION = ("w", "x", "y", "z")

SIGNALS: tuple[Signal, ...] = (
    Signal("time", "s", ("t",), "vehicle time of the tick"),
    Signal("tick.duration", "s", ("t",), "processor time of the previous tick, receive to send"),
    Signal("link.latency", "s", ("round_trip",), "round trip by TIMESYNC"),
    Signal("link.received", "1", ("fraction",), "share of vehicle packets received, from sequence numbers"),
    Signal("link.rate", "1/s", ("messages",), "messages received per second"),
    Signal("mode.state", "1", ("state",), "offboard state, number in the mode table"),
    Signal("mode.armed", "1", ("armed",), "1 while the vehicle reports armed"),
    Signal("imu.gyro_body", "rad/s", _BODY, "measured angular rate"),
    Signal("imu.accel_body", "m/s^2", _BODY, "measured specific force"),
    Signal("estimate.position_ned", "m", _NED, "estimated position"),
    Signal("estimate.velocity_ned", "m/s", _NED, "estimated velocity"),
    Signal("estimate.euler", "rad", _EULER, "estimated attitude"),
    Signal("estimate.ned_from_body", "1", _QUATERNION, "estimated attitude quaternion"),
    Signal("estimate.rates_body", "rad/s", _RATES, "angular rate less estimated bias"),
    Signal("estimate.gyro_bias", "rad/s", _BODY, "estimated gyro bias"),
    Signal("estimate.accel_bias", "m/s^2", _BODY, "estimated accelerometer bias"),
    Signal("estimate.position_std", "m", _NED, "1-sigma of position"),
    Signal("estimate.velocity_std", "m/s", _NED, "1-sigma of velocity"),
    Signal("estimate.attitude_std", "rad", _BODY, "1-sigma of attitude, body axes"),
    Signal("estimate.position_covariance", "m^2", ("nn", "ne", "nd", "ee", "ed", "dd"), "position covariance"),
    Signal("estimate.nis", "1", ("ratio",), "latest normalised innovation squared, per degree of freedom"),
    Signal("autopilot.euler", "rad", _EULER, "the autopilot's own attitude"),
    Signal("autopilot.position_ned", "m", _NED, "the autopilot's own local position"),
    Signal("autopilot.velocity_ned", "m/s", _NED, "the autopilot's own velocity"),
    Signal("reference.position_ned", "m", _NED, "reference position"),
    Signal("reference.velocity_ned", "m/s", _NED, "reference velocity"),
    Signal("reference.yaw", "rad", ("yaw",), "reference heading"),
    Signal("control.euler_command", "rad", _EULER, "commanded attitude"),
    Signal("control.rates_command", "rad/s", _RATES, "commanded body rates"),
    Signal("control.torque_body", "N m", _BODY, "commanded torque"),
    Signal("control.thrust", "N", ("thrust",), "commanded thrust, positive up"),
    Signal("control.saturated", "1", ("saturated",), "1 while the mixer or an angle limit cuts the command"),
    Signal("control.kind", "1", ("kind",), "controller in use: 0 none, 1 LQR, 2 PI/PID"),
    Signal("control.gain_set", "1", ("number",), "number of the gain set in use"),
    Signal("actuator.outputs", "1", ("m1", "m2", "m3", "m4"), "actuator outputs as the vehicle reports them"),
    Signal("battery.voltage", "V", ("voltage",), "battery voltage"),
    Signal("battery.remaining", "1", ("fraction",), "remaining charge, 0 to 1"),
)


def _offsets() -> dict[str, slice]:
    offsets: dict[str, slice] = {}
    start = 0
    for signal in SIGNALS:
        offsets[signal.name] = slice(start, start + signal.size)
        start += signal.size
    return offsets


SLICES: dict[str, slice] = _offsets()
FRAME_SIZE: int = sum(signal.size for signal in SIGNALS)


def empty_frame() -> Array:
    """A frame with every value NaN, shape (FRAME_SIZE,)."""
    return np.full(FRAME_SIZE, np.nan)
