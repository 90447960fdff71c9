"""Mesh of a dog that walks: 0.58 m at the shoulder, 0.95 m long without its tail.

Trunk, neck, head, ears, legs and tail are tubes of oval section with texture coordinates. u runs round a tube, from the
belly (0) over the back (1/2) to the belly (1); v runs along it within the part's range of `dog_coat.RANGES`.
"""

from __future__ import annotations

from collections.abc import Sequence

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, minus, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2
from sim.scene.maps.objects.dog_coat import RANGES
from tools.art.vehicles.lofts import add_ellipsoid, add_indexed_grid, add_tube, add_vertex, mix

Ring = tuple[Vec3, float, float]  # middle, half width across and half height (of a leg: half depth along the body)

# From the tail to the breast: a deep chest, and a belly that rises towards the thighs.
_TRUNK: tuple[Ring, ...] = (
    ((-0.345, 0.0, 0.505), 0.040, 0.045), ((-0.320, 0.0, 0.492), 0.086, 0.092), ((-0.250, 0.0, 0.476), 0.112, 0.118),
    ((-0.140, 0.0, 0.464), 0.114, 0.124), ((-0.030, 0.0, 0.446), 0.120, 0.138), ((0.070, 0.0, 0.430), 0.130, 0.156),
    ((0.165, 0.0, 0.424), 0.130, 0.164), ((0.240, 0.0, 0.445), 0.116, 0.140), ((0.295, 0.0, 0.475), 0.078, 0.092),
)  # fmt: skip
_NECK: tuple[Ring, ...] = (
    ((0.150, 0.0, 0.505), 0.112, 0.118), ((0.235, 0.0, 0.575), 0.100, 0.112), ((0.305, 0.0, 0.640), 0.088, 0.096),
    ((0.350, 0.0, 0.680), 0.078, 0.082),
)  # fmt: skip
# Skull, stop and muzzle.
_HEAD: tuple[Ring, ...] = (
    ((0.295, 0.0, 0.690), 0.044, 0.046), ((0.322, 0.0, 0.704), 0.080, 0.074), ((0.372, 0.0, 0.714), 0.090, 0.080),
    ((0.422, 0.0, 0.704), 0.082, 0.072), ((0.455, 0.0, 0.684), 0.060, 0.056), ((0.510, 0.0, 0.668), 0.052, 0.047),
    ((0.560, 0.0, 0.660), 0.046, 0.041), ((0.585, 0.0, 0.660), 0.026, 0.026),
)  # fmt: skip
# It hangs, with a brush of long hair.
_TAIL: tuple[Ring, ...] = (
    ((-0.315, 0.0, 0.545), 0.036, 0.038), ((-0.385, 0.0, 0.540), 0.036, 0.048), ((-0.455, 0.0, 0.485), 0.038, 0.060),
    ((-0.510, 0.0, 0.415), 0.036, 0.058), ((-0.560, 0.0, 0.370), 0.024, 0.036), ((-0.605, 0.0, 0.355), 0.006, 0.008),
)  # fmt: skip
# Of the left side: one that hangs, and one that stands up.
_EARS: dict[str, tuple[Ring, ...]] = {
    "ears_down": (
        ((0.345, 0.058, 0.776), 0.014, 0.030), ((0.352, 0.096, 0.752), 0.015, 0.052),
        ((0.362, 0.112, 0.690), 0.013, 0.054), ((0.375, 0.108, 0.630), 0.008, 0.024),
    ),
    "ears_up": (
        ((0.335, 0.050, 0.760), 0.014, 0.044), ((0.338, 0.060, 0.800), 0.013, 0.042),
        ((0.342, 0.069, 0.845), 0.010, 0.028), ((0.345, 0.073, 0.885), 0.004, 0.008),
    ),
}  # fmt: skip
# Shoulder, elbow, forearm, wrist, pastern; thigh, stifle, shank, hock, pastern.
_FRONT_LEG: tuple[Ring, ...] = (
    ((0.170, 0.080, 0.460), 0.054, 0.094), ((0.160, 0.090, 0.350), 0.050, 0.074), ((0.148, 0.094, 0.280), 0.040, 0.050),
    ((0.160, 0.094, 0.175), 0.032, 0.036), ((0.164, 0.094, 0.100), 0.031, 0.033), ((0.172, 0.094, 0.042), 0.029, 0.030),
)  # fmt: skip
_REAR_LEG: tuple[Ring, ...] = (
    ((-0.245, 0.072, 0.48), 0.058, 0.112), ((-0.228, 0.092, 0.38), 0.062, 0.112), ((-0.212, 0.10, 0.285), 0.05, 0.078),
    ((-0.262, 0.102, 0.21), 0.034, 0.046), ((-0.325, 0.102, 0.16), 0.028, 0.034), ((-0.322, 0.102, 0.09), 0.027, 0.030),
    ((-0.312, 0.102, 0.042), 0.029, 0.030),
)  # fmt: skip
# How far each foot is moved forward as the dog walks: left and right.
_FRONT_STEP_M, _REAR_STEP_M = (0.085, -0.075), (-0.080, 0.090)
_PAW: tuple[Ring, ...] = (  # about the middle of a leg's last ring, on the ground
    ((-0.036, 0.0, 0.028), 0.024, 0.020), ((0.0, 0.0, 0.032), 0.040, 0.032), ((0.050, 0.0, 0.027), 0.040, 0.026),
    ((0.080, 0.0, 0.015), 0.022, 0.011),
)  # fmt: skip


