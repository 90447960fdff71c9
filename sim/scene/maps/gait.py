"""Walking, as limb poses over the phase of the step cycle.

Frame H follows the walker: x along its heading, y left, z up, origin on the ground below the pelvis. Everything in H
is a function of the phase phi = s / L alone, s being the distance walked and L the length of a cycle (two steps), so
speed only stretches time. After Boulic, Magnenat-Thalmann & Thalmann, "A global human walking model with real-time
kinematic personification", The Visual Computer 6 (1990), with v' = speed / leg length:

    cycle L = 1.346 sqrt(v') leg        stance share = 0.752 - 0.143 / T, T = L / speed
    pelvis  z = z_0 + 0.015 v' leg sin(4 pi phi - 0.7 pi)        arm swing 9.88 v' degrees

Their tables of leg joint angles let the feet slide by centimetres. Here the foot leads and the leg follows: in
stance it rolls over heel, sole and ball, each at rest on the ground (in H: moving at -s'), in swing a polynomial
carries it on, and hip and knee angles follow by two-link inverse kinematics. Foot pitch and path have continuous
second derivatives.

Angles are about y, positive turns z towards x. Each limb is a row (x, y, z, cos theta/2, sin theta/2, cos yaw/2,
sin yaw/2, dx, dy, dz, dtheta, dyaw) with derivatives by phi; rotation R = Rz(yaw) Ry(theta).
"""

from __future__ import annotations

from math import sqrt

from hil.signals.units import TURN_RAD
from sim._kernels import det_cos, det_sin
from sim.scene.maps.figure import Figure
from sim.scene.maps.walk_path import smoothstep, smoothstep_slope

Row = tuple[float, float, float, float, float, float, float, float, float, float, float, float]

_STRIKE_RAD = -0.30  # foot pitch at heel strike: toe up
_PUSH_RAD = 1.0  # at toe-off: heel up
_FLAT_FROM, _FLAT_TO = 0.18, 0.58  # shares of stance during which the sole is flat
_LIFT_SHARE = 0.030  # extra lift of the swinging foot, share of body height
_REACH = 0.992  # longest hip-to-ankle distance as a share of the leg: never locked
_LEAN_RAD = 0.04
_ELBOW_RAD, _ELBOW_SWING_RAD = 0.22, 0.35
_TORSO_YAW_RAD = 0.07
_PELVIS_YAW_RAD = 0.10


def _limb(x: float, y: float, z: float, s: float, c: float, dx: float, dy: float, dz: float, d_theta: float) -> Row:
    """Row of a limb from sine and cosine of its pitch (|theta| < 180 degrees)."""
    half_c = sqrt(0.5 * (1.0 + c))
    return x, y, z, half_c, 0.5 * s / half_c, 1.0, 0.0, dx, dy, dz, d_theta, 0.0


def leg_rows(
    figure: Figure,
    y: float,
    hip: tuple[float, float, float, float],
    ankle: tuple[float, float, float, float],
    foot: tuple[float, float],
) -> tuple[Row, Row, Row]:
    """Thigh, shank and foot. `hip` and `ankle`: x, z, dx, dz; `foot`: pitch and its derivative. Knee forward.

    With d = ankle - hip and n = (-d_z, d_x): knee = hip + k d + w n, k = (a^2 - b^2 + r^2) / 2 r^2,
    w = sqrt(a^2 / r^2 - k^2), a and b being thigh and shank, r = |d|.
    """
    a, b = figure.thigh_m, figure.shank_m
    hx, hz, dhx, dhz = hip
    ax, az, dax, daz = ankle
    x, z, dx, dz = ax - hx, az - hz, dax - dhx, daz - dhz
    rr = x * x + z * z
    drr = 2.0 * (x * dx + z * dz)
    k = (a * a - b * b + rr) / (2.0 * rr)
    dk = -(a * a - b * b) * drr / (2.0 * rr * rr)
    w = sqrt(a * a / rr - k * k)
    dw = (-a * a * drr / (rr * rr) - 2.0 * k * dk) / (2.0 * w)
    kx, kz = hx + k * x - w * z, hz + k * z + w * x
    dkx = dhx + dk * x + k * dx - dw * z - w * dz
    dkz = dhz + dk * z + k * dz + dw * x + w * dx
    us, uc = (hx - kx) / a, (hz - kz) / a
    vs, vc = (kx - ax) / b, (kz - az) / b
    d_thigh = ((dhx - dkx) * uc - (dhz - dkz) * us) / a
    d_shank = ((dkx - dax) * vc - (dkz - daz) * vs) / b
    pitch, d_pitch = foot
    return (
        _limb(0.5 * (hx + kx), y, 0.5 * (hz + kz), us, uc, 0.5 * (dhx + dkx), 0.0, 0.5 * (dhz + dkz), d_thigh),
        _limb(0.5 * (kx + ax), y, 0.5 * (kz + az), vs, vc, 0.5 * (dkx + dax), 0.0, 0.5 * (dkz + daz), d_shank),
        (ax, y, az, det_cos(0.5 * pitch), det_sin(0.5 * pitch), 1.0, 0.0, dax, 0.0, daz, d_pitch, 0.0),
    )


