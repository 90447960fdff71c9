"""The mock autopilot's parameters: defaults, airframes, and the protocol that serves them."""
