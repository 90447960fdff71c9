"""Meshes of the head: face, hair, headgear."""

from __future__ import annotations

from collections.abc import Sequence

from signals.samples import Vec3
from tools.art.people.body_build import Build, Row, row_at, tube
from tools.art.people.loft import Section, SmoothMesh, ball, outline, skin

_SIDES = 12
_PLAIN_UV = (0.02, 0.02)  # of the face's texture: bare skin
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
    z, front, back, half, _ = row_at(_FACE, z)
    x = -0.006
    return Section(z, front - x + wider, x - back + wider, half + wider, x)


def head(build: Build) -> SmoothMesh:
    outlines = []
    for z, _, _, _, nose in _FACE:
        points = outline(_face_section(z), _SIDES)
        i = _SIDES // 2
        x, y, _ = points[i]
        points[i] = (x + nose, y, z)
        if nose < 0.004 and z < 0.0:  # chin and lips are blunt
            for beside in (i - 1, i + 1):
                px, py, _ = points[beside]
                points[beside] = (px + 0.6 * nose, py, z)
        outlines.append(points)
    v = [(z + 0.066) / 0.132 for z, *_ in _FACE]
    mesh = skin(outlines, ends=((0.012, 0.0, -0.066), (-0.006, 0.0, _CROWN)), rows=v)
    for side_m in (-0.0425, 0.0425):
        mesh.add(ball((-0.008, side_m, -0.007), (0.010, 0.006, 0.016), 4, 2).with_uv(_PLAIN_UV))
    k = _head_scale(build)
    mesh = _scaled(mesh, k)
    f = build.figure
    base = f.shoulder_above_hip_m - f.head_above_hip_m
    r = (0.0275 if build.female else 0.032) * (0.92 if build.child else 1.0)
    neck: list[Row] = [
        (base + 0.006, 1.25 * r, 1.3 * r, 1.35 * r, -0.010), (base + 0.032, r, 1.05 * r, r, -0.011),
        (-0.03 * k, 0.9 * r, 0.9 * r, r, -0.014),
    ]  # fmt: skip
    mesh.add(tube(neck, 7).with_uv(_PLAIN_UV))
    return mesh


def _scaled(mesh: SmoothMesh, k: float) -> SmoothMesh:
    vertices = [(k * x, k * y, k * z) for x, y, z in mesh.vertices]
    return SmoothMesh(vertices, mesh.uvs, mesh.triangles, mesh.groups)


def _shell(limits: Sequence[float], thick: float, rise: float, *, straight: bool = False, rows: int = 4) -> SmoothMesh:
    """Return a cover of the skull down to `limits`: z, evenly from the back round to the front.

    `thick`: over the skin; `rise`: over the crown. `straight`: below the ears it hangs down.
    """
    low = []
    for i in range(_SIDES):
        turn = 2.0 * min(i, _SIDES - i) / _SIDES * (len(limits) - 1)
        k = min(int(turn), len(limits) - 2)
        low.append(limits[k] + (turn - k) * (limits[k + 1] - limits[k]))
    top = _CROWN + rise
    outlines = []
    for share in [0.0, *((k / rows) for k in range(rows, 0, -1))]:
        points = []
        for i in range(_SIDES):
            inner = share == 0.0
            z = low[i] if inner else top - (top - low[i]) * share * (0.4 + 0.6 * share)
            at = min(z, _CROWN - 0.001 + rise)
            level = max(at, -0.012) if straight else at
            # Heights of the shell over the crown belong to heights of the skull a little lower.
            level = level - rise * max(0.0, level / top)
            section = _face_section(min(level, 0.060), -0.004 if inner else thick)
            x, y, _ = outline(section, _SIDES)[i]
            points.append((x, y, z + (0.002 if inner else 0.0)))
        outlines.append(points)
    v = [points[0][2] / 0.3 for points in outlines]
    return skin(outlines, ends=((-0.006, 0.0, 0.0), (-0.008, 0.0, top)), rows=v, creases=(1,))


# Heights of the hairline at the nape, ..., the ear (fifth), ..., the forehead (last).
_SHORT = (-0.040, -0.038, -0.026, -0.012, 0.002, 0.010, 0.030, 0.040, 0.042)


def hair_short(build: Build) -> SmoothMesh:
    return _scaled(_shell(_SHORT, 0.005, 0.005), _head_scale(build))


def hair_full(build: Build) -> SmoothMesh:
    limits = (-0.050, -0.048, -0.036, -0.022, -0.008, 0.006, 0.024, 0.034, 0.036)
    return _scaled(_shell(limits, 0.010, 0.011), _head_scale(build))


def hair_bob(build: Build) -> SmoothMesh:
    limits = (-0.070, -0.070, -0.068, -0.064, -0.054, -0.018, 0.018, 0.034, 0.036)
    return _scaled(_shell(limits, 0.009, 0.009, straight=True), _head_scale(build))


def hair_long(build: Build) -> SmoothMesh:
    limits = (-0.145, -0.143, -0.135, -0.118, -0.082, -0.015, 0.020, 0.035, 0.037)
    return _scaled(_shell(limits, 0.008, 0.008, straight=True, rows=5), _head_scale(build))


def hair_bun(build: Build) -> SmoothMesh:
    mesh = _shell(_SHORT, 0.005, 0.005)
    mesh.add(ball((-0.068, 0.0, 0.026), (0.021, 0.024, 0.022), 8, 4))
    return _scaled(mesh, _head_scale(build))


def hair_tail(build: Build) -> SmoothMesh:
    mesh = _shell(_SHORT, 0.005, 0.006)
    tail = [
        (-0.115, 0.006, 0.006, 0.008, -0.078), (-0.08, 0.011, 0.011, 0.015, -0.080),
        (-0.02, 0.012, 0.012, 0.016, -0.080), (0.02, 0.010, 0.012, 0.013, -0.070), (0.034, 0.006, 0.006, 0.008, -0.060),
    ]  # fmt: skip
    mesh.add(tube(tail, 8, caps=(0.008, 0.003)))
    return _scaled(mesh, _head_scale(build))


def cap(build: Build) -> SmoothMesh:
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


def beanie(build: Build) -> SmoothMesh:
    limits = (-0.012, -0.012, -0.010, -0.006, 0.000, 0.010, 0.020, 0.026, 0.028)
    return _scaled(_shell(limits, 0.010, 0.018), _head_scale(build))


def helmet(build: Build) -> SmoothMesh:
    limits = (-0.030, -0.030, -0.030, -0.028, -0.020, 0.000, 0.016, 0.020, 0.021)
    return _scaled(_shell(limits, 0.016, 0.020), _head_scale(build))
