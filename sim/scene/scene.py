"""A scene: where on Earth it is, the ground, and the static boxes on it.

The world frame W is ENU with its origin on the ground at the site. The ground is the plane z = 0.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from sim.model_file import StrictModel, load_model

SCENE_DIR = Path(__file__).resolve().parents[2] / "rigs" / "scenes"

Coordinate = Annotated[float, Field(ge=-50_000.0, le=50_000.0)]
Extent = Annotated[float, Field(gt=0.0, le=10_000.0)]
WindSpeed = Annotated[float, Field(ge=-50.0, le=50.0)]


class Site(StrictModel):
    """Geodetic position of W's origin on WGS-84.

    The bench takes height above mean sea level and ellipsoidal height to be the same number: the geoid's
    undulation (47 m at the default site) is one constant that no sensor here could show.
    """

    latitude_deg: Annotated[float, Field(ge=-89.9, le=89.9)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    altitude_m: Annotated[float, Field(ge=-500.0, le=9_000.0)]


class Box(StrictModel):
    """A static, axis-aligned box: centre and full edge lengths in W [m]."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    center_m: tuple[Coordinate, Coordinate, Coordinate]
    size_m: tuple[Extent, Extent, Extent]


class Scene(StrictModel):
    """Everything outside the vehicle."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    description: str
    site: Site
    ground_friction: Annotated[float, Field(gt=0.0, le=5.0)]
    gravity_mps2: Annotated[float, Field(ge=0.0, le=30.0)] = 9.80665
    wind_W_mps: tuple[WindSpeed, WindSpeed, WindSpeed] = (0.0, 0.0, 0.0)
    boxes: tuple[Box, ...] = ()


def scene_names() -> list[str]:
    """Names that `load_scene` takes, sorted."""
    return sorted(path.stem for path in SCENE_DIR.glob("*.yaml"))


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene of `rigs/scenes` by name, or any file by path. Raises ConfigError."""
    path = Path(name_or_path)
    return load_model(path if path.suffix else SCENE_DIR / f"{path}.yaml", Scene)
