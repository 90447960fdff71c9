"""ArduCopter's frames (FRAME_CLASS, FRAME_TYPE): chosen for the rotors of a vehicle, with the numbers of its motors.

A frame is known by the place and spin of each motor in the order of ArduPilot's motor numbers, as in its
AP_MotorsMatrix. Only the ratios of places along each axis count, because ArduPilot normalises the factors of roll and
of pitch. A coaxial pair is two motors at one place; which of the two is above does not matter to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

CCW, CW = 1.0, -1.0
FIRST_MOTOR_FUNCTION = 33  # SERVOn_FUNCTION of motor 1; motors 2 to 8 follow
_TOLERANCE = 0.3  # of a place, the farthest rotor along each axis being at 1; the Iris's rear rotors are 0.23 off

Motor = tuple[float, float]  # clockwise from the nose [deg], spin


class Frame(NamedTuple):
    """A frame, and the vehicle's rotor that each motor number has."""

    name: str
    frame_class: int
    frame_type: int
    rotors: tuple[int, ...]  # index of the vehicle's rotor by motor number - 1

    def parameters(self) -> dict[str, float]:
        """Return the parameters that choose the frame and wire output n to the vehicle's rotor n - 1."""
        values: dict[str, float] = {"FRAME_CLASS": self.frame_class, "FRAME_TYPE": self.frame_type}
        if self.rotors != tuple(range(len(self.rotors))):
            for motor, rotor in enumerate(self.rotors):
                values[f"SERVO{rotor + 1}_FUNCTION"] = FIRST_MOTOR_FUNCTION + motor
        return values


def _reversed(motors: Sequence[Motor]) -> tuple[Motor, ...]:
    return tuple((angle, -spin) for angle, spin in motors)


def _turned(motors: Sequence[Motor], angle_deg: float) -> tuple[Motor, ...]:
    return tuple((angle + angle_deg, spin) for angle, spin in motors)


_QUAD = ((45.0, CCW), (-135.0, CCW), (-45.0, CW), (135.0, CW))
_QUAD_PLUS = ((90.0, CCW), (-90.0, CCW), (0.0, CW), (180.0, CW))
_HEXA_PLUS = ((0.0, CW), (180.0, CCW), (-120.0, CW), (60.0, CCW), (-60.0, CCW), (120.0, CW))
_HEXA_X = ((90.0, CW), (-90.0, CCW), (-30.0, CW), (150.0, CCW), (30.0, CCW), (-150.0, CW))
_OCTA_PLUS = ((0.0, CW), (180.0, CW), (45.0, CCW), (135.0, CCW), (-45.0, CCW), (-135.0, CCW), (-90.0, CW), (90.0, CW))
_OCTAQUAD_X = (
    *((45.0, CCW), (-45.0, CW), (-135.0, CCW), (135.0, CW)),
    *((-45.0, CCW), (45.0, CW), (135.0, CCW), (-135.0, CW)),
)
_OCTAQUAD_PLUS = (
    *((0.0, CCW), (-90.0, CW), (180.0, CCW), (90.0, CW)),
    *((-90.0, CCW), (0.0, CW), (90.0, CCW), (180.0, CW)),
)
_Y6B = ((60.0, CW), (60.0, CCW), (180.0, CW), (180.0, CCW), (-60.0, CW), (-60.0, CCW))

# Name, class, type, motors. Each coaxial pair has both spins: OCTAQUAD H and the other types of Y6 equal these.
_FRAMES: tuple[tuple[str, int, int, tuple[Motor, ...]], ...] = (
    ("QUAD X", 1, 1, _QUAD),
    ("QUAD PLUS", 1, 0, _QUAD_PLUS),
    ("QUAD H", 1, 3, _reversed(_QUAD)),
    ("QUAD PLUSREV", 1, 6, _reversed(_QUAD_PLUS)),
    ("HEXA X", 2, 1, _HEXA_X),
    ("HEXA PLUS", 2, 0, _HEXA_PLUS),
    ("OCTA X", 3, 1, _turned(_OCTA_PLUS, 22.5)),
    ("OCTA PLUS", 3, 0, _OCTA_PLUS),
    ("OCTAQUAD X", 4, 1, _OCTAQUAD_X),
    ("OCTAQUAD PLUS", 4, 0, _OCTAQUAD_PLUS),
    ("Y6 Y6B", 5, 10, _Y6B),
)


def frame_of(rotors: Sequence[tuple[float, float, float]]) -> Frame | None:
    """Return the frame of rotors given as (forward [m], left [m], spin: +1 counter-clockwise), None if none fits."""
    places = _normalised([(forward, left) for forward, left, _ in rotors])
    for name, frame_class, frame_type, motors in _FRAMES:
        if len(motors) != len(rotors):
            continue
        wanted = _normalised([(math.cos(math.radians(a)), -math.sin(math.radians(a))) for a, _ in motors])
        found = []
        for (x, y), (_, spin) in zip(wanted, motors, strict=True):
            near = [
                i
                for i, (u, v) in enumerate(places)
                if abs(u - x) <= _TOLERANCE and abs(v - y) <= _TOLERANCE and rotors[i][2] == spin
            ]
            found += near if len(near) == 1 else []
        if len(set(found)) == len(rotors):
            return Frame(name, frame_class, frame_type, tuple(found))
    return None


def frame_names(count: int) -> list[str]:
    """Return the names of the frames with so many motors."""
    return [name for name, _, _, motors in _FRAMES if len(motors) == count]


def _normalised(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    x_most = max(abs(x) for x, _ in places) or 1.0
    y_most = max(abs(y) for _, y in places) or 1.0
    return [(x / x_most, y / y_most) for x, y in places]
