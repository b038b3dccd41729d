"""Floor 1: what a vehicle is. Frames, sample types, rigid body, reference models, parameters."""
