"""Human figure: lengths as shares of body height, and the shapes of the limbs.

Segment lengths as shares of body height: Winter, "Biomechanics and Motor Control of Human Movement", 4th ed. 2009,
figure 4.1 (after Drillis & Contini 1966). Girths are chosen by eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from signals.samples import Vec3

LIMBS = (
    "pelvis", "torso", "head",
    "upper_arm_l", "forearm_l", "hand_l", "upper_arm_r", "forearm_r", "hand_r",
    "thigh_l", "shank_l", "foot_l", "thigh_r", "shank_r", "foot_r",
)  # fmt: skip


@dataclass(frozen=True)
class LimbShape:
    """One geom of a limb, in the limb's frame: x forward, y left, z towards the joint above."""

    limb: str
    part: str
    kind: str
    size: tuple[float, ...]
    pos: Vec3 = (0.0, 0.0, 0.0)
    lateral: bool = False  # axis along y instead of z
    forward: bool = False  # axis along x instead of z


class Figure:
    """Lengths [m] of a person of `height_m`, and the geoms that stand for the limbs in contact.

    A child of about seven years has shorter limbs and a larger head: stature / height of the head is 6.2, of an adult
    7.6 (Snyder et al., "Anthropometry of Infants, Children, and Youths", UM-HSRI-77-17, 1977).
    """

    def __init__(self, height_m: float, *, child: bool = False) -> None:
        h = self.height_m = height_m
        self.child = child
        self.thigh_m = 0.245 * h
        self.shank_m = 0.246 * h
        self.ankle_m = 0.039 * h  # above the sole
        self.heel_m = 0.030 * h  # point of the sole that touches first, behind the ankle
        self.ball_m = 0.085 * h  # point of the sole that lifts off last, ahead of the ankle
        self.hip_half_m = 0.052 * h  # half the distance of the hip joints
        self.shoulder_half_m = 0.112 * h
        self.shoulder_above_hip_m = 0.288 * h
        self.head_above_hip_m = 0.408 * h
        self.torso_above_hip_m = 0.175 * h
        self.upper_arm_m = 0.172 * h
        self.forearm_m = 0.150 * h
        self.hand_m = 0.050 * h  # wrist to middle of the hand
        if child:
            self.thigh_m, self.shank_m = 0.235 * h, 0.232 * h
            self.hip_half_m, self.shoulder_half_m = 0.050 * h, 0.104 * h
            self.shoulder_above_hip_m, self.torso_above_hip_m = 0.276 * h, 0.175 * h
            self.head_above_hip_m = 0.417 * h
            self.upper_arm_m, self.forearm_m = 0.165 * h, 0.142 * h
        self.leg_m = self.thigh_m + self.shank_m

    @property
    def lengths_m(self) -> tuple[float, ...]:
        """Lengths for `sim._kernels`, in the order of FigureLengths (sim/native/gait.hpp)."""
        legs = (self.thigh_m, self.shank_m, self.ankle_m, self.heel_m, self.ball_m, self.hip_half_m)
        above = (self.shoulder_half_m, self.shoulder_above_hip_m, self.head_above_hip_m, self.torso_above_hip_m)
        return (*legs, *above, self.upper_arm_m, self.forearm_m, self.hand_m, self.height_m)

    def shapes(self) -> tuple[LimbShape, ...]:
        h = self.height_m
        head = 1.24 if self.child else 1.0
        shapes = [
            LimbShape("pelvis", "hips", "ellipsoid", (0.068 * h, 0.097 * h, 0.075 * h)),
            LimbShape("torso", "trunk", "ellipsoid", (0.064 * h, 0.098 * h, 0.158 * h)),
            LimbShape("torso", "shoulders", "capsule", (0.040 * h, 0.085 * h), (0.0, 0.0, 0.100 * h), lateral=True),
            LimbShape("head", "neck", "capsule", (0.030 * h, 0.020 * h), (-0.006 * h, 0.0, -0.080 * h)),
            LimbShape("head", "face", "ellipsoid", (0.052 * head * h, 0.044 * head * h, 0.066 * head * h)),
            LimbShape(
                "head",
                "hair",
                "ellipsoid",
                (0.054 * head * h, 0.048 * head * h, 0.052 * head * h),
                (-0.010 * head * h, 0.0, 0.022 * head * h),
            ),
        ]
        for side in ("l", "r"):
            shapes += [
                LimbShape(f"upper_arm_{side}", "arm", "capsule", (0.028 * h, self.upper_arm_m / 2)),
                LimbShape(f"forearm_{side}", "arm", "capsule", (0.021 * h, self.forearm_m / 2)),
                LimbShape(f"hand_{side}", "hand", "ellipsoid", (0.024 * h, 0.014 * h, 0.045 * h)),
                LimbShape(f"thigh_{side}", "leg", "capsule", (0.044 * h, self.thigh_m / 2)),
                LimbShape(f"shank_{side}", "leg", "capsule", (0.030 * h, self.shank_m / 2)),
                # The origin of the foot is the ankle. Its capsule, of radius 0.022 h, touches the ground at the sole.
                LimbShape(
                    f"foot_{side}", "shoe", "capsule", (0.022 * h, 0.052 * h),
                    (0.035 * h, 0.0, 0.022 * h - self.ankle_m), forward=True,
                ),
            ]  # fmt: skip
        return tuple(shapes)

    def reach_m(self) -> dict[str, float]:
        """Return the distance from each limb's origin to the farthest point of its shapes."""
        reach = dict.fromkeys(LIMBS, 0.0)
        for s in self.shapes():
            x, y, z = s.pos
            size = sum(s.size) if s.kind == "capsule" else max(s.size)
            reach[s.limb] = max(reach[s.limb], sqrt(x * x + y * y + z * z) + size)
        return reach