def arm_rows(
    figure: Figure,
    shoulder: tuple[float, float, float, float, float, float],
    upper: tuple[float, float],
    fore: tuple[float, float],
) -> tuple[Row, Row, Row]:
    """Upper arm, forearm and hand. `shoulder`: x, y, z, dx, dy, dz; `upper`, `fore`: pitch and derivative."""
    x, y, z, dx, dy, dz = shoulder
    s, c = det_sin(upper[0]), det_cos(upper[0])
    half = 0.5 * figure.upper_arm_m
    px, pz, dpx, dpz = half * s, half * c, half * c * upper[1], -half * s * upper[1]
    upper_row = _limb(x - px, y, z - pz, s, c, dx - dpx, dy, dz - dpz, upper[1])
    x, z, dx, dz = x - 2.0 * px, z - 2.0 * pz, dx - 2.0 * dpx, dz - 2.0 * dpz
    s, c = det_sin(fore[0]), det_cos(fore[0])
    half = 0.5 * figure.forearm_m
    px, pz, dpx, dpz = half * s, half * c, half * c * fore[1], -half * s * fore[1]
    fore_row = _limb(x - px, y, z - pz, s, c, dx - dpx, dy, dz - dpz, fore[1])
    g = 2.0 + figure.hand_m / half
    hand_row = _limb(x - g * px, y, z - g * pz, s, c, dx - g * dpx, dy, dz - g * dpz, fore[1])
    return upper_row, fore_row, hand_row


def natural_cycle_m(figure: Figure, speed_mps: float) -> float:
    """Length of two steps."""
    return 1.346 * sqrt(speed_mps * figure.leg_m)


