"""Inside of a car that somebody drives: dashboard, seats, steering wheel, and the driver from the waist up."""

from __future__ import annotations

from signals._kernel import det_cos, det_sin
from signals.units import TURN_RAD
from tools.art.vehicles.body_shape import LowerBody
from tools.art.vehicles.car_shape import CarShape
from tools.art.vehicles.lofts import add_box, add_ellipsoid, add_tube
from tools.art.vehicles.parts import Parts

_SEAT_Y_M = 0.37


def add_cabin(parts: Parts, shape: CarShape, body: LowerBody) -> None:
    """Add what shows through the open panes; everything below the shoulder line is hidden by the body."""
    trim = parts["trim"]
    columns = shape.columns
    front, rear = columns[3].base[0], columns[-3].base[0]
    pillar = columns[5].base[0]  # behind the front side window
    floor = body.shoulder_m(pillar) + 0.045
    half = shape.half_base_m - 0.05
    add_box(trim, (rear + 0.1, -half, floor - 0.1), (front - 0.05, half, floor))
    add_box(trim, (front - 0.32, -half + 0.03, floor), (front + 0.02, half - 0.03, floor + 0.03))
    seat = pillar - 0.02
    head_z = min(shape.height_m - 0.24, floor + 0.34)
    for y in (_SEAT_Y_M, -_SEAT_Y_M):
        add_box(trim, (seat - 0.24, y - 0.22, floor - 0.05), (seat - 0.12, y + 0.22, head_z - 0.12))
        add_box(trim, (seat - 0.24, y - 0.12, head_z - 0.10), (seat - 0.16, y + 0.12, head_z + 0.06))
    # Driver: torso, arms to the wheel, head.
    y = _SEAT_Y_M
    add_ellipsoid(parts["cloth"], (seat, y, head_z - 0.36), (0.13, 0.21, 0.24), rings=6, sides=10)
    add_ellipsoid(parts["skin"], (seat + 0.05, y, head_z), (0.095, 0.078, 0.115), rings=6, sides=10)
    add_ellipsoid(parts["hair"], (seat + 0.025, y, head_z + 0.035), (0.10, 0.085, 0.095), rings=6, sides=10)
    wheel_x, wheel_z = min(seat + 0.50, front - 0.36), floor + 0.03
    ring = [
        (wheel_x - 0.06 * det_sin(a), y + 0.18 * det_cos(a), wheel_z + 0.13 * det_sin(a))
        for a in (TURN_RAD / 2 * k / 6 for k in range(7))
    ]
    add_tube(trim, ring, 0.016, 5)
    for side in (1.0, -1.0):
        shoulder = (seat + 0.02, y + side * 0.20, head_z - 0.22)
        elbow = (seat + 0.20, y + side * 0.25, head_z - 0.36)
        hand = (wheel_x - 0.05, y + side * 0.14, wheel_z + 0.09)
        add_tube(parts["cloth"], [shoulder, elbow, hand], (0.055, 0.045, 0.032), 6)
        add_ellipsoid(parts["skin"], hand, (0.05, 0.035, 0.04), rings=4, sides=6)
