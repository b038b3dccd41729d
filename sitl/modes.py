"""Words of the simulated firmware: PX4 flight modes, results, severities, and the setpoints OFFBOARD takes."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from models.frames import Quaternion, Vec3
from sitl.position_control import Target


class Mode(Enum):
    """PX4 flight modes: (main, sub) of ``custom_mode``."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    OFFBOARD = (6, 0)
    TAKEOFF = (4, 2)
    LOITER = (4, 3)
    MISSION = (4, 4)
    RTL = (4, 5)
    LAND = (4, 6)

    @property
    def custom_mode(self) -> int:
        """The number in HEARTBEAT."""
        main, sub = self.value
        return int(main << 16 | sub << 24)


STICK_MODES = (Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL)
ARMABLE_MODES = (*STICK_MODES, Mode.OFFBOARD, Mode.LOITER, Mode.TAKEOFF, Mode.MISSION)


class Result(Enum):
    """MAV_RESULT of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3


class Severity(Enum):
    """MAV_SEVERITY of a STATUSTEXT."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class AttitudeTarget(NamedTuple):
    """Attitude and thrust 0..1 of full thrust."""

    ned_from_body: Quaternion
    thrust: float


class RatesTarget(NamedTuple):
    """Body rates [rad/s] and thrust 0..1."""

    rates_body_rad_s: Vec3
    thrust: float


class ActuatorTarget(NamedTuple):
    """Roll, pitch, yaw -1..1 of the torque scales and thrust 0..1, straight to the mixer."""

    controls: tuple[float, float, float, float]


class BodyVelocityTarget(NamedTuple):
    """Velocity in the heading frame (forward, right, down) [m/s] and heading or its rate."""

    velocity_m_s: Vec3
    yaw_rad: float
    yaw_rate_rad_s: float


OffboardTarget = AttitudeTarget | RatesTarget | ActuatorTarget | BodyVelocityTarget | Target


class Sticks(NamedTuple):
    """Pitch forward, roll right, throttle 0..1, yaw right; the others -1..1."""

    forward: float
    right: float
    throttle: float
    yaw: float
    time_us: int
