"""Truth plants: what really happens to a simulated vehicle."""
