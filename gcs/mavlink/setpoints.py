"""The one place where a setpoint becomes a MAVLink message: type masks and fields."""

from __future__ import annotations

from gcs.mavlink.encoder import Encoder
from models.setpoints import (
    ActuatorSetpoint,
    AttitudeSetpoint,
    PositionSetpoint,
    RatesSetpoint,
    Setpoint,
    VelocitySetpoint,
)

# Set bits say "ignore". Position with its derivatives and yaw ignores only the yaw rate.
MASK_POSITION = 2048
MASK_VELOCITY = 2503
MASK_ATTITUDE = 7
MASK_RATES = 128
_ZERO = (0.0, 0.0, 0.0)
_LEVEL = (1.0, 0.0, 0.0, 0.0)


def encode_setpoint(encoder: Encoder, target: tuple[int, int], setpoint: Setpoint, time_s: float) -> bytes:
    """Packet of a setpoint for (system, component), stamped with the time of the estimate it was computed from."""
    match setpoint:
        case AttitudeSetpoint():
            return encoder.set_attitude_target(
                target, time_s, MASK_ATTITUDE, setpoint.ned_from_body, _ZERO, setpoint.thrust
            )
        case RatesSetpoint():
            return encoder.set_attitude_target(
                target, time_s, MASK_RATES, _LEVEL, setpoint.rates_body_rad_s, setpoint.thrust
            )
        case ActuatorSetpoint():
            return encoder.set_actuator_control_target(target, time_s, setpoint.controls)
        case VelocitySetpoint():
            return encoder.set_position_target_local_ned(
                target, time_s, MASK_VELOCITY, _ZERO, setpoint.velocity_ned_m_s, _ZERO, setpoint.yaw_rad
            )
        case PositionSetpoint():
            return encoder.set_position_target_local_ned(
                target,
                time_s,
                MASK_POSITION,
                setpoint.position_ned_m,
                setpoint.velocity_ned_m_s,
                setpoint.acceleration_ned_m_s2,
                setpoint.yaw_rad,
            )
