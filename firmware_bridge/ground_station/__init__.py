"""The bench's own ground station: uploads a mission, starts and monitors it, in simulated time."""
