"""Flying by hand: gamepads, radios and the keyboard become MAVLink MANUAL_CONTROL in simulated time."""
