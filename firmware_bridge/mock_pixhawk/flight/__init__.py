"""The mock autopilot's flight: modes, missions, guidance, failsafes and pre-flight checks."""
