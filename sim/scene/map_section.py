"""Section `map` of a scene: a generator with its parameters, or a file: MJCF, glTF, OpenStreetMap or GeoTIFF."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import pydantic
from pydantic import Discriminator, Field, Tag

from signals.documents.validate import ChosenByFunction, StrictModel
from sim.scene.scene_map import Surface

MAX_SEED = 2**63 - 1
Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]
ClassName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)]
Metres = Annotated[float, Field(ge=-1.0e5, le=1.0e5)]
Glob = Annotated[str, Field(min_length=1, max_length=200)]


class SurfaceValues(StrictModel):
    """Surface given by its values."""

    lidar_reflectivity: Annotated[float, Field(ge=0.0, le=1.0)]
    relative_permittivity: Annotated[float, Field(ge=1.0, le=1000.0)]
    conductivity_s_per_m: Annotated[float, Field(ge=0.0, le=1e9)]
    roughness_m: Annotated[float, Field(ge=0.0, le=1.0)]
    retroreflection: Annotated[float, Field(ge=0.0, le=2000.0)] = 0.0

    @property
    def surface(self) -> Surface:
        return Surface(**self.model_dump())


class GeneratedMap(StrictModel):
    """Map made by a generator of `sim.scene.maps.catalog`. The other keys are the generator's parameters."""

    model_config = pydantic.ConfigDict(extra="allow")

    generator: str
    seed: Seed = 1

    @property
    def parameters(self) -> dict[str, Any]:
        return dict(self.__pydantic_extra__ or {})


def _surface_form(surface: Any) -> str:
    return "in numbers" if isinstance(surface, dict | SurfaceValues) else "by name"


SurfaceChoice = Annotated[
    Annotated[str, Tag("by name")] | Annotated[SurfaceValues, Tag("in numbers")],
    Discriminator(_surface_form),
    ChosenByFunction(),
]


class _FileMap(StrictModel):
    """Map from a file, named by a key of the kind. Keys of other kinds are declared only to be refused: excluded."""

    @pydantic.model_validator(mode="after")
    def _one_source(self) -> Self:
        own = next(key for key, kind in _FILES.items() if isinstance(self, kind))
        for key, declared in type(self).model_fields.items():
            if declared.exclude and getattr(self, key) is not None:
                raise ValueError(f"holds both {own} and {key}: a map is one file or comes from a generator")
        return self


class MjcfMap(_FileMap):
    """The user's own map: any MJCF file, with the classes and surfaces of its parts."""

    mjcf: Annotated[str, Field(min_length=1)]  # path, relative to the scene's file
    ground: bool = False  # add the plane z = 0
    classes: dict[str, tuple[Glob, ...]] = Field(default_factory=dict)  # class -> glob patterns of names
    new_classes: tuple[ClassName, ...] = ()  # classes beyond those of sim.scene.classes
    # MJCF material -> a name of sim.scene.surfaces, or values
    surfaces: dict[str, SurfaceChoice] = Field(default_factory=dict)

    generator: Any = Field(default=None, exclude=True)
    seed: Any = Field(default=None, exclude=True)


class GltfMap(_FileMap):
    """A place from a glTF file (.glb, .gltf), with the classes and surfaces of its parts."""

    gltf: Annotated[str, Field(min_length=1)]  # path, relative to the scene's file
    scale: Annotated[float, Field(gt=0.0, le=1.0e6)] = 1.0  # metres per unit of the file
    yaw_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0  # counter-clockwise, seen from above
    # The take-off place, in metres east, north and up in the scaled and turned file.
    origin_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
    ground: bool | None = None  # add the plane z = 0; null: if the file has none round the take-off place
    contact_error_m: Annotated[float, Field(ge=0.05, le=2.0)] = 0.2  # how far solid things may reach beyond seen ones
    classes: dict[str, tuple[Glob, ...]] = Field(default_factory=dict)  # patterns of node, mesh and material names
    new_classes: tuple[ClassName, ...] = ()
    surfaces: dict[str, SurfaceChoice] = Field(default_factory=dict)  # patterns of material names

    generator: Any = Field(default=None, exclude=True)
    seed: Any = Field(default=None, exclude=True)
    mjcf: Any = Field(default=None, exclude=True)


class OsmObjects(StrictModel):
    """Parked cars, people, road details and denser or thinner woods of an OpenStreetMap district."""

    seed: Seed = 1
    density: Annotated[float, Field(gt=0.0, le=4.0)] = 1.0  # of cars, people and woods: 1 as in a usual town
    max_cars: Annotated[int, Field(ge=0, le=2000)] = 300  # the nearest to the take-off place are kept
    max_people: Annotated[int, Field(ge=0, le=200)] = 40


class OsmMap(_FileMap):
    """A district from an OpenStreetMap extract, round the scene's site."""

    osm: Annotated[str, Field(min_length=1)]  # path, relative to the scene's file
    elevation: str | None = None  # GeoTIFF of the ground's heights; null: level ground
    radius_m: Annotated[float, Field(ge=20.0, le=3000.0)] = 500.0  # half the edge of the square that is built
    seed: Seed = 1  # of facades, trees and what else the extract does not state
    ground: Literal["auto", "grass", "paving", "gravel", "soil", "asphalt", "sand"] = "auto"
    max_trees: Annotated[int, Field(ge=0, le=5000)] = 1500
    objects: OsmObjects | None = None  # null: none of them
    classes: dict[str, tuple[Glob, ...]] = Field(default_factory=dict)  # patterns of "key=value"
    new_classes: tuple[ClassName, ...] = ()

    generator: Any = Field(default=None, exclude=True)
    mjcf: Any = Field(default=None, exclude=True)
    gltf: Any = Field(default=None, exclude=True)

    surfaces: ClassVar[Mapping[str, SurfaceChoice]] = {}


class ElevationMap(_FileMap):
    """Bare ground with the heights of a GeoTIFF (a DEM), round the scene's site."""

    elevation: Annotated[str, Field(min_length=1)]  # path, relative to the scene's file
    radius_m: Annotated[float, Field(ge=20.0, le=3000.0)] = 500.0  # half the edge of the square that is built
    ground: Literal["grass", "paving", "gravel", "soil", "asphalt", "sand"] = "grass"

    generator: Any = Field(default=None, exclude=True)
    mjcf: Any = Field(default=None, exclude=True)
    gltf: Any = Field(default=None, exclude=True)

    classes: ClassVar[Mapping[str, tuple[Glob, ...]]] = {}
    new_classes: ClassVar[tuple[ClassName, ...]] = ()
    surfaces: ClassVar[Mapping[str, SurfaceChoice]] = {}


def _map_source(section: Any) -> str:
    for key, kind in _FILES.items():
        if key in section if isinstance(section, dict) else isinstance(section, kind):
            return f"from {key}"
    return "from a generator"


# The last key is one of an OpenStreetMap section too.
_FILES: dict[str, type[StrictModel]] = {"mjcf": MjcfMap, "gltf": GltfMap, "osm": OsmMap, "elevation": ElevationMap}
MapSection = Annotated[
    Annotated[GeneratedMap, Tag("from a generator")]
    | Annotated[MjcfMap, Tag("from mjcf")]
    | Annotated[GltfMap, Tag("from gltf")]
    | Annotated[OsmMap, Tag("from osm")]
    | Annotated[ElevationMap, Tag("from elevation")],
    Discriminator(_map_source),
    ChosenByFunction(),
]
