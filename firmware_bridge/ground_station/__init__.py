"""The bench's own ground station: uploads the mission, starts it and watches it, in simulated time."""
