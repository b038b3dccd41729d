"""Reading, listing and setting parameters over MAVLink, as PX4 answers."""

from __future__ import annotations

from typing import Any

from sitl.vehicle_parameters import VehicleParameters


def answer(parameters: VehicleParameters, kind: str, message: Any) -> tuple[list[dict[str, Any]], str | None]:
    """PARAM_VALUE fields to send for a parameter message, and a complaint if a value was refused.

    An unknown name gets no answer; a refused value is answered with the one that stands.
    """
    complaint = None
    if kind == "PARAM_REQUEST_LIST":
        names = list(parameters)
    elif kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
        names = [parameters.names[message.param_index]] if message.param_index < len(parameters) else []
    else:
        names = [message.param_id] if message.param_id in parameters else []
    if kind == "PARAM_SET" and names:
        complaint = _set(parameters, names[0], message)
    return [_value(parameters, name) for name in names], complaint


def _set(parameters: VehicleParameters, name: str, message: Any) -> str | None:
    try:
        value = parameters.value_from_wire(message.param_value, message.param_type)
    except ValueError as error:
        return str(error)
    if message.param_type != parameters.kind(name) or not parameters.set(name, value):
        return f"{name}: value or type refused"
    return None


def _value(parameters: VehicleParameters, name: str) -> dict[str, Any]:
    return {
        "param_id": name,
        "param_value": parameters.wire_value(name),
        "param_type": parameters.kind(name),
        "param_count": len(parameters),
        "param_index": parameters.names.index(name),
    }
