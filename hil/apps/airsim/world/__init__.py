"""The simulation that the server's clients see: vehicles, clock, sensors."""
