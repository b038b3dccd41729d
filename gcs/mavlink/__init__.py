"""MAVLink of the ground station: codec, endpoints, logs."""
