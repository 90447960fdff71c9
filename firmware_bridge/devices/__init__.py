"""What is plugged into this machine: autopilot boards, serial ports, gamepads. Finds and names; never talks to them."""
