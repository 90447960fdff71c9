"""Devices plugged into this machine: autopilot boards, serial ports, gamepads. Lists them without opening them."""
