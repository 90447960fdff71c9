"""Autonomous flight in unknown surroundings: where the vehicle is, what stands around it, and where to fly."""