def dog() -> dict[str, Mesh]:
    """Return the meshes of fur, of each kind of ears, of nose and eyes, of the tongue, and of the collar."""
    fur, dark, tongue, collar = Mesh.empty(), Mesh.empty(), Mesh.empty(), Mesh.empty()
    _add_oval_tube(fur, _TRUNK, RANGES["trunk"], 14)
    _add_oval_tube(fur, _NECK, RANGES["neck"], 12)
    _add_oval_tube(fur, _HEAD, RANGES["head"], 12)
    _add_oval_tube(fur, _TAIL, RANGES["tail"], 8)
    ears = {name: Mesh.empty() for name in _EARS}
    for side in (1.0, -1.0):
        for name, rings in _EARS.items():
            _add_oval_tube(ears[name], _mirrored(rings, side), RANGES["ear"], 6)
        for leg, (left_m, right_m) in ((_FRONT_LEG, _FRONT_STEP_M), (_REAR_LEG, _REAR_STEP_M)):
            step = _stepping(leg, left_m if side > 0.0 else right_m)
            _add_oval_tube(fur, _mirrored(step, side), RANGES["leg"], 8)
            (x, y, _), _, _ = step[-1]
            paw = [((x + px, side * y, pz), half_y, half_z) for (px, _, pz), half_y, half_z in _PAW]
            _add_oval_tube(fur, paw, RANGES["paw"], 8)
        add_ellipsoid(dark, (0.452, side * 0.046, 0.722), (0.012, 0.012, 0.012), rings=4, sides=6)
    add_ellipsoid(dark, (0.590, 0.0, 0.676), (0.018, 0.026, 0.018), rings=4, sides=8)
    add_tube(dark, [(0.470, 0.0, 0.642), (0.550, 0.0, 0.630)], (0.034, 0.020), 8)  # lower jaw
    add_ellipsoid(tongue, (0.548, 0.0, 0.630), (0.032, 0.022, 0.012), rings=4, sides=8)
    add_ellipsoid(tongue, (0.574, 0.0, 0.610), (0.009, 0.020, 0.026), rings=4, sides=8)
    add_tube(collar, [(0.258, 0.0, 0.598), (0.276, 0.0, 0.614)], 0.112, 12)
    return {"fur": fur, **ears, "dark": dark, "tongue": tongue, "collar": collar}


def _stepping(leg: Sequence[Ring], forward_m: float) -> list[Ring]:
    """Return a leg whose foot is moved forward, and what is above it by the share of its depth below the leg's top."""
    top, foot = leg[0][0][2], leg[-1][0][2]
    return [((x + forward_m * (top - z) / (top - foot), y, z), half_y, half) for (x, y, z), half_y, half in leg]


def _mirrored(rings: Sequence[Ring], side: float) -> list[Ring]:
    return [((x, side * y, z), half_y, half) for (x, y, z), half_y, half in rings]


def _add_oval_tube(mesh: Mesh, rings: Sequence[Ring], v_range: Vec2, sides: int) -> None:
    """Add a tube of oval section through rings, closed at both ends; one axis of each section lies across the dog."""
    rows = []
    for k, (p, half_y, half) in enumerate(rings):
        a, b = rings[max(k - 1, 0)][0], rings[min(k + 1, len(rings) - 1)][0]
        d = unit(minus(b, a))
        across = unit((-d[0] * d[1], 1.0 - d[1] * d[1], -d[2] * d[1]))
        up = cross(d, across)
        v = mix(*v_range, k / (len(rings) - 1))
        row = []
        for i in range(sides + 1):  # the first and the last vertex coincide: the texture's edges
            angle = TURN_RAD * (i / sides - 0.25)
            c, s = half_y * det_cos(angle), half * det_sin(angle)
            at = (p[0] + c * across[0] + s * up[0], p[1] + c * across[1] + s * up[1], p[2] + c * across[2] + s * up[2])
            row.append(add_vertex(mesh, at, (i / sides, v)))
        rows.append(row)
    first = add_vertex(mesh, rings[0][0], (0.5, v_range[0]))
    last = add_vertex(mesh, rings[-1][0], (0.5, v_range[1]))
    add_indexed_grid(mesh, [[first] * (sides + 1), *rows, [last] * (sides + 1)])
