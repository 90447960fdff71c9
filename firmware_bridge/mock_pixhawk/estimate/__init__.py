"""The mock autopilot's estimator: model, inputs and named state."""
