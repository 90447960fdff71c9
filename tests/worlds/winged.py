"""A plane as an autopilot is told of it, for tests of its parameters."""

from __future__ import annotations

from typing import Any

from firmware_bridge.autopilots.installation import FixedWing, Rotor, Surface

PUSHER = Rotor((-0.3, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, 1.0, 0.02)
# Torques in B (FLU) of trailing edges down: left aileron rolls right, elevator pitches down (+y), rudder yaws left.
CONVENTIONAL = [
    Surface("aileron_left", (5.0, 0.1, 0.2), 0.0),
    Surface("aileron_right", (-5.0, 0.1, -0.2), 0.0),
    Surface("elevator", (0.0, 8.0, 0.0), -0.1),
    Surface("rudder", (0.2, 0.0, 4.0), 0.0),
]


def plane(surfaces: list[Surface], **changes: Any) -> FixedWing:
    values: dict[str, Any] = {
        "name": "test", "mass_kg": 3.0, "inertia_kgm2": (0.3, 0.15, 0.4), "rotors": [PUSHER], "surfaces": surfaces,
        "stall_mps": 10.0, "cruise_mps": 15.0, "fastest_mps": 25.0, "glide_mps": 13.0,
        "idle_sink_mps": 1.3, "climb_mps": 5.0, "pitch_rad": 0.05, "throttle": 0.5, "damping_nms": (-6.0, -0.6, -1.0),
        "pull_up": 0.4, "wheels": False,
    }  # fmt: skip
    return FixedWing(**(values | changes))
