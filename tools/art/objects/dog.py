"""Mesh of a dog that stands: 0.58 m at the shoulder, 0.95 m long without its tail.

Trunk, neck, head, ears, legs and tail are tubes of oval section with texture coordinates. u runs round a tube, from the
belly (0) over the back (1/2) to the belly (1); v runs along it within the part's range of `dog_coat.RANGES`.
"""

from __future__ import annotations

from collections.abc import Sequence

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2
from sim.scene.maps.objects.dog_coat import RANGES
from tools.art.vehicles.lofts import add_ellipsoid, add_indexed_grid, add_tube, add_vertex, mix

Ring = tuple[Vec3, float, float]  # middle, half width across and half height (of a leg: half depth along the body)

# From the tail to the breast: a deep chest, and a belly that rises towards the thighs.
_TRUNK: tuple[Ring, ...] = (
    ((-0.425, 0.0, 0.505), 0.035, 0.040), ((-0.40, 0.0, 0.495), 0.078, 0.085), ((-0.33, 0.0, 0.488), 0.105, 0.112),
    ((-0.20, 0.0, 0.485), 0.102, 0.104), ((-0.06, 0.0, 0.470), 0.108, 0.115), ((0.08, 0.0, 0.450), 0.118, 0.142),
    ((0.20, 0.0, 0.442), 0.120, 0.162), ((0.29, 0.0, 0.470), 0.100, 0.135), ((0.345, 0.0, 0.500), 0.060, 0.080),
)  # fmt: skip
_NECK: tuple[Ring, ...] = (
    ((0.22, 0.0, 0.520), 0.085, 0.110), ((0.31, 0.0, 0.605), 0.072, 0.092), ((0.385, 0.0, 0.690), 0.062, 0.074),
)  # fmt: skip
# Skull, stop and muzzle.
_HEAD: tuple[Ring, ...] = (
    ((0.340, 0.0, 0.705), 0.030, 0.036), ((0.365, 0.0, 0.720), 0.066, 0.066), ((0.415, 0.0, 0.738), 0.079, 0.074),
    ((0.468, 0.0, 0.732), 0.068, 0.062), ((0.500, 0.0, 0.712), 0.046, 0.046), ((0.555, 0.0, 0.698), 0.040, 0.038),
    ((0.600, 0.0, 0.692), 0.035, 0.032), ((0.622, 0.0, 0.690), 0.018, 0.018),
)  # fmt: skip
_TAIL: tuple[Ring, ...] = (
    ((-0.40, 0.0, 0.525), 0.032, 0.034), ((-0.49, 0.0, 0.560), 0.034, 0.044), ((-0.59, 0.0, 0.640), 0.034, 0.050),
    ((-0.665, 0.0, 0.735), 0.024, 0.036), ((-0.70, 0.0, 0.800), 0.007, 0.008),
)  # fmt: skip
# Of the left side. Shoulder, elbow, forearm, wrist, pastern; thigh, stifle, shank, hock, pastern.
_EAR: tuple[Ring, ...] = (
    ((0.395, 0.055, 0.792), 0.012, 0.026), ((0.402, 0.092, 0.765), 0.013, 0.046), ((0.412, 0.104, 0.705), 0.012, 0.046),
    ((0.425, 0.100, 0.645), 0.007, 0.020),
)  # fmt: skip
_FRONT_LEG: tuple[Ring, ...] = (
    ((0.190, 0.078, 0.470), 0.050, 0.090), ((0.182, 0.088, 0.350), 0.046, 0.070), ((0.166, 0.092, 0.280), 0.036, 0.046),
    ((0.186, 0.092, 0.170), 0.028, 0.032), ((0.192, 0.092, 0.095), 0.028, 0.030), ((0.200, 0.092, 0.040), 0.025, 0.026),
)  # fmt: skip
_REAR_LEG: tuple[Ring, ...] = (
    ((-0.31, 0.068, 0.49), 0.055, 0.115), ((-0.292, 0.09, 0.38), 0.058, 0.110), ((-0.272, 0.098, 0.285), 0.046, 0.074),
    ((-0.325, 0.10, 0.21), 0.031, 0.042), ((-0.392, 0.10, 0.16), 0.025, 0.031), ((-0.390, 0.10, 0.09), 0.023, 0.026),
    ((-0.378, 0.10, 0.04), 0.025, 0.026),
)  # fmt: skip
_PAW: tuple[Ring, ...] = (  # about the middle of a leg's last ring, on the ground
    ((-0.032, 0.0, 0.026), 0.020, 0.018), ((0.0, 0.0, 0.030), 0.034, 0.030), ((0.045, 0.0, 0.025), 0.034, 0.024),
    ((0.072, 0.0, 0.014), 0.018, 0.010),
)  # fmt: skip


def dog() -> dict[str, Mesh]:
    """Return the meshes of fur, of nose and eyes, and of the collar."""
    fur, dark, collar = Mesh.empty(), Mesh.empty(), Mesh.empty()
    _add_oval_tube(fur, _TRUNK, RANGES["trunk"], 14)
    _add_oval_tube(fur, _NECK, RANGES["neck"], 12)
    _add_oval_tube(fur, _HEAD, RANGES["head"], 12)
    _add_oval_tube(fur, _TAIL, RANGES["tail"], 8)
    for side in (1.0, -1.0):
        _add_oval_tube(fur, _mirrored(_EAR, side), RANGES["ear"], 6)
        for leg in (_FRONT_LEG, _REAR_LEG):
            _add_oval_tube(fur, _mirrored(leg, side), RANGES["leg"], 8)
            (x, y, _), _, _ = leg[-1]
            paw = [((x + px, side * y, pz), half_y, half_z) for (px, _, pz), half_y, half_z in _PAW]
            _add_oval_tube(fur, paw, RANGES["paw"], 8)
        add_ellipsoid(dark, (0.492, side * 0.040, 0.752), (0.011, 0.011, 0.011), rings=4, sides=6)
    add_ellipsoid(dark, (0.628, 0.0, 0.704), (0.017, 0.022, 0.016), rings=4, sides=8)
    add_tube(dark, [(0.545, 0.0, 0.664), (0.612, 0.0, 0.668)], (0.020, 0.018), 6)  # lips
    add_tube(collar, [(0.308, 0.0, 0.612), (0.330, 0.0, 0.634)], 0.094, 12)
    return {"fur": fur, "dark": dark, "collar": collar}


def _mirrored(rings: Sequence[Ring], side: float) -> list[Ring]:
    return [((x, side * y, z), half_y, half) for (x, y, z), half_y, half in rings]


def _add_oval_tube(mesh: Mesh, rings: Sequence[Ring], v_range: Vec2, sides: int) -> None:
    """Add a tube of oval section through rings, closed at both ends; one axis of each section lies across the dog."""
    rows = []
    for k, (p, half_y, half) in enumerate(rings):
        a, b = rings[max(k - 1, 0)][0], rings[min(k + 1, len(rings) - 1)][0]
        d = unit((b[0] - a[0], b[1] - a[1], b[2] - a[2]))
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