class Gait:
    """Steps of one figure at one cruising speed; `cycle_m` close to the natural one."""

    def __init__(self, figure: Figure, speed_mps: float, cycle_m: float) -> None:
        self.figure = figure
        leg = figure.leg_m
        relative = speed_mps / leg
        self.cycle_m = cycle_m
        self.stance = min(max(0.752 - 0.143 * speed_mps / self.cycle_m, 0.55), 0.70)
        self._bob_m = 0.015 * relative * leg
        self._arm_rad = 9.88 * relative * TURN_RAD / 360.0
        self._lift_m = _LIFT_SHARE * figure.height_m
        # How far before the hip a flat foot starts: where the pelvis can be highest, so that knees stay straightest.
        middle_m = 0.5 * (self.stance * cycle_m - 0.063 * figure.height_m)
        heights = []
        for step in range(9):
            self._place_feet(middle_m - 0.008 * step * figure.height_m)
            heights.append(min(self._highest_hip(i / 64) for i in range(64)))
        best = max(range(9), key=heights.__getitem__)
        self._place_feet(middle_m - 0.008 * best * figure.height_m)
        self._hip_m = min(self._highest_hip(i / 128) for i in range(128))

    @property
    def kernel_values(self) -> tuple[float, ...]:
        """What `sim._kernels.Walker` wants to know (sim/native/gait.hpp, GaitShape)."""
        f = self.figure
        legs = (f.thigh_m, f.shank_m, f.ankle_m, f.heel_m, f.ball_m, f.hip_half_m, f.shoulder_half_m)
        above = (f.shoulder_above_hip_m, f.head_above_hip_m, f.torso_above_hip_m)
        arms = (f.upper_arm_m, f.forearm_m, f.hand_m)
        steps = (self.cycle_m, self.stance, self._bob_m, self._arm_rad, self._lift_m, self._ahead_m)
        return (*legs, *above, *arms, *steps, *self._swing_from, *self._swing_to, self._hip_m)

    def _place_feet(self, ahead_m: float) -> None:
        self._ahead_m = ahead_m
        self._swing_from = self.ankle(self.stance)[:2]
        self._swing_to = self.ankle(0.0)[:2]

    def foot_pitch(self, phase: float) -> tuple[float, float]:
        """Pitch and its derivative of the foot that strikes at phase 0."""
        flat_from, flat_to = _FLAT_FROM * self.stance, _FLAT_TO * self.stance
        if phase < flat_from:
            u, span, start, change = phase / flat_from, flat_from, _STRIKE_RAD, -_STRIKE_RAD
        elif phase < flat_to:
            return 0.0, 0.0
        elif phase < self.stance:
            span = self.stance - flat_to
            u, start, change = (phase - flat_to) / span, 0.0, _PUSH_RAD
        else:
            span = 1.0 - self.stance
            u, start, change = (phase - self.stance) / span, _PUSH_RAD, _STRIKE_RAD - _PUSH_RAD
        return start + change * smoothstep(u), change * smoothstep_slope(u) / span

    def ankle(self, phase: float) -> tuple[float, float, float, float]:
        """x, z, dx, dz of the ankle of the foot that strikes at phase 0; phase in [0, 1)."""
        f = self.figure
        if phase <= self.stance:
            pitch, d_pitch = self.foot_pitch(phase) if phase < self.stance else (_PUSH_RAD, 0.0)
            flat_m = self._ahead_m - self.cycle_m * phase
            # Ankle from the point of the sole it turns about: the heel before the sole is flat, the ball after.
            px = f.heel_m if phase < _FLAT_TO * self.stance else -f.ball_m
            pz = f.ankle_m
            s, c = det_sin(pitch), det_cos(pitch)
            rx, rz = px * c + pz * s, pz * c - px * s
            return flat_m - px + rx, rz, -self.cycle_m + d_pitch * rz, -d_pitch * rx
        span = 1.0 - self.stance
        u = (phase - self.stance) / span
        (x0, z0), (x1, z1) = self._swing_from, self._swing_to
        # x: slopes at both ends are those of stance, second derivatives zero; the rest is smoothstep.
        slope = -self.cycle_m * span
        change = x1 - x0 - slope
        blend, d_blend = smoothstep(u), smoothstep_slope(u)
        v = u * (1.0 - u)
        z = z0 + (z1 - z0) * blend + self._lift_m * 64.0 * v * v * v
        dz = (z1 - z0) * d_blend + self._lift_m * 192.0 * v * v * (1.0 - 2.0 * u)
        return x0 + slope * u + change * blend, z, (slope + change * d_blend) / span, dz / span

    def _pelvis(self, phase: float) -> tuple[float, float, float, float]:
        """Height above its base, yaw, and their derivatives."""
        bob = 2.0 * TURN_RAD * phase - 0.35 * TURN_RAD
        turn = TURN_RAD * phase
        # Left hip (y > 0) leads when the left foot strikes: yaw to the right, negative.
        return (
            self._bob_m * det_sin(bob),
            -_PELVIS_YAW_RAD * det_cos(turn),
            2.0 * TURN_RAD * self._bob_m * det_cos(bob),
            TURN_RAD * _PELVIS_YAW_RAD * det_sin(turn),
        )

    def _highest_hip(self, phase: float) -> float:
        """Base height that leaves the leg in reach at `phase`."""
        x, z, _, _ = self.ankle(phase)
        bob, yaw, _, _ = self._pelvis(phase)
        x += self.figure.hip_half_m * det_sin(yaw)
        reach = _REACH * self.figure.leg_m
        return z + sqrt(reach * reach - x * x) - bob

    def rows(self, phase: float) -> list[Row]:
        """Limbs in the order of `figure.LIMBS` at `phase` in [0, 1); the left foot strikes at 0."""
        f = self.figure
        bob, yaw, d_bob, d_yaw = self._pelvis(phase)
        sy, cy = det_sin(yaw), det_cos(yaw)
        hip_z = self._hip_m + bob
        turn = TURN_RAD * phase
        st, ct = det_sin(turn), det_cos(turn)
        torso_yaw, d_torso_yaw = _TORSO_YAW_RAD * ct, -TURN_RAD * _TORSO_YAW_RAD * st
        lean_s, lean_c = det_sin(_LEAN_RAD), det_cos(_LEAN_RAD)
        ts, tc = det_sin(torso_yaw), det_cos(torso_yaw)
        half_lean = (det_cos(0.5 * _LEAN_RAD), det_sin(0.5 * _LEAN_RAD))
        up = f.torso_above_hip_m
        rows: list[Row] = [
            (0.0, 0.0, hip_z, 1.0, 0.0, det_cos(0.5 * yaw), det_sin(0.5 * yaw), 0.0, 0.0, d_bob, 0.0, d_yaw),
            (up * lean_s, 0.0, hip_z + up * lean_c, *half_lean, det_cos(0.5 * torso_yaw), det_sin(0.5 * torso_yaw),
             0.0, 0.0, d_bob, 0.0, d_torso_yaw),
            (f.head_above_hip_m * lean_s, 0.0, hip_z + f.head_above_hip_m * lean_c, 1.0, 0.0, 1.0, 0.0,
             0.0, 0.0, d_bob, 0.0, 0.0),
        ]  # fmt: skip
        up = f.shoulder_above_hip_m
        for side, sign in ((f.shoulder_half_m, 1.0), (-f.shoulder_half_m, -1.0)):
            # The left arm is back when the left foot strikes.
            swing, d_swing = sign * self._arm_rad * ct, -sign * TURN_RAD * self._arm_rad * st
            elbow = _ELBOW_RAD + 0.5 * _ELBOW_SWING_RAD * (1.0 - sign * ct)
            d_elbow = 0.5 * _ELBOW_SWING_RAD * sign * TURN_RAD * st
            shoulder = (
                up * lean_s - side * ts, side * tc, hip_z + up * lean_c,
                -side * tc * d_torso_yaw, -side * ts * d_torso_yaw, d_bob,
            )  # fmt: skip
            rows += arm_rows(f, shoulder, (swing - 0.05, d_swing), (swing - 0.05 - elbow, d_swing - d_elbow))
        for side, shift in ((f.hip_half_m, 0.0), (-f.hip_half_m, 0.5)):
            own = phase + shift
            own = own - 1.0 if own >= 1.0 else own
            hip = (-side * sy, hip_z, -side * cy * d_yaw, d_bob)
            rows += leg_rows(f, side, hip, self.ankle(own), self.foot_pitch(own))
        return rows
