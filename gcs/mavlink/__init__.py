"""The station's MAVLink: codec, endpoints, logs, modes and the link to one vehicle. Bytes in, typed values out."""
