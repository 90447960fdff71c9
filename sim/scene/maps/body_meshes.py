"""Meshes of people: each limb as a loft through cross-sections, for a body 1 m tall, scaled to its height by its user.

Every limb ends in a ball round its joint, as wide as the limb that it meets, so that no gap opens when the joint
bends. Breadths and depths are rounded from the tables of Drillis & Contini 1966 (stature, shoulders, hips) and drawn
by eye in between. Frames as in figure.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from signals.samples import Vec3
from sim.scene.maps.figure import Figure
from sim.scene.maps.loft import Section, SmoothMesh, ball, block, loft, outline, skin

Row = tuple[float, ...]  # z, front, back, half width, and optionally the middle's x


@dataclass(frozen=True)
class Build:
    """Proportions of a body."""

    female: bool = False
    child: bool = False
    girth: float = 1.0  # of the limbs
    trunk: float = 1.0  # depth and width of torso and pelvis
    belly: float = 0.0  # further forward, share of the height

    @property
    def figure(self) -> Figure:
        return Figure(1.0, child=self.child)


BUILDS: dict[str, Build] = {
    "m_slim": Build(girth=0.92, trunk=0.93),
    "m_mid": Build(),
    "m_stout": Build(girth=1.10, trunk=1.12, belly=0.020),
    "f_slim": Build(female=True, girth=0.90, trunk=0.92),
    "f_mid": Build(female=True, girth=0.98, trunk=0.99),
    "f_stout": Build(female=True, girth=1.12, trunk=1.13, belly=0.012),
    "child": Build(child=True, girth=0.95, trunk=1.0),
}
_LIMB_SIDES, _ARM_SIDES, _TRUNK_SIDES, _HEAD_SIDES = 8, 6, 12, 12
_PLAIN_UV = (0.02, 0.02)  # of the face's texture: bare skin


def _tube(
    rows: Sequence[Row],
    sides: int,
    *,
    girth: float = 1.0,
    square: float = 0.0,
    creases: Sequence[int] = (),
    caps: tuple[float, float] = (0.0, 0.0),
    rounds: float = 1.0,
) -> SmoothMesh:
    """Loft through rows; v runs once over 0.3 of the body height."""
    sections = [
        Section(z, girth * front, girth * back, girth * half, *middle, square=square)
        for z, front, back, half, *middle in rows
    ]
    v = [s.z / 0.3 for s in sections]
    return loft(sections, sides, creases=creases, caps=caps, rows=v, rounds=rounds)


def _at(rows: Sequence[Row], z: float) -> Row:
    """Return the row at height z, interpolated linearly."""
    for low, high in pairwise(rows):
        if z <= high[0]:
            t = max(0.0, (z - low[0]) / (high[0] - low[0]))
            return tuple(a + t * (b - a) for a, b in zip(low, high, strict=True))
    return rows[-1]


# Legs.


def _shank(build: Build) -> SmoothMesh:
    top = build.figure.shank_m / 2
    rows: list[Row] = [
        (-top, 0.020, 0.021, 0.018), (-top + 0.035, 0.021, 0.022, 0.019), (0.0, 0.026, 0.038, 0.030),
        (0.050, 0.028, 0.043, 0.034), (top, 0.034, 0.031, 0.031), (top + 0.020, 0.022, 0.020, 0.021),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, caps=(0.014, 0.008))


def _bare_thigh(build: Build) -> SmoothMesh:
    """Return the lower half of the thigh, for below a hem."""
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top - 0.016, 0.025, 0.024, 0.023), (-top, 0.033, 0.030, 0.031), (-top + 0.030, 0.036, 0.034, 0.034),
        (top - 0.06, 0.048, 0.051, 0.045),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, creases=(-1,), caps=(0.006, 0.0))


def _trouser_thigh(build: Build) -> SmoothMesh:
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top - 0.018, 0.033, 0.032, 0.029), (-top + 0.006, 0.042, 0.040, 0.037), (0.0, 0.047, 0.049, 0.044),
        (top - 0.05, 0.051, 0.056, 0.049), (top, 0.050, 0.058, 0.050), (top + 0.028, 0.036, 0.044, 0.038),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, caps=(0.014, 0.014))


def _trouser_shank(build: Build, hem: float = 0.034, low: float = -0.006, knee: float = 0.040) -> SmoothMesh:
    top = build.figure.shank_m / 2
    mid = 0.5 * (hem + knee)
    rows: list[Row] = [
        (-top + low, hem, hem + 0.006, hem - 0.004), (-top + low + 0.035, hem - 0.003, hem + 0.003, hem - 0.005),
        (0.02, mid, mid + 0.006, mid - 0.002), (top - 0.030, knee, knee + 0.002, knee - 0.002),
        (top, knee + 0.003, knee, knee - 0.002), (top + 0.022, knee - 0.011, knee - 0.013, knee - 0.012),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.011))


def _shorts_leg(build: Build) -> SmoothMesh:
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top + 0.035, 0.052, 0.052, 0.047), (0.0, 0.053, 0.055, 0.048), (top - 0.05, 0.054, 0.059, 0.050),
        (top, 0.052, 0.059, 0.051), (top + 0.028, 0.038, 0.046, 0.039),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.014))


def _section_across(x: float, half: float, low: float, high: float) -> list[Vec3]:
    """Return an outline in the plane x, counter-clockwise seen from ahead: a flat bottom and a round top."""
    rise = high - low
    side = [(0.94, 0.0), (1.0, 0.40), (0.66, 0.86)]
    right = [(x, -half * w, low + rise * t) for w, t in side]
    left = [(x, half * w, low + rise * t) for w, t in side]
    return [*left, (x, 0.0, high), *reversed(right)]


def _shoe_of(rows: Sequence[tuple[float, float, float, float]]) -> SmoothMesh:
    """Loft through rows x, half width, low and high z, from heel to toe."""
    outlines = [_section_across(*row) for row in rows]
    (xa, _, la, ha), (xb, _, lb, hb) = rows[0], rows[-1]
    ends = ((xa - 0.005, 0.0, 0.5 * (la + ha)), (xb + 0.002, 0.0, 0.5 * (lb + hb)))
    return skin(outlines, ends=ends, rows=[row[0] / 0.3 for row in rows])


def _shoe(build: Build) -> SmoothMesh:
    sole = -build.figure.ankle_m
    return _shoe_of([
        (-0.036, 0.017, sole, 0.004), (0.010, 0.023, sole, 0.010), (0.042, 0.026, sole, -0.010),
        (0.074, 0.028, sole, -0.018), (0.098, 0.018, sole + 0.003, -0.025),
    ])  # fmt: skip


def _sole(build: Build) -> SmoothMesh:
    low = -build.figure.ankle_m
    high = low + 0.011
    return _shoe_of([
        (-0.038, 0.019, low, high), (0.030, 0.026, low, high), (0.076, 0.029, low, high),
        (0.101, 0.018, low + 0.004, high),
    ])  # fmt: skip


def _boot_shaft(build: Build) -> SmoothMesh:
    top = build.figure.shank_m / 2
    rows: list[Row] = [
        (-top - 0.014, 0.028, 0.024, 0.021), (-top + 0.012, 0.026, 0.028, 0.023), (-top + 0.07, 0.029, 0.034, 0.028),
    ]  # fmt: skip
    return _tube(rows, 8, creases=(0, -1))


# Pelvis and torso.


def _pelvis(build: Build) -> SmoothMesh:
    wide = 1.05 if build.female else 1.0
    t = build.trunk
    rows: list[Row] = [
        (-0.052, 0.034, 0.040, 0.058), (-0.030, 0.053, 0.066, 0.090 * wide), (0.000, 0.055, 0.068, 0.093 * wide),
        (0.028, 0.045, 0.050, 0.080 * wide),
    ]  # fmt: skip
    return _tube(rows, 10, girth=t, square=0.06, creases=(-1,), caps=(0.008, 0.0))


def _torso_rows(build: Build) -> list[Row]:
    """Return the trunk from the hips to the neck, in the torso's frame, without a garment's hem."""
    b = build.belly
    if build.child:
        return [
            (-0.215, 0.068, 0.070, 0.096), (-0.15, 0.067, 0.064, 0.094), (-0.075, 0.067, 0.055, 0.088),
            (0.0, 0.064, 0.056, 0.090), (0.045, 0.062, 0.058, 0.093), (0.078, 0.050, 0.051, 0.094),
            (0.097, 0.038, 0.042, 0.076), (0.108, 0.031, 0.037, 0.052), (0.118, 0.027, 0.032, 0.036),
        ]  # fmt: skip
    if build.female:
        return [
            (-0.215, 0.072, 0.080, 0.106), (-0.15, 0.067 + b, 0.073, 0.104), (-0.060, 0.056 + b, 0.048, 0.079),
            (0.0, 0.062 + 0.6 * b, 0.050, 0.085), (0.036, 0.077, 0.055, 0.091), (0.080, 0.057, 0.055, 0.099),
            (0.112, 0.038, 0.043, 0.090), (0.131, 0.028, 0.034, 0.056), (0.149, 0.023, 0.027, 0.028),
        ]  # fmt: skip
    return [
        (-0.215, 0.072, 0.076, 0.101), (-0.15, 0.069 + b, 0.070, 0.100), (-0.070, 0.063 + 1.3 * b, 0.053, 0.089),
        (0.0, 0.066 + b, 0.054, 0.096), (0.045, 0.072 + 0.5 * b, 0.060, 0.104), (0.084, 0.064, 0.059, 0.110),
        (0.112, 0.045, 0.049, 0.103), (0.133, 0.031, 0.037, 0.067), (0.153, 0.026, 0.030, 0.033),
    ]  # fmt: skip


def _top(build: Build, *, hem: float, loose: float, flare: float = 1.0, collar: float = 0.0) -> SmoothMesh:
    """Return a garment of the trunk: down to z = `hem`, wider than the body by `loose`, at the hem also by `flare`."""
    body = _torso_rows(build)
    rows: list[Row] = [row for row in body if row[0] > hem + 0.02]
    rows = [_at(body, hem), *rows] if hem > body[0][0] else [(hem, *body[0][1:]), *body]
    t = build.trunk
    wider: list[Row] = []
    for z, front, back, half in rows:
        slope = min(max((z - 0.06) / 0.08, 0.0), 1.0)  # garments lie on the shoulders
        free = loose * (1.0 - slope)
        flared = 1.0 + (flare - 1.0) * min(max(-(z + 0.05) / -(hem + 0.05), 0.0), 1.0) if hem < -0.05 else 1.0
        trunk = t + (1.0 - t) * slope
        wider.append((z, trunk * front * flared + free, trunk * back * flared + free, trunk * half * flared + free))
    if collar:
        z, front, back, half = wider[-1]
        wider.append((z + collar, front + 0.001, back + 0.001, half + 0.001))
    return _tube(wider, _TRUNK_SIDES, square=0.05, creases=(0, -1), caps=(0.0, 0.002 if not collar else -0.01))


def _shirt(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.190, loose=0.004)


def _sweater(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.190, loose=0.008)


def _jacket(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.205, loose=0.012, flare=1.04, collar=0.014)


def _coat(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.36, loose=0.014, flare=1.18, collar=0.016)


def _hoodie(build: Build) -> SmoothMesh:
    mesh = _top(build, hem=-0.192, loose=0.010)
    top = _torso_rows(build)[-1][0]
    mesh.add(ball((-0.040, 0.0, top - 0.012), (0.026, 0.058, 0.030), 10, 4))
    return mesh


def _dress(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.375, loose=0.005, flare=1.38)


def _skirt(build: Build) -> SmoothMesh:
    t = build.trunk
    rows: list[Row] = [
        (-0.20, 0.098, 0.104, 0.132), (-0.10, 0.084, 0.092, 0.120), (-0.02, 0.068, 0.078, 0.106),
        (0.04, 0.062, 0.068, 0.097), (0.095, 0.058, 0.052, 0.084),
    ]  # fmt: skip
    return _tube(rows, _TRUNK_SIDES, girth=t, creases=(0, -1))


def _skirt_leg(build: Build) -> SmoothMesh:
    """Return the part of a skirt or coat that moves with the thigh."""
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-0.072, 0.066, 0.066, 0.056), (-0.02, 0.062, 0.063, 0.054), (top - 0.05, 0.056, 0.060, 0.051),
        (top, 0.053, 0.060, 0.051), (top + 0.028, 0.036, 0.044, 0.038),
    ]  # fmt: skip
    return _tube(rows, _LIMB_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.014))


def _front(build: Build, hem: float, loose: float, half: float) -> SmoothMesh:
    """Return the strip of a shirt that an open jacket shows, wider at the collar."""
    body = _torso_rows(build)
    outlines = []
    heights = [z for z in (hem, *(row[0] for row in body), 0.140) if hem <= z <= 0.140]
    for z in sorted(set(heights)):
        _, front, _, broad = _at(body, z)
        slope = min(max((z - 0.06) / 0.08, 0.0), 1.0)
        trunk = build.trunk + (1.0 - build.trunk) * slope
        x, broad = trunk * front + loose * (1.0 - slope), trunk * broad + loose * (1.0 - slope)
        w = half + (0.010 if z > 0.06 else 0.0)
        # The garment has a corner in front and the next ones 30 degrees to either side.
        edge = x * (1.0 - 0.10 * w / (0.5 * broad)) + 0.004
        x += 0.004
        outlines.append([(x - 0.02, -w, z), (edge, -w, z), (x, 0.0, z), (edge, w, z), (x - 0.02, w, z)])
    low, high = outlines[0], outlines[-1]
    ends = ((low[2][0] - 0.012, 0.0, low[0][2]), (high[2][0] - 0.012, 0.0, high[0][2]))
    return skin(outlines, ends=ends, rows=[points[0][2] / 0.3 for points in outlines])


def _vest(build: Build) -> SmoothMesh:
    """Return a plate carrier with pouches, worn over the uniform."""
    body = [row for row in _torso_rows(build) if -0.08 < row[0] < 0.10]
    body = [_at(_torso_rows(build), -0.095), *body]
    t = build.trunk
    rows: list[Row] = [(z, t * f + 0.020, t * b + 0.018, t * h + 0.004) for z, f, b, h in body]
    _, f, b, h = rows[-1]
    rows.append((0.112, f - 0.010, b - 0.008, 0.72 * h))
    mesh = _tube(rows, 12, square=0.10, creases=(0, -1))
    for y in (-0.037, 0.037):
        mesh.add(block((f + 0.012, y, -0.045), (0.013, 0.031, 0.036)))
    mesh.add(block((-0.075, 0.0, 0.02), (0.020, 0.052, 0.058)))
    return mesh


# Arms.


def _bare_arm(build: Build) -> SmoothMesh:
    """Return the lower half of the upper arm, for below a short sleeve."""
    top = build.figure.upper_arm_m / 2
    rows: list[Row] = [
        (-top - 0.014, 0.015, 0.015, 0.014), (-top, 0.0215, 0.022, 0.021), (-0.03, 0.024, 0.024, 0.023),
        (0.02, 0.027, 0.027, 0.025),
    ]  # fmt: skip
    return _tube(rows, _ARM_SIDES, girth=build.girth, creases=(-1,), caps=(0.006, 0.0))


def _sleeve(build: Build, loose: float = 0.003) -> SmoothMesh:
    top = build.figure.upper_arm_m / 2
    w = loose
    rows: list[Row] = [
        (-top - 0.016, 0.019 + w, 0.019 + w, 0.018 + w), (-top, 0.025 + w, 0.026 + w, 0.024 + w),
        (0.03, 0.028 + w, 0.029 + w, 0.026 + w), (top - 0.020, 0.029 + w, 0.030 + w, 0.026 + w),
        (top - 0.002, 0.021 + w, 0.023 + w, 0.017 + w),
    ]  # fmt: skip
    return _tube(rows, _ARM_SIDES, girth=build.girth, caps=(0.010, 0.010))


def _short_sleeve(build: Build) -> SmoothMesh:
    top = build.figure.upper_arm_m / 2
    rows: list[Row] = [
        (-0.025, 0.032, 0.032, 0.030), (0.03, 0.032, 0.032, 0.030), (top - 0.020, 0.031, 0.032, 0.028),
        (top - 0.002, 0.022, 0.024, 0.018),
    ]  # fmt: skip
    return _tube(rows, _ARM_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.010))


def _forearm(build: Build) -> SmoothMesh:
    top = build.figure.forearm_m / 2
    rows: list[Row] = [
        (-top - 0.004, 0.013, 0.013, 0.011), (-0.035, 0.017, 0.017, 0.015), (0.03, 0.023, 0.023, 0.021),
        (top, 0.0215, 0.022, 0.021), (top + 0.014, 0.013, 0.013, 0.012),
    ]  # fmt: skip
    return _tube(rows, _ARM_SIDES, girth=build.girth, caps=(0.003, 0.004))


def _long_cuff(build: Build, loose: float = 0.003) -> SmoothMesh:
    top = build.figure.forearm_m / 2
    w = loose
    rows: list[Row] = [
        (-top + 0.004, 0.0165 + w, 0.0165 + w, 0.0145 + w), (0.02, 0.024 + w, 0.024 + w, 0.022 + w),
        (top - 0.006, 0.0255 + w, 0.026 + w, 0.024 + w), (top + 0.014, 0.019 + w, 0.019 + w, 0.018 + w),
    ]  # fmt: skip
    return _tube(rows, _ARM_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.011))


def _hand(build: Build) -> SmoothMesh:
    g = 1.0 if not build.female else 0.93
    rows: list[Row] = [
        (-0.042, 0.011, 0.013, 0.008, 0.003), (-0.012, 0.019, 0.021, 0.012), (0.010, 0.022, 0.022, 0.013),
        (0.032, 0.017, 0.017, 0.0125), (0.054, 0.0125, 0.0125, 0.0105),
    ]  # fmt: skip
    mesh = _tube([(*row, 0.0) if len(row) == 4 else row for row in rows], 6, girth=g, caps=(0.012, 0.003))
    thumb: list[Row] = [(-0.014, 0.006, 0.006, 0.006, 0.031), (0.012, 0.008, 0.008, 0.007, 0.022)]
    mesh.add(_tube(thumb, 4, girth=g, caps=(0.009, 0.016)))
    return mesh


# Head, hair, headgear.

_FACE: list[Row] = [  # z, x of the front and of the back, half width, further forward in the middle (chin, lips, nose)
    (-0.060, 0.042, -0.013, 0.019, 0.002), (-0.047, 0.044, -0.033, 0.031, 0.002),
    (-0.037, 0.046, -0.043, 0.035, 0.003), (-0.027, 0.046, -0.049, 0.038, 0.003), (-0.018, 0.046, -0.052, 0.040, 0.015),
    (-0.008, 0.046, -0.055, 0.042, 0.010), (0.004, 0.046, -0.057, 0.043, 0.004), (0.013, 0.050, -0.059, 0.0435, 0.001),
    (0.029, 0.050, -0.059, 0.0435, 0.0), (0.046, 0.041, -0.052, 0.039, 0.0), (0.060, 0.020, -0.032, 0.023, 0.0),
]  # fmt: skip
_CROWN = 0.066


def _head_scale(build: Build) -> float:
    return 1.24 if build.child else 0.97 if build.female else 1.0


def _face_section(z: float, wider: float = 0.0) -> Section:
    z, front, back, half, _ = _at(_FACE, z)
    x = -0.006
    return Section(z, front - x + wider, x - back + wider, half + wider, x)


def _head(build: Build) -> SmoothMesh:
    outlines = []
    for z, _, _, _, nose in _FACE:
        points = outline(_face_section(z), _HEAD_SIDES)
        i = _HEAD_SIDES // 2
        x, y, _ = points[i]
        points[i] = (x + nose, y, z)
        if nose < 0.004 and z < 0.0:  # chin and lips are blunt
            for k in (i - 1, i + 1):
                px, py, _ = points[k]
                points[k] = (px + 0.6 * nose, py, z)
        outlines.append(points)
    v = [(z + 0.066) / 0.132 for z, *_ in _FACE]
    mesh = skin(outlines, ends=((0.012, 0.0, -0.066), (-0.006, 0.0, _CROWN)), rows=v)
    for y in (-0.0425, 0.0425):
        mesh.add(ball((-0.008, y, -0.007), (0.010, 0.006, 0.016), 4, 2).with_uv(_PLAIN_UV))
    k = _head_scale(build)
    mesh = _scaled(mesh, k)
    f = build.figure
    base = f.shoulder_above_hip_m - f.head_above_hip_m
    r = (0.0275 if build.female else 0.032) * (0.92 if build.child else 1.0)
    neck: list[Row] = [
        (base + 0.006, 1.25 * r, 1.3 * r, 1.35 * r, -0.010), (base + 0.032, r, 1.05 * r, r, -0.011),
        (-0.03 * k, 0.9 * r, 0.9 * r, r, -0.014),
    ]  # fmt: skip
    mesh.add(_tube(neck, 7).with_uv(_PLAIN_UV))
    return mesh


def _scaled(mesh: SmoothMesh, k: float) -> SmoothMesh:
    vertices = [(k * x, k * y, k * z) for x, y, z in mesh.vertices]
    return SmoothMesh(vertices, mesh.uvs, mesh.triangles, mesh.groups)


def _shell(limits: Sequence[float], thick: float, rise: float, *, straight: bool = False, rows: int = 4) -> SmoothMesh:
    """Return a cover of the skull down to `limits`: z for every corner from the back round to the front (symmetric).

    `thick`: over the skin; `rise`: over the crown. `straight`: below the ears it hangs down.
    """
    low = []
    for i in range(_HEAD_SIDES):
        turn = 2.0 * min(i, _HEAD_SIDES - i) / _HEAD_SIDES * (len(limits) - 1)
        k = min(int(turn), len(limits) - 2)
        low.append(limits[k] + (turn - k) * (limits[k + 1] - limits[k]))
    top = _CROWN + rise
    outlines = []
    for share in [0.0, *((k / rows) for k in range(rows, 0, -1))]:
        points = []
        for i in range(_HEAD_SIDES):
            inner = share == 0.0
            z = low[i] if inner else top - (top - low[i]) * share * (0.4 + 0.6 * share)
            at = min(z, _CROWN - 0.001 + rise)
            level = max(at, -0.012) if straight else at
            # Heights of the shell over the crown belong to heights of the skull a little lower.
            level = level - rise * max(0.0, level / top)
            section = _face_section(min(level, 0.060), -0.004 if inner else thick)
            x, y, _ = outline(section, _HEAD_SIDES)[i]
            points.append((x, y, z + (0.002 if inner else 0.0)))
        outlines.append(points)
    v = [points[0][2] / 0.3 for points in outlines]
    return skin(outlines, ends=((-0.006, 0.0, 0.0), (-0.008, 0.0, top)), rows=v, creases=(1,))


# Heights of the hairline at the nape, ..., the ear (fifth), ..., the forehead (last).
_SHORT = (-0.040, -0.038, -0.026, -0.012, 0.002, 0.010, 0.030, 0.040, 0.042)


def _hair_short(build: Build) -> SmoothMesh:
    return _scaled(_shell(_SHORT, 0.005, 0.005), _head_scale(build))


def _hair_full(build: Build) -> SmoothMesh:
    limits = (-0.050, -0.048, -0.036, -0.022, -0.008, 0.006, 0.024, 0.034, 0.036)
    return _scaled(_shell(limits, 0.010, 0.011), _head_scale(build))


def _hair_bob(build: Build) -> SmoothMesh:
    limits = (-0.070, -0.070, -0.068, -0.064, -0.054, -0.018, 0.018, 0.034, 0.036)
    return _scaled(_shell(limits, 0.009, 0.009, straight=True), _head_scale(build))


def _hair_long(build: Build) -> SmoothMesh:
    limits = (-0.145, -0.143, -0.135, -0.118, -0.082, -0.015, 0.020, 0.035, 0.037)
    return _scaled(_shell(limits, 0.008, 0.008, straight=True, rows=5), _head_scale(build))


def _hair_bun(build: Build) -> SmoothMesh:
    mesh = _shell(_SHORT, 0.005, 0.005)
    mesh.add(ball((-0.068, 0.0, 0.026), (0.021, 0.024, 0.022), 8, 4))
    return _scaled(mesh, _head_scale(build))


def _hair_tail(build: Build) -> SmoothMesh:
    mesh = _shell(_SHORT, 0.005, 0.006)
    tail = [
        (-0.115, 0.006, 0.006, 0.008, -0.078), (-0.08, 0.011, 0.011, 0.015, -0.080),
        (-0.02, 0.012, 0.012, 0.016, -0.080), (0.02, 0.010, 0.012, 0.013, -0.070), (0.034, 0.006, 0.006, 0.008, -0.060),
    ]  # fmt: skip
    mesh.add(_tube(tail, 8, caps=(0.008, 0.003)))
    return _scaled(mesh, _head_scale(build))


def _cap(build: Build) -> SmoothMesh:
    limits = (0.010, 0.010, 0.010, 0.012, 0.014, 0.018, 0.021, 0.023, 0.024)
    mesh = _shell(limits, 0.009, 0.010)
    brim = [
        Section(0.018, 0.102, -0.02, 0.044, -0.002), Section(0.025, 0.100, -0.02, 0.044, -0.002),
    ]  # fmt: skip
    peak = [[(x, y, z - 0.35 * max(x - 0.04, 0.0)) for x, y, z in _half_disc(s)] for s in brim]
    mesh.add(skin(peak, ends=((0.05, 0.0, 0.0145), (0.05, 0.0, 0.0215)), creases=(0, 1), rows=[0.0, 0.0]))
    return _scaled(mesh, _head_scale(build))


def _half_disc(section: Section) -> list[Vec3]:
    points = outline(section, 12)
    return [(max(x, 0.030), y, z) if x > 0.0 else (0.030 + 0.0001 * i, y, z) for i, (x, y, z) in enumerate(points)]


def _beanie(build: Build) -> SmoothMesh:
    limits = (-0.012, -0.012, -0.010, -0.006, 0.000, 0.010, 0.020, 0.026, 0.028)
    return _scaled(_shell(limits, 0.010, 0.018), _head_scale(build))


def _helmet(build: Build) -> SmoothMesh:
    limits = (-0.030, -0.030, -0.030, -0.028, -0.020, 0.000, 0.016, 0.020, 0.021)
    return _scaled(_shell(limits, 0.016, 0.020), _head_scale(build))


# Bags.


def _backpack(build: Build) -> SmoothMesh:
    deep = build.trunk * 0.058
    mesh = block((-deep - 0.036, 0.0, -0.005), (0.036, 0.076, 0.108), square=0.20)
    mesh.add(block((-deep - 0.074, 0.0, -0.045), (0.014, 0.056, 0.052), square=0.22))
    return mesh


def _straps(build: Build) -> SmoothMesh:
    mesh = SmoothMesh.empty()
    body = _torso_rows(build)
    for side in (-1.0, 1.0):
        sections = []
        for z, y in ((-0.02, 0.088), (0.03, 0.074), (0.08, 0.062), (0.112, 0.055), (0.132, 0.050)):
            z = min(z, body[-1][0] - 0.012)
            _, front, _, half = _at(body, z)
            slope = min(max((z - 0.06) / 0.08, 0.0), 1.0)
            trunk = build.trunk + (1.0 - build.trunk) * slope
            s = min(y / (trunk * half), 0.97)
            x = trunk * front * (1.0 - s * s) ** 0.5 + 0.010
            sections.append(Section(z, 0.006, 0.014, 0.013, x - 0.002, side * y, 0.2))
        sections.append(Section(sections[-1].z + 0.012, 0.012, 0.030, 0.012, -0.012, side * 0.048, 0.2))
        mesh.add(loft(sections, 6, creases=(0, -1)))
    return mesh


def _shoulder_bag(build: Build) -> SmoothMesh:
    y = -0.112 * build.trunk - 0.022
    mesh = block((0.0, y, -0.165), (0.062, 0.022, 0.052), square=0.2)
    body = _torso_rows(build)
    chest = max(row[1] for row in body) * build.trunk + 0.012
    for x in (chest, -0.062 * build.trunk - 0.012):  # the strap in front and behind, from hip to shoulder
        near = -0.008 if x > 0.0 else 0.008
        sections = [
            Section(-0.130, 0.004, 0.012, 0.010, 0.45 * x, 0.95 * y),
            Section(-0.06, 0.003, 0.016, 0.010, 0.97 * x, -0.056),
            Section(0.04, 0.003, 0.018, 0.010, 1.02 * x, -0.006),
            Section(0.100, 0.003, 0.018, 0.010, 0.80 * x + near, 0.038),
            Section(0.136, 0.008, 0.010, 0.010, 0.08 * x, 0.058),
        ]
        if x < 0.0:
            sections = [Section(s.z, s.back, s.front, s.half_y, s.x, s.y) for s in sections]
        mesh.add(loft(sections, 6, creases=(0, -1)))
    return mesh


def _shopping_bag(_build: Build) -> SmoothMesh:
    mesh = block((0.004, 0.0, -0.165), (0.070, 0.028, 0.088), square=0.2, taper=0.94)
    for x in (-0.030, 0.036):
        handle: list[Row] = [
            (-0.085, 0.004, 0.004, 0.004, x), (-0.05, 0.004, 0.004, 0.004, 0.5 * x + 0.002),
            (-0.02, 0.004, 0.004, 0.004, 0.004 + 0.05 * x),
        ]  # fmt: skip
        mesh.add(_tube(handle, 5, creases=(0, -1)))
    return mesh


_MAKERS: dict[str, Callable[[Build], SmoothMesh]] = {
    "thigh": _bare_thigh, "shank": _shank, "trouser_thigh": _trouser_thigh, "trouser_shank": _trouser_shank,
    "slim_shank": lambda build: _trouser_shank(build, 0.027, -0.002, 0.038),
    "wide_shank": lambda build: _trouser_shank(build, 0.042, -0.012, 0.043),
    "bloused_shank": lambda build: _trouser_shank(build, 0.037, 0.06, 0.042),
    "shorts_leg": _shorts_leg, "shoe": _shoe, "sole": _sole, "boot_shaft": _boot_shaft,
    "pelvis": _pelvis, "shirt": _shirt, "sweater": _sweater, "jacket": _jacket, "coat": _coat, "hoodie": _hoodie,
    "dress": _dress, "skirt": _skirt, "skirt_leg": _skirt_leg, "vest": _vest,
    "jacket_front": lambda build: _front(build, -0.19, 0.012, 0.020),
    "coat_front": lambda build: _front(build, 0.02, 0.014, 0.018),
    "arm": _bare_arm, "sleeve": _sleeve, "short_sleeve": _short_sleeve, "forearm": _forearm, "cuff": _long_cuff,
    "wide_sleeve": lambda build: _sleeve(build, 0.008), "wide_cuff": lambda build: _long_cuff(build, 0.008),
    "hand": _hand, "head": _head,
    "hair_short": _hair_short, "hair_full": _hair_full, "hair_bob": _hair_bob, "hair_long": _hair_long,
    "hair_bun": _hair_bun, "hair_tail": _hair_tail, "cap": _cap, "beanie": _beanie, "helmet": _helmet,
    "backpack": _backpack, "straps": _straps, "shoulder_bag": _shoulder_bag, "shopping_bag": _shopping_bag,
}  # fmt: skip
PARTS = tuple(_MAKERS)


@cache
def body_mesh(part: str, build: str) -> SmoothMesh:
    """Return the mesh of a part in the frame of its limb, for a body 1 m tall; `build`: a key of BUILDS."""
    return _MAKERS[part](BUILDS[build])
