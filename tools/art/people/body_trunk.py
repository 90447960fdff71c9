"""Meshes of pelvis and torso: clothes, and what is carried on them."""

from __future__ import annotations

from math import sqrt

from tools.art.people.body_build import Build, Row, row_at, tube
from tools.art.people.loft import Section, SmoothMesh, ball, block, loft, skin

_SIDES = 12
_LEG_SIDES = 8


def pelvis(build: Build) -> SmoothMesh:
    wide = 1.05 if build.female else 1.0
    t = build.trunk
    rows: list[Row] = [
        (-0.052, 0.034, 0.040, 0.058), (-0.030, 0.053, 0.066, 0.090 * wide), (0.000, 0.055, 0.068, 0.093 * wide),
        (0.028, 0.045, 0.050, 0.080 * wide),
    ]  # fmt: skip
    return tube(rows, 10, girth=t, square=0.06, creases=(-1,), caps=(0.008, 0.0))


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
    rows = [row_at(body, hem), *rows] if hem > body[0][0] else [(hem, *body[0][1:]), *body]
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
    return tube(wider, _SIDES, square=0.05, creases=(0, -1), caps=(0.0, 0.002 if not collar else -0.01))


def shirt(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.190, loose=0.004)


def sweater(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.190, loose=0.008)


def jacket(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.205, loose=0.012, flare=1.04, collar=0.014)


def coat(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.36, loose=0.014, flare=1.18, collar=0.016)


def hoodie(build: Build) -> SmoothMesh:
    mesh = _top(build, hem=-0.192, loose=0.010)
    top = _torso_rows(build)[-1][0]
    mesh.add(ball((-0.040, 0.0, top - 0.012), (0.026, 0.058, 0.030), 10, 4))
    return mesh


def dress(build: Build) -> SmoothMesh:
    return _top(build, hem=-0.375, loose=0.005, flare=1.38)


def skirt(build: Build) -> SmoothMesh:
    t = build.trunk
    rows: list[Row] = [
        (-0.20, 0.098, 0.104, 0.132), (-0.10, 0.084, 0.092, 0.120), (-0.02, 0.068, 0.078, 0.106),
        (0.04, 0.062, 0.068, 0.097), (0.095, 0.058, 0.052, 0.084),
    ]  # fmt: skip
    return tube(rows, _SIDES, girth=t, creases=(0, -1))


def skirt_leg(build: Build) -> SmoothMesh:
    """Return the part of a skirt or coat that moves with the thigh."""
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-0.072, 0.066, 0.066, 0.056), (-0.02, 0.062, 0.063, 0.054), (top - 0.05, 0.056, 0.060, 0.051),
        (top, 0.053, 0.060, 0.051), (top + 0.028, 0.036, 0.044, 0.038),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.014))


def front(build: Build, hem: float, loose: float, half: float) -> SmoothMesh:
    """Return the strip of a shirt that an open jacket shows, wider at the collar."""
    body = _torso_rows(build)
    outlines = []
    heights = [z for z in (hem, *(row[0] for row in body), 0.140) if hem <= z <= 0.140]
    for z in sorted(set(heights)):
        _, front, _, broad = row_at(body, z)
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


def vest(build: Build) -> SmoothMesh:
    """Return a plate carrier with pouches, worn over the uniform."""
    body = [row for row in _torso_rows(build) if -0.08 < row[0] < 0.10]
    body = [row_at(_torso_rows(build), -0.095), *body]
    t = build.trunk
    rows: list[Row] = [(z, t * f + 0.020, t * b + 0.018, t * h + 0.004) for z, f, b, h in body]
    _, f, b, h = rows[-1]
    rows.append((0.112, f - 0.010, b - 0.008, 0.72 * h))
    mesh = tube(rows, 12, square=0.10, creases=(0, -1))
    for y in (-0.037, 0.037):
        mesh.add(block((f + 0.012, y, -0.045), (0.013, 0.031, 0.036)))
    mesh.add(block((-0.075, 0.0, 0.02), (0.020, 0.052, 0.058)))
    return mesh


def backpack(build: Build) -> SmoothMesh:
    deep = build.trunk * 0.058
    mesh = block((-deep - 0.036, 0.0, -0.005), (0.036, 0.076, 0.108), square=0.20)
    mesh.add(block((-deep - 0.074, 0.0, -0.045), (0.014, 0.056, 0.052), square=0.22))
    return mesh


def straps(build: Build) -> SmoothMesh:
    mesh = SmoothMesh.empty()
    body = _torso_rows(build)
    for side in (-1.0, 1.0):
        sections = []
        for z, y in ((-0.02, 0.088), (0.03, 0.074), (0.08, 0.062), (0.112, 0.055), (0.132, 0.050)):
            z = min(z, body[-1][0] - 0.012)
            _, front, _, half = row_at(body, z)
            slope = min(max((z - 0.06) / 0.08, 0.0), 1.0)
            trunk = build.trunk + (1.0 - build.trunk) * slope
            s = min(y / (trunk * half), 0.97)
            x = trunk * front * sqrt(1.0 - s * s) + 0.010
            sections.append(Section(z, 0.006, 0.014, 0.013, x - 0.002, side * y, 0.2))
        sections.append(Section(sections[-1].z + 0.012, 0.012, 0.030, 0.012, -0.012, side * 0.048, 0.2))
        mesh.add(loft(sections, 6, creases=(0, -1)))
    return mesh


def shoulder_bag(build: Build) -> SmoothMesh:
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


def shopping_bag(_build: Build) -> SmoothMesh:
    mesh = block((0.004, 0.0, -0.165), (0.070, 0.028, 0.088), square=0.2, taper=0.94)
    for x in (-0.030, 0.036):
        handle: list[Row] = [
            (-0.085, 0.004, 0.004, 0.004, x), (-0.05, 0.004, 0.004, 0.004, 0.5 * x + 0.002),
            (-0.02, 0.004, 0.004, 0.004, 0.004 + 0.05 * x),
        ]  # fmt: skip
        mesh.add(tube(handle, 5, creases=(0, -1)))
    return mesh
