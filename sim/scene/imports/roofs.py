"""Roofs over any footprint, as the lower envelope of planes: z = min_i (a_i x + b_i y + c_i).

The planes stand on the footprint's least rectangle, with u along the ridge and v across, half lengths l >= w. A roof of
planes is concave, so over a convex part of the footprint the building is the hull of its corners. Shapes as in
"Simple 3D Buildings" of the OpenStreetMap wiki.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Roof:
    """Planes (n, 3) of coefficients a, b, c; z [m] above the ground of the building."""

    planes: Float64
    low_m: float  # least height on the footprint's rectangle: the eaves

    def height(self, xy: Float64) -> Float64:
        """Return the height of the roof at points (n, 2)."""
        return self._all(xy).min(axis=1)

    def _all(self, xy: Float64) -> Float64:
        return xy @ self.planes[:, :2].T + self.planes[:, 2]

    def breaks(self, a: Float64, b: Float64) -> list[float]:
        """Return where, from 0 to 1 along the segment from a to b, the roof has a crease."""
        at_a, at_b = self._all(a[None])[0], self._all(b[None])[0]
        found = set()
        n = len(self.planes)
        for i in range(n):
            for j in range(i + 1, n):
                d0, d1 = at_a[i] - at_a[j], at_b[i] - at_b[j]
                if d0 * d1 < 0.0:
                    t = d0 / (d0 - d1)
                    value = at_a + t * (at_b - at_a)
                    if value[i] <= value.min() + 1e-6:
                        found.add(float(t))
        return sorted(t for t in found if 1e-6 < t < 1.0 - 1e-6)


def make_roof(shape: str, rectangle: Float64, eaves_m: float, rise_m: float, *, across: bool, slope: Float64) -> Roof:
    """Return a roof on a rectangle of four corners; `across`: ridge along the short side; `slope`: downhill."""
    centre = rectangle.mean(axis=0)
    u, v = rectangle[1] - rectangle[0], rectangle[2] - rectangle[1]
    if float(u @ u) < float(v @ v):
        u, v = v, u
    if across:
        u, v = v, u
    length, width = 0.5 * float(np.sqrt(u @ u)), 0.5 * float(np.sqrt(v @ v))
    u, v = u / (2.0 * length), v / (2.0 * width)
    top = eaves_m + rise_m

    def plane(direction: Float64, at: float, z: float, fall: float) -> tuple[float, float, float]:
        """z at distance `at` from the centre along `direction`, falling by `fall` metres a metre outwards."""
        a, b = -fall * direction
        return float(a), float(b), float(z + fall * at - a * centre[0] - b * centre[1])

    def pair(direction: Float64, at: float, z: float, fall: float) -> list[tuple[float, float, float]]:
        return [plane(direction, at, z, fall), plane(-direction, at, z, fall)]

    level = (0.0, 0.0, top)
    if shape == "gabled":
        planes = pair(v, width, eaves_m, rise_m / width)
    elif shape == "hipped":
        planes = pair(v, width, eaves_m, rise_m / width) + pair(u, length, eaves_m, rise_m / min(width, length))
    elif shape == "half-hipped":
        planes = pair(v, width, eaves_m, rise_m / width) + pair(u, length, eaves_m + 0.5 * rise_m, rise_m / width)
    elif shape == "pyramidal":
        planes = pair(v, width, eaves_m, rise_m / width) + pair(u, length, eaves_m, rise_m / length)
    elif shape == "skillion":
        reach = abs(float(slope @ u)) * length + abs(float(slope @ v)) * width
        planes = [plane(slope, reach, eaves_m, rise_m / (2.0 * reach))]
    elif shape == "gambrel":
        knee = eaves_m + 0.6 * rise_m
        planes = pair(v, width, eaves_m, 1.5 * rise_m / width) + pair(
            v, 0.6 * width, knee, 0.4 * rise_m / (0.6 * width)
        )
    elif shape == "mansard":
        steep = 2.0
        planes = [*pair(v, width, eaves_m, steep), *pair(u, length, eaves_m, steep), level]
    elif shape == "round":
        planes = []
        for share in (0.0, 0.35, 0.7, 0.92):
            z = eaves_m + rise_m * float(np.sqrt(1.0 - share * share))
            planes += pair(v, share * width, z, rise_m * share / (width * float(np.sqrt(1.0 - share * share))))
    elif shape in ("dome", "onion", "cone"):
        planes = []
        shares = (0.5,) if shape == "cone" else (0.35, 0.7, 0.92)
        for direction in (u, v, (u + v) * 0.7071067811865476, (u - v) * 0.7071067811865476):
            for share in shares:
                if shape == "cone":
                    planes += pair(direction, 0.0, top, rise_m / width)
                else:
                    root = float(np.sqrt(1.0 - share * share))
                    planes += pair(direction, share * width, eaves_m + rise_m * root, rise_m * share / (width * root))
        planes.append(level)
    else:
        return Roof(np.array([[0.0, 0.0, eaves_m]]), eaves_m)
    return Roof(np.array(planes), eaves_m)
