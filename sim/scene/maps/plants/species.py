"""Species of plants: shape and colour of their leaves by season, bark, and the habit of their branches.

Colours are sRGB, the mean of a leaf's upper side; leaves are darker and less saturated than they seem (green albedo of
0.05 to 0.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sim.scene.maps.season import Season
from sim.scene.maps.texture_tools import Rgb

LeafShape = Literal["heart", "lobed", "ovate", "palmate", "oval", "needle", "tuft"]


@dataclass(frozen=True)
class Leaves:
    """Leaves of a season, of one colour or, leaf by leaf, between two."""

    rgb: Rgb
    other_rgb: Rgb
    share: float = 1.0  # of the leaves of summer that are on the tree


@dataclass(frozen=True)
class Species:
    name: str
    shape: LeafShape
    leaf_px: float  # length of a leaf on a tile of 256 pixels, which is about 1.5 m wide (of bushes 0.6 m)
    spring: Leaves
    summer: Leaves
    autumn: Leaves
    bark_rgb: Rgb
    twig_rgb: Rgb
    droop: float = 0.0  # of the branches
    evergreen: bool = False

    def leaves(self, season: Season) -> Leaves | None:
        """Return the leaves of a season; None for bare twigs."""
        if season == "winter" and not self.evergreen:
            return None
        return self.summer if season == "winter" or (self.evergreen and season != "spring") else getattr(self, season)


_ALL = (
    Species(
        "linden", "heart", 25.0,
        spring=Leaves((0.42, 0.50, 0.21), (0.36, 0.46, 0.19), 0.85),
        summer=Leaves((0.37, 0.45, 0.22), (0.30, 0.39, 0.19)),
        autumn=Leaves((0.68, 0.55, 0.16), (0.46, 0.47, 0.17), 0.85),
        bark_rgb=(0.92, 0.98, 1.0), twig_rgb=(0.27, 0.21, 0.17),
    ),
    Species(
        "oak", "lobed", 30.0,
        spring=Leaves((0.40, 0.44, 0.19), (0.36, 0.40, 0.18), 0.85),
        summer=Leaves((0.32, 0.39, 0.19), (0.27, 0.35, 0.18)),
        autumn=Leaves((0.48, 0.32, 0.15), (0.40, 0.36, 0.16), 0.9),
        bark_rgb=(0.82, 0.86, 0.88), twig_rgb=(0.26, 0.22, 0.18),
    ),
    Species(
        "birch", "ovate", 20.0,
        spring=Leaves((0.45, 0.53, 0.23), (0.40, 0.49, 0.22), 0.8),
        summer=Leaves((0.45, 0.52, 0.26), (0.37, 0.45, 0.22), 0.85),
        autumn=Leaves((0.76, 0.62, 0.18), (0.62, 0.55, 0.20), 0.7),
        bark_rgb=(1.0, 1.0, 1.0), twig_rgb=(0.24, 0.17, 0.15), droop=0.25,
    ),
    Species(
        "maple", "palmate", 33.0,
        spring=Leaves((0.46, 0.50, 0.20), (0.42, 0.46, 0.20), 0.85),
        summer=Leaves((0.39, 0.46, 0.21), (0.32, 0.40, 0.19)),
        autumn=Leaves((0.72, 0.38, 0.12), (0.68, 0.52, 0.16), 0.85),
        bark_rgb=(0.86, 0.91, 0.94), twig_rgb=(0.27, 0.22, 0.19),
    ),
    Species(
        "fir", "needle", 11.0,
        spring=Leaves((0.27, 0.36, 0.22), (0.35, 0.44, 0.26)),
        summer=Leaves((0.27, 0.35, 0.25), (0.34, 0.42, 0.30)),
        autumn=Leaves((0.22, 0.30, 0.21), (0.27, 0.35, 0.24)),
        bark_rgb=(0.84, 0.80, 0.76), twig_rgb=(0.22, 0.16, 0.11), evergreen=True,
    ),
    Species(
        "pine", "tuft", 34.0,
        spring=Leaves((0.27, 0.36, 0.22), (0.34, 0.42, 0.25)),
        summer=Leaves((0.22, 0.29, 0.19), (0.28, 0.35, 0.22)),
        autumn=Leaves((0.22, 0.30, 0.20), (0.27, 0.34, 0.22)),
        bark_rgb=(0.92, 0.74, 0.62), twig_rgb=(0.32, 0.22, 0.15), evergreen=True,
    ),
    Species(
        "shrub", "oval", 22.0,
        spring=Leaves((0.42, 0.50, 0.22), (0.34, 0.44, 0.19), 0.9),
        summer=Leaves((0.34, 0.43, 0.20), (0.28, 0.37, 0.18)),
        autumn=Leaves((0.52, 0.34, 0.15), (0.37, 0.38, 0.17), 0.9),
        bark_rgb=(0.70, 0.66, 0.60), twig_rgb=(0.28, 0.22, 0.17),
    ),
    Species(  # hornbeam: keeps its dry leaves over the winter
        "hedge", "oval", 22.0,
        spring=Leaves((0.38, 0.47, 0.20), (0.32, 0.42, 0.18)),
        summer=Leaves((0.33, 0.42, 0.20), (0.27, 0.36, 0.17)),
        autumn=Leaves((0.50, 0.40, 0.17), (0.36, 0.36, 0.16)),
        bark_rgb=(0.70, 0.66, 0.60), twig_rgb=(0.28, 0.22, 0.17),
    ),
)  # fmt: skip
SPECIES = {species.name: species for species in _ALL}
