"""Floor 2: what the vehicle does, from what it measures."""
