"""Floor 3: the ground station. Link, telemetry, offboard runtime, recordings, command line."""
