"""A person whom randomisation adds to a world: clothes, position and path."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from sim.scene.maps.walk_path import WalkPath

PERSON = "random_person_"  # prefix of the names of added people and of their materials


@dataclass(frozen=True)
class Oblong:
    """Oblong that a person walks round."""

    corner_m: tuple[float, float]
    heading_rad: float
    length_m: float
    width_m: float
    start_lap: float

    def path(self, speed_mps: float) -> WalkPath:
        """Return the closed path round the oblong, in W."""
        c, s = det_cos(self.heading_rad), det_sin(self.heading_rad)
        x, y = self.corner_m
        corners = ((0.0, 0.0), (self.length_m, 0.0), (self.length_m, self.width_m), (0.0, self.width_m))
        vertices = [(x + c * a - s * b, y + s * a + c * b) for a, b in corners]
        return WalkPath(vertices, speed_mps, corner_m=min(1.5, 0.5 * self.width_m), start_lap=self.start_lap)


@dataclass(frozen=True)
class AddedPerson:
    """A person added to a map; colours are sRGB codes / 255."""

    name: str
    at_m: Vec3  # position in W; of a walker, at the start
    heading_deg: float  # from east to north, at the start
    height_m: float
    speed_mps: float  # 0: the person stands
    way: Oblong | None  # None: the person stands
    shirt_rgb: Vec3
    trousers_rgb: Vec3
    skin_rgb: Vec3
    hair_rgb: Vec3

    def as_data(self) -> dict[str, Any]:
        """Return the person as plain data for run.json."""
        return asdict(self)
