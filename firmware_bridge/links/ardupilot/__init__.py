"""Links to ArduPilot: SITL over its JSON interface, a board or SITL over External AHRS."""
