"""Manual flight: gamepads, radios and the keyboard, sent as MAVLink MANUAL_CONTROL in simulated time."""
