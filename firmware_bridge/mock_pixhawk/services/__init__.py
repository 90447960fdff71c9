"""The mock autopilot's MAVLink services: commands, missions, telemetry."""
