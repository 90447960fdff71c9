"""Facts about each autopilot, as data in a folder of its own."""
