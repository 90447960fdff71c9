"""`hil devices`: lists serial ports, autopilots and gamepads, and checks a board and this computer's timing."""
