"""Random appearance of a scene: the seed, and the limits of surface colours, of added people and objects.

All depend on the scene's geometry, so a scene carries only the seed and the limits. `load_world`
(sim/world_loader.py) adds people and objects; a `World` computes the surfaces' colours when they are first needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from signals.documents.validate import StrictModel
from sim.scene.limits import Limits, Share, ordered, within


class TextureLimits(StrictModel):
    """Limits of surface colours; each MJCF material, and each object without one, has random values of its own."""

    hue_deg: Annotated[Limits, within(-180.0, 180.0)] = (-20.0, 20.0)  # skin keeps its hue
    brightness: Annotated[Limits, within(0.1, 4.0)] = (0.75, 1.25)
    contrast: Annotated[Limits, within(0.0, 4.0)] = (0.6, 1.4)
    scale: Annotated[Limits, within(0.1, 10.0)] = (0.7, 1.5)  # size of the pattern
    shift: bool = True  # random offset of the pattern


class PeopleLimits(StrictModel):
    """People besides those of the map, on free and level ground."""

    count: Annotated[tuple[int, int], AfterValidator(ordered), within(0, 60)] = (0, 12)
    within_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0  # distance from the origin, east and north
    clear_m: Annotated[float, Field(ge=4.0, le=1000.0)] = 6.0  # radius without people about the origin
    walking_share: Share = 0.7  # the others stand
    speed_mps: Annotated[Limits, within(0.3, 2.5)] = (0.7, 1.8)
    height_m: Annotated[Limits, within(0.9, 2.2)] = (1.5, 1.95)


ObjectKind = Literal[
    "backpack", "bicycle", "bird", "bus", "dog", "estate", "hatchback", "lorry", "motorcycle", "parasol",
    "potted_plant", "sedan", "suv", "van",
]  # fmt: skip
OBJECT_KINDS: tuple[ObjectKind, ...] = get_args(ObjectKind)


class ObjectLimits(StrictModel):
    """Still objects besides those of the map, on free and level ground."""

    count: Annotated[tuple[int, int], AfterValidator(ordered), within(0, 60)] = (0, 12)
    within_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0  # distance from the origin, east and north
    clear_m: Annotated[float, Field(ge=4.0, le=1000.0)] = 6.0  # radius without objects about the origin
    kinds: Annotated[tuple[ObjectKind, ...], Field(min_length=1)] = OBJECT_KINDS  # each drawn as often as it is named


@dataclass(frozen=True)
class Appearance:
    """Seed and limits of a scene's surfaces, added people and added objects; None: as the map has them."""

    seed: int
    textures: TextureLimits | None
    people: PeopleLimits | None
    objects: ObjectLimits | None = None

    @property
    def adds(self) -> bool:
        """True if anything may be added to the map."""
        return self.people is not None or self.objects is not None
