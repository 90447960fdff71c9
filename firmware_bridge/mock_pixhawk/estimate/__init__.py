"""The mock autopilot's estimator: its model, its inputs and its state by name."""
