"""Section `map` of a scene: a generator with its parameters, or the user's own MJCF file."""

from __future__ import annotations

from typing import Annotated, Any

import pydantic
from pydantic import Discriminator, Field, Tag

from signals.documents.validate import StrictModel
from sim.scene.maps.scene_map import Surface

MAX_SEED = 2**63 - 1
Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]
ClassName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)]
Glob = Annotated[str, Field(min_length=1, max_length=200)]


class SurfaceValues(StrictModel):
    """Surface given by its values."""

    lidar_reflectivity: Annotated[float, Field(ge=0.0, le=1.0)]
    relative_permittivity: Annotated[float, Field(ge=1.0, le=1000.0)]
    conductivity_s_per_m: Annotated[float, Field(ge=0.0, le=1e9)]
    roughness_m: Annotated[float, Field(ge=0.0, le=1.0)]

    @property
    def surface(self) -> Surface:
        return Surface(self.lidar_reflectivity, self.relative_permittivity, self.conductivity_s_per_m, self.roughness_m)


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
    Annotated[str, Tag("by name")] | Annotated[SurfaceValues, Tag("in numbers")], Discriminator(_surface_form)
]


class MjcfMap(StrictModel):
    """The user's own map: any MJCF file, with the classes and surfaces of its parts."""

    mjcf: Annotated[str, Field(min_length=1)]  # path, relative to the scene's file
    ground: bool = False  # add the plane z = 0
    classes: dict[str, tuple[Glob, ...]] = Field(default_factory=dict)  # class -> glob patterns of names
    new_classes: tuple[ClassName, ...] = ()  # classes beyond those of sim.scene.classes
    # MJCF material -> a name of sim.scene.surfaces, or values
    surfaces: dict[str, SurfaceChoice] = Field(default_factory=dict)

    # Keys of a generated map, declared only so that they are rejected with a clear message.
    generator: Any = Field(default=None, exclude=True)
    seed: Any = Field(default=None, exclude=True)

    @pydantic.model_validator(mode="after")
    def _one_source(self) -> MjcfMap:
        for key in ("generator", "seed"):
            if getattr(self, key) is not None:
                raise ValueError(f"holds both mjcf and {key}: a map is a file or comes from a generator")
        return self


def _map_source(section: Any) -> str:
    mjcf = "mjcf" in section if isinstance(section, dict) else isinstance(section, MjcfMap)
    return "from a file" if mjcf else "from a generator"


MapSection = Annotated[
    Annotated[GeneratedMap, Tag("from a generator")] | Annotated[MjcfMap, Tag("from a file")],
    Discriminator(_map_source),
]
