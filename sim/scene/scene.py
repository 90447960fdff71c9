"""A scene: its place on Earth, map, light and weather.

The world frame W is ENU with its origin on the ground at the site, where the vehicle takes off. Without a `map` the
ground is the plane z = 0 with `boxes` on it; with one, the map holds the ground and everything on it, and boxes are
added to it. `sim.world_loader.load_world` makes the geometry.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr, field_validator, model_validator

from signals.documents.document import Document, shown_path
from signals.documents.validate import StrictModel, load_model
from signals.errors import ConfigError
from signals.units import STANDARD_GRAVITY_MPS2
from sim.scene.appearance import Appearance
from sim.scene.atmosphere import SEA_LEVEL_KGPM3, ZERO_DEGC_K, density_kgpm3, geopotential_m, temperature_k
from sim.scene.budget import Budget
from sim.scene.light import Light, time_of
from sim.scene.limited_process import limited
from sim.scene.map_section import ElevationMap, GeneratedMap, GltfMap, MapSection, MjcfMap, OsmMap
from sim.scene.runway import Runway
from sim.scene.scene_file import SceneFile
from sim.scene.sun_position import sun_position_deg
from sim.scene.view_point import ViewPoint
from sim.scene.weather import Weather

SCENE_DIR = Path(__file__).resolve().parents[2] / "rigs" / "scenes"

Coordinate = Annotated[float, Field(ge=-50_000.0, le=50_000.0)]
Extent = Annotated[float, Field(gt=0.0, le=10_000.0)]
WindSpeed = Annotated[float, Field(ge=-50.0, le=50.0)]


class Site(StrictModel):
    """Geodetic position of W's origin on WGS-84.

    The bench takes height above mean sea level and ellipsoidal height as equal: their difference (47 m at the default
    site) is a constant that no simulated sensor can show.
    """

    latitude_deg: Annotated[float, Field(ge=-89.9, le=89.9)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    altitude_m: Annotated[float, Field(ge=-500.0, le=9_000.0)]
    temperature_degc: Annotated[float, Field(ge=-60.0, le=60.0)] | None = None  # of the air there; null: standard

    @property
    def warmer_k(self) -> float:
        """Temperature of the air over that of the standard atmosphere, the same at every height."""
        if self.temperature_degc is None:
            return 0.0
        return self.temperature_degc + ZERO_DEGC_K - temperature_k(geopotential_m(self.altitude_m))

    @property
    def air_degc(self) -> float:
        """Temperature of the air at the site."""
        return temperature_k(geopotential_m(self.altitude_m)) + self.warmer_k - ZERO_DEGC_K

    @property
    def density_ratio(self) -> float:
        """Density of the air at the site over 1.225 kg/m3."""
        return density_kgpm3(self.altitude_m, self.warmer_k) / SEA_LEVEL_KGPM3


class Box(StrictModel):
    """Static, axis-aligned box: centre and full edge lengths in W [m]."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    center_m: tuple[Coordinate, Coordinate, Coordinate]
    size_m: tuple[Extent, Extent, Extent]


