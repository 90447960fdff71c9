"""Section `randomize` of a bench file: the features that a seed changes at random, and their limits.

A feature is `true` (the default limits in this file), `false` or `null` (as the scene has it), or a mapping of limits:

    randomize: {seed: 7, light: true, haze: {visibility_m: [200, 2000]}, people: {count: [5, 5]}}

Every feature, surface, person and sensor has its own random generator. So switching a feature, changing its limits, or
adding an object never changes the random values of the others.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from signals.documents.validate import StrictModel, read_by
from sim.scene.appearance import ObjectLimits, PeopleLimits, TextureLimits
from sim.scene.limits import Limits, Share, within


class _Switch:
    """Annotation that accepts limits, `true` for the model's defaults, or `false` for none.

    It is a tagged union because a validator before the field's own would hide from pydantic that the data are JSON.
    """

    def __init__(self, model: type[StrictModel]) -> None:
        self._model = model

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        chosen = core_schema.no_info_after_validator_function(
            lambda on: self._model() if on else None, core_schema.bool_schema(strict=True)
        )
        limits = handler(source)
        choices = {"limits": limits, "switch": chosen}
        return read_by(core_schema.tagged_union_schema(choices, discriminator=_choice), limits)


def _choice(value: Any) -> str:
    return "limits" if value is None or isinstance(value, dict | StrictModel) else "switch"


class LightLimits(StrictModel):
    """Limits of sun and sky; see sim/randomize/light.py."""

    sun_azimuth_deg: Annotated[Limits, within(-360.0, 360.0)] = (0.0, 360.0)
    sun_elevation_deg: Annotated[Limits, within(2.0, 90.0)] = (15.0, 75.0)
    brightness: Annotated[Limits, within(0.05, 4.0)] = (0.65, 1.25)  # light on level ground; 1: a clear mid-morning
    colour_temperature_k: Annotated[Limits, within(2000.0, 12_000.0)] = (4000.0, 7000.0)  # of the sun; 6500: white
    # Share of the light that comes from the sky; 1: overcast.
    ambient_share: Annotated[Limits, within(0.05, 1.0)] = (0.25, 0.8)


class HazeLimits(StrictModel):
    """Limits of the visibility, whose logarithm is uniformly distributed."""

    clear_share: Share = 0.4  # share of seeds without haze
    visibility_m: Annotated[Limits, within(10.0, 1e6)] = (400.0, 20_000.0)


class NoiseLimits(StrictModel):
    """Limits of a factor on the errors of each sensor; its logarithm is uniform. Null: errors as configured."""

    camera: Annotated[Limits, within(0.01, 100.0)] | None = (0.5, 2.0)
    lidar: Annotated[Limits, within(0.01, 100.0)] | None = (0.5, 2.0)
    imu: Annotated[Limits, within(0.01, 100.0)] | None = (0.5, 2.0)
    gps: Annotated[Limits, within(0.01, 100.0)] | None = (0.5, 2.0)


FEATURES = ("light", "haze", "textures", "people", "objects", "noise")


class Randomize(StrictModel):
    """Settings of the section; every feature is off by default."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] | None = None  # null: the seed of the bench
    light: Annotated[LightLimits | None, _Switch(LightLimits)] = None
    haze: Annotated[HazeLimits | None, _Switch(HazeLimits)] = None
    textures: Annotated[TextureLimits | None, _Switch(TextureLimits)] = None
    people: Annotated[PeopleLimits | None, _Switch(PeopleLimits)] = None
    objects: Annotated[ObjectLimits | None, _Switch(ObjectLimits)] = None
    noise: Annotated[NoiseLimits | None, _Switch(NoiseLimits)] = None

    @property
    def on(self) -> bool:
        """True if any feature is on."""
        return any(getattr(self, feature) is not None for feature in FEATURES)

    @classmethod
    def everything(cls, seed: int) -> Randomize:
        """Return settings with every feature on, within its default limits."""
        return cls.model_validate({"seed": seed, **dict.fromkeys(FEATURES, True)})
