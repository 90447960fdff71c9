"""A person whom randomisation adds to a world: clothes, position and path."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from signals.samples import Vec3

PERSON = "random_person_"  # prefix of the names of added people and of their materials


@dataclass(frozen=True)
class Oblong:
    """Oblong that a person walks round."""

    corner_m: tuple[float, float]
    heading_rad: float
    length_m: float
    width_m: float
    start_lap: float


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
