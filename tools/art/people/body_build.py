"""Proportions of bodies, and tubes through rows of cross-sections. For a body 1 m tall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from sim.scene.maps.figure import Figure
from tools.art.people.loft import Section, SmoothMesh, loft

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


def tube(
    rows: Sequence[Row],
    sides: int,
    *,
    girth: float = 1.0,
    square: float = 0.0,
    creases: Sequence[int] = (),
    caps: tuple[float, float] = (0.0, 0.0),
) -> SmoothMesh:
    """Loft through rows; v runs once over 0.3 of the body height."""
    sections = [
        Section(z, girth * front, girth * back, girth * half, middle[0] if middle else 0.0, square=square)
        for z, front, back, half, *middle in rows
    ]
    v = [s.z / 0.3 for s in sections]
    return loft(sections, sides, creases=creases, caps=caps, rows=v)


def row_at(rows: Sequence[Row], z: float) -> Row:
    """Return the row at height z, interpolated linearly."""
    for low, high in pairwise(rows):
        if z <= high[0]:
            t = max(0.0, (z - low[0]) / (high[0] - low[0]))
            return tuple(a + t * (b - a) for a, b in zip(low, high, strict=True))
    return rows[-1]
