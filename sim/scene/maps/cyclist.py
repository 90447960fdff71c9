"""Cyclist: trunk and arms at rest, feet on the pedals, which turn with the distance (`Pedalling`, sim/native/gait.hpp).

The saddle is as high as leaves the knee a little bent at the lowest point of the pedal's circle; the trunk leans
forward until the hands reach the grips with bent elbows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

from signals._kernel import det_atan2, det_cos, det_sin
from signals.rotation import cross, minus, norm, unit
from signals.samples import Vec3
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.vehicles import bicycle_layout as city
from sim.scene.maps.walk_path import WalkPath
from sim.scene.maps.walker import MovingPerson, distance_m

Row = list[float]

_FOOT_RAD = 0.12  # heel up
_LEG_SHARE = 0.965  # greatest distance of hip and ankle, as a share of the leg
_ARM_SHARE = 0.93  # distance of shoulder and wrist, as a share of the arm
_HAND_RAD = -1.15
_ABOVE_GRIP_M = 0.012  # middle of the hand
_LEANS_RAD = (0.10, 0.90)
_ADULT_M = 1.42  # a child rides a smaller bicycle
_CHILDS_BICYCLE = 1.0 / 1.75  # size for each metre of a child's height
_SIZE_STEP = 0.05


@dataclass(frozen=True)
class Riding:
    """Posture on a bicycle: `rows` of the limbs, `legs` in the order of `Pedalling` (sim/native/gait.hpp)."""

    size: float  # of the bicycle
    saddle_m: tuple[float, float]  # x and z of its top
    rows: list[Row]
    legs: tuple[float, ...]


class Cyclist(MovingPerson):
    """A person on a bicycle. `crank_turns_per_m` and `path` are those of the bicycle."""

    def __init__(
        self,
        name: str,
        figure: Figure,
        riding: Riding,
        path: WalkPath,
        *,
        crank_turns_per_m: float,
        ground_m: float,
        reach_m: Mapping[str, float],
    ) -> None:
        middle_m = riding.rows[0][2]
        super().__init__(
            name,
            figure,
            path,
            ground_m=ground_m,
            middle_m=middle_m,
            radius_m=_bound_radius(riding, middle_m, reach_m),
            seated=riding.rows,
            legs=riding.legs,
            cycles_per_m=crank_turns_per_m,
        )


def _bound_radius(riding: Riding, middle: float, reach_m: Mapping[str, float]) -> float:
    reaches = [reach_m[limb] + distance_m(row, middle) for limb, row in zip(LIMBS[:9], riding.rows, strict=False)]
    hip_x, _, y, axle_x, axle_z, crank, _ = riding.legs[-7:]
    thigh = riding.legs[0]
    knee = abs(hip_x) + thigh + y
    ankle = sqrt(axle_x * axle_x + (axle_z - middle) * (axle_z - middle)) + crank + y
    for limb, far in (("thigh_l", 0.5 * (knee + abs(hip_x) + y)), ("shank_l", 0.5 * (knee + ankle)), ("foot_l", ankle)):
        reaches += [far + reach_m[limb], far + reach_m[f"{limb[:-1]}r"]]
    return max(reaches)


def ride(figure: Figure) -> Riding:
    """Return the bicycle that fits a person, and their posture on it."""
    steps = round(figure.height_m * _CHILDS_BICYCLE / _SIZE_STEP)
    size = _SIZE_STEP * steps if figure.height_m < _ADULT_M else 1.0
    # The pedal is below the ball of the foot.
    c, s = det_cos(_FOOT_RAD), det_sin(_FOOT_RAD)
    x, z = 0.075 * figure.height_m, -figure.ankle_m
    axle_x = size * city.CRANK_AXLE_M[0] - (x * c + z * s)
    axle_z = size * (city.CRANK_AXLE_M[1] + city.PEDAL_HALF_M) - (z * c - x * s)
    crank = size * city.CRANK_M
    # Point of the line of the seat post at the distance of the stretched leg from the middle of the ankle's circle.
    along_x, _, along_z = unit((city.POST_ALONG[0], 0.0, city.POST_ALONG[1]))
    seat_x, seat_z = size * city.SADDLE_M[0], size * (city.SADDLE_M[1] + city.SADDLE_HALF_M)
    hip_above = 0.055 * figure.height_m
    from_x, from_z = seat_x - axle_x, seat_z + hip_above - axle_z
    reach = _LEG_SHARE * figure.leg_m - crank
    slope = from_x * along_x + from_z * along_z
    raised = sqrt(slope * slope - from_x * from_x - from_z * from_z + reach * reach) - slope
    saddle_m = (seat_x + raised * along_x, seat_z + raised * along_z)
    hip = (saddle_m[0], 0.0, saddle_m[1] + hip_above)
    legs = (*figure.lengths_m, hip[0], hip[2], size * city.PEDAL_Y_M, axle_x, axle_z, crank, _FOOT_RAD)
    resting = [[0.0, 0.0, 0.0, 1.0, 0.0, 1.0, *[0.0] * 6]] * 6  # the legs, which the kernel poses
    return Riding(size, saddle_m, [*_upper_rows(figure, hip, size), *resting], legs)


def _upper_rows(figure: Figure, hip: Vec3, size: float) -> list[Row]:
    grip_x, grip_y, grip_z = (size * value for value in city.GRIP_M)
    hands = [(grip_x, y, grip_z + _ABOVE_GRIP_M) for y in (grip_y, -grip_y)]
    back = (det_sin(_HAND_RAD), 0.0, det_cos(_HAND_RAD))  # from the hand to the wrist
    wrists = [_moved(hand, back, figure.hand_m) for hand in hands]
    arm = figure.upper_arm_m + figure.forearm_m

    def shoulder(lean: float, side: float) -> Vec3:
        x, _, z = _moved(hip, (det_sin(lean), 0.0, det_cos(lean)), figure.shoulder_above_hip_m)
        return x, side * figure.shoulder_half_m, z

    low, high = _LEANS_RAD
    for _ in range(30):
        lean = 0.5 * (low + high)
        span_m = norm(minus(wrists[0], shoulder(lean, 1.0)))
        low, high = (lean, high) if span_m > _ARM_SHARE * arm else (low, lean)
    upright = (det_sin(0.6 * lean), 0.0, det_cos(0.6 * lean))
    neck = _moved(hip, (det_sin(lean), 0.0, det_cos(lean)), figure.shoulder_above_hip_m)
    head = _moved(neck, upright, figure.head_above_hip_m - figure.shoulder_above_hip_m)
    torso = _moved(hip, (det_sin(lean), 0.0, det_cos(lean)), figure.torso_above_hip_m)
    rows = [_pitched(hip, 0.5 * lean), _pitched(torso, lean), _pitched(head, 0.3 * lean)]
    for side, hand, wrist in zip((1.0, -1.0), hands, wrists, strict=True):
        joint = shoulder(lean, side)
        elbow = _elbow(joint, wrist, figure, (-0.2, 0.45 * side, -1.0))
        rows += [_between(joint, elbow), _between(elbow, wrist), _pitched(hand, _HAND_RAD)]
    return rows


def _elbow(shoulder: Vec3, wrist: Vec3, figure: Figure, towards: Vec3) -> Vec3:
    """Return the joint between two bones of known length, bent `towards` a direction."""
    span = minus(wrist, shoulder)
    a, b, far = figure.upper_arm_m, figure.forearm_m, norm(span)
    along = 0.5 * (a * a - b * b + far * far) / far
    out = sqrt(max(0.0, a * a - along * along))
    aside = unit(cross(cross(span, towards), span))
    return _moved(_moved(shoulder, unit(span), along), aside, out)


def _between(upper: Vec3, lower: Vec3) -> Row:
    """Return the row of a limb between two joints."""
    x, y, z = unit(minus(upper, lower))
    level = sqrt(x * x + y * y)
    sign = -1.0 if x < 0.0 else 1.0  # the limb does not turn about its own axis
    pitch, yaw = 0.5 * det_atan2(sign * level, z), 0.5 * det_atan2(sign * y, sign * x)
    middle = tuple(0.5 * (p + q) for p, q in zip(upper, lower, strict=True))
    return [*middle, det_cos(pitch), det_sin(pitch), det_cos(yaw), det_sin(yaw), *[0.0] * 5]


def _pitched(at: Vec3, pitch_rad: float) -> Row:
    return [*at, det_cos(0.5 * pitch_rad), det_sin(0.5 * pitch_rad), 1.0, *[0.0] * 6]


def _moved(at: Vec3, along: Vec3, by_m: float) -> Vec3:
    return at[0] + by_m * along[0], at[1] + by_m * along[1], at[2] + by_m * along[2]