class Scene(StrictModel):
    """The world outside the vehicle."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    description: str
    site: Site
    ground_friction: Annotated[float, Field(gt=0.0, le=5.0)]
    gravity_mps2: Annotated[float, Field(ge=0.0, le=30.0)] = STANDARD_GRAVITY_MPS2
    view: tuple[ViewPoint, ...] = ()  # camera poses of `hil view`; empty: `hil view` chooses them
    wind_W_mps: tuple[WindSpeed, WindSpeed, WindSpeed] = (0.0, 0.0, 0.0)
    boxes: tuple[Box, ...] = ()
    runway: Runway | None = None  # its surface is part of the map, or bare ground
    map: MapSection | None = None
    light: Light = Light()
    weather: Weather = Weather()

    _file: SceneFile = PrivateAttr(default_factory=SceneFile)
    _appearance: Appearance | None = PrivateAttr(default=None)
    _original: Scene | None = PrivateAttr(default=None)

    @field_validator("boxes")
    @classmethod
    def _own_names(cls, boxes: tuple[Box, ...]) -> tuple[Box, ...]:
        names = Counter(box.name for box in boxes)
        if repeated := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"two boxes are called {repeated[0]!r}: give one of them another name")
        return boxes

    @model_validator(mode="after")
    def _sun_by_time_and_site(self) -> Scene:
        """Fill the direction of the sun in, if the light has a time."""
        if self.light.utc is None:
            return self
        site = self.site
        azimuth, elevation = sun_position_deg(time_of(self.light.utc), site.latitude_deg, site.longitude_deg)
        sun = {"sun_azimuth_deg": azimuth, "sun_elevation_deg": elevation}
        if any(getattr(self.light, key) != sun[key] for key in sun.keys() & self.light.model_fields_set):
            raise ValueError("light: utc gives the sun's direction: leave out sun_azimuth_deg and sun_elevation_deg")
        self.__dict__["light"] = self.light.model_copy(update=sun)  # the model is frozen from here on
        return self

    @property
    def extinction_per_m(self) -> float:
        """Extinction of visible light by haze, fog, rain and snow; 0 in clear air."""
        return self.light.fog_per_m + self.weather.extinction_per_m

    @property
    def haze_per_m(self) -> float:
        """Extinction of visible light by haze and fog alone."""
        return self.light.fog_per_m + self.weather.haze_per_m

    @property
    def file(self) -> SceneFile:
        """The file in which the scene was written."""
        return self._file

    @property
    def appearance(self) -> Appearance | None:
        """Appearance that a seed gives the scene; None unless it was randomised or put into other weather."""
        return self._appearance

    @property
    def original(self) -> Scene:
        """The scene as its file has it."""
        return self if self._original is None else self._original

    @property
    def is_bare(self) -> bool:
        """True if nothing stands on its flat ground."""
        return self.has_only_boxes and not self.boxes

    @property
    def has_only_boxes(self) -> bool:
        """True if the scene is the ground plane with boxes or without: no map, nothing added."""
        return self.map is None and not (self._appearance is not None and self._appearance.adds)

    def with_appearance(self, appearance: Appearance, original: Scene) -> Scene:
        """Return the scene with this appearance; `original`: the scene before any random change."""
        scene = self.model_copy()
        scene._appearance, scene._original = appearance, original
        return scene

    def from_file(self, file: SceneFile) -> Scene:
        """Return the scene with `file` as its file."""
        scene = self.model_copy()
        scene._file = file
        return scene

    def with_map_seed(self, seed: int) -> Scene:
        """Return the scene with the map of another seed. Raises ValueError if its map is not made from a seed."""
        if not isinstance(self.map, GeneratedMap):
            raise ValueError(f"the map of scene {self.name!r} is not made from a seed")
        return self.model_copy(update={"map": self.map.model_copy(update={"seed": seed})})


def scene_names() -> list[str]:
    """Return the names that `load_scene` accepts, sorted."""
    return sorted(path.stem for path in SCENE_DIR.glob("*.yaml"))


def load_scene(name_or_path: str | Path) -> Scene:
    """Load a scene of `rigs/scenes` by name, or a YAML or map file by path. Raises ConfigError."""
    path = Path(name_or_path)
    if is_map_file(path):
        return scene_of_map(path)
    path = path if path.suffix else SCENE_DIR / f"{path}.yaml"
    check_suffix(path)
    scene, document = load_model(path, Scene)
    return scene.from_file(SceneFile(path, document))


def is_map_file(path: Path) -> bool:
    """Return True if the suffix is that of a map: MJCF, glTF, OpenStreetMap or GeoTIFF."""
    return path.name.lower().endswith(tuple(_MAP_SUFFIXES))


def check_suffix(path: Path) -> None:
    """Raise ConfigError for a file that is no scene by its suffix, such as a mesh or a raster of another format."""
    suffix = path.suffix.lower()
    if suffix not in (".yaml", ".yml", ".json"):
        hint = f"known: .yaml, {', '.join(_MAP_SUFFIXES)}; {_CONVERT}"
        raise ConfigError.at(shown_path(path), f"is not a known kind of scene: {suffix or 'no suffix'}", hint)


def has_own_site(path: Path) -> bool:
    """Return True for a map's file that states its place on Earth: an OpenStreetMap extract or a GeoTIFF."""
    return any(path.name.lower().endswith(end) and kind in ("osm", "elevation") for end, kind in _MAP_SUFFIXES.items())


_CONVERT = "export a model as .glb, convert heights: gdal_translate IN OUT.tif, an extract: osmium cat IN -o OUT.osm"
_MAP_SUFFIXES = {
    ".xml": "mjcf", ".mjcf": "mjcf", ".glb": "gltf", ".gltf": "gltf", ".osm": "osm", ".osm.xml": "osm", ".pbf": "osm",
    ".tif": "elevation", ".tiff": "elevation",
}  # fmt: skip


def scene_of_map(path: Path) -> Scene:
    """Return a map's file as a scene, with the default site and friction, which such a file does not hold.

    The site of an OpenStreetMap extract is free ground close to its middle, that of a GeoTIFF its middle. Raises
    ConfigError if it cannot be read.
    """
    suffix = max((end for end in _MAP_SUFFIXES if path.name.lower().endswith(end)), key=len)
    kind = _MAP_SUFFIXES[suffix]
    name = re.sub(r"[^a-z0-9_]+", "_", path.name[: -len(suffix)].lower())
    site = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
    file = SceneFile(path, Document(shown_path(path), None))
    section: MapSection = MjcfMap(mjcf=path.name)
    if kind == "gltf":
        section = GltfMap(gltf=path.name)
    elif kind == "osm":
        section = OsmMap(osm=path.name)
        arguments = (path, section.radius_m, budget := Budget(file.document.source))
        place = limited(
            "sim.scene.maps.imported.osm_import:free_place", *arguments, budget=budget, what="finding its ground"
        )
        latitude_deg, longitude_deg = place
        site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=0.0)
    elif kind == "elevation":
        section = ElevationMap(elevation=path.name)
        budget = Budget(file.document.source)
        finder = "sim.scene.maps.imported.elevation_import:middle"
        latitude_deg, longitude_deg, altitude_m = limited(
            finder, path, budget, budget=budget, what="finding its middle"
        )
        site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m)
    return Scene(
        name=name if name[:1].isalpha() else f"map_{name}",
        description=f"Map {path.name}",
        site=site,
        ground_friction=0.8,
        map=section,
    ).from_file(file)
