"""The offboard controller: one pure tick, its modes, limits and trajectories."""
