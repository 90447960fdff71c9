"""The mock autopilot's parameters: defaults, airframes, and their protocol."""
