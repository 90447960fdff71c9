"""Sensors of vehicles, with AirSim's error models."""
