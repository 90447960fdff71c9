"""AirSim's settings.json: found where AirSim looks for it, read into frozen dataclasses, every problem named."""
