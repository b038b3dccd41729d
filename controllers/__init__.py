"""Floor 2: what to command."""
