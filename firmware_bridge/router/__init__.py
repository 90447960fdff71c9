"""The MAVLink router: one autopilot, many clients (ground stations, SDKs, companions) on UDP and TCP."""
