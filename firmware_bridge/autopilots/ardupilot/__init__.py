"""ArduPilot, in SITL and on a board."""
