"""Facts of ArduPlane: its program."""

from __future__ import annotations

from firmware_bridge.autopilots.profile import Program

PROGRAM = Program(
    "ArduPlane",
    b"ArduPlane V",
    "`./waf configure --board sitl && ./waf plane` in ardupilot makes build/sitl/bin/arduplane",
)
