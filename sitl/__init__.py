"""Floor 2: simulated hardware. Truth plants, sensors, wind, and the vehicle side of MAVLink."""
