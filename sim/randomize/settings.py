"""The section `randomize` of a bench file: what is drawn anew for each seed, and within which limits.

Each feature is `true` (the limits below), `false` or `null` (as the scene has it), or a mapping of limits of one's own:

    randomize: {seed: 7, light: true, haze: {visibility_m: [200, 2000]}, people: {count: [5, 5]}}

Every feature draws from streams of its own name, so switching one on or off, or changing its limits, never changes what
another draws; no more does one surface, person or sensor more or less.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from hil.signals.documents.validate import StrictModel


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[1] < limits[0]:
        raise ValueError(f"must be [least, greatest], not [{limits[0]:g}, {limits[1]:g}]")
    return limits


def _within(low: float, high: float) -> AfterValidator:
    """Both limits within these bounds."""

    def checked(limits: tuple[float, float]) -> tuple[float, float]:
        if not low <= min(limits) <= max(limits) <= high:
            raise ValueError(f"must be within {low:g} and {high:g}, not [{limits[0]:g}, {limits[1]:g}]")
        return limits

    return AfterValidator(checked)


class _Switch:
    """Besides limits, `true` for the model's own and `false` for none. A plain validator before the field's own would
    take from strict JSON what tells its lists from others'."""

    def __init__(self, model: type[StrictModel]) -> None:
        self._model = model

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        chosen = core_schema.no_info_after_validator_function(
            lambda on: self._model() if on else None, core_schema.bool_schema(strict=True)
        )
        choices = {"limits": handler(source), "switch": chosen}
        return core_schema.tagged_union_schema(choices, discriminator=_how)


def _how(value: Any) -> str:
    return "limits" if value is None or isinstance(value, dict | StrictModel) else "switch"


Limits = Annotated[tuple[float, float], AfterValidator(_ordered)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class LightLimits(StrictModel):
    """One sun and one sky; see sim/randomize/light.py."""

    sun_azimuth_deg: Annotated[Limits, _within(-360.0, 360.0)] = (0.0, 360.0)
    sun_elevation_deg: Annotated[Limits, _within(2.0, 90.0)] = (15.0, 75.0)
    brightness: Annotated[Limits, _within(0.05, 4.0)] = (0.65, 1.25)  # of level ground; 1: a clear mid-morning
    colour_temperature_k: Annotated[Limits, _within(2000.0, 12_000.0)] = (4000.0, 7000.0)  # of the sun; 6500: white
    ambient_share: Annotated[Limits, _within(0.05, 1.0)] = (0.25, 0.8)  # of it, from the sky; 1: overcast


class HazeLimits(StrictModel):
    """Visibility, drawn evenly in its logarithm."""

    clear_share: Share = 0.4  # of all seeds have none
    visibility_m: Annotated[Limits, _within(10.0, 1e6)] = (400.0, 20_000.0)


class TextureLimits(StrictModel):
    """Every surface (MJCF material, or thing without one) on its own."""

    hue_deg: Annotated[Limits, _within(-180.0, 180.0)] = (-20.0, 20.0)  # skin keeps its own
    brightness: Annotated[Limits, _within(0.1, 4.0)] = (0.75, 1.25)
    contrast: Annotated[Limits, _within(0.0, 4.0)] = (0.6, 1.4)
    scale: Annotated[Limits, _within(0.1, 10.0)] = (0.7, 1.5)  # size of the pattern
    shift: bool = True  # begins anywhere


class PeopleLimits(StrictModel):
    """People besides those of the map, on free and level ground."""

    count: Annotated[tuple[int, int], AfterValidator(_ordered), _within(0, 60)] = (0, 12)
    within_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0  # of the origin, east and north
    clear_m: Annotated[float, Field(ge=4.0, le=1000.0)] = 6.0  # of the origin, where the vehicle takes off
    walking_share: Share = 0.7  # the others stand
    speed_mps: Annotated[Limits, _within(0.3, 2.5)] = (0.7, 1.8)
    height_m: Annotated[Limits, _within(0.9, 2.2)] = (1.5, 1.95)


class NoiseLimits(StrictModel):
    """Factors on the errors of each sensor of a kind, drawn evenly in their logarithm; null: as the bench says."""

    camera: Annotated[Limits, _within(0.01, 100.0)] | None = (0.5, 2.0)
    lidar: Annotated[Limits, _within(0.01, 100.0)] | None = (0.5, 2.0)
    imu: Annotated[Limits, _within(0.01, 100.0)] | None = (0.5, 2.0)
    gps: Annotated[Limits, _within(0.01, 100.0)] | None = (0.5, 2.0)


FEATURES = ("light", "haze", "textures", "people", "noise")


class Randomize(StrictModel):
    """Off unless a feature is switched on."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] | None = None  # null: the bench's own
    light: Annotated[LightLimits | None, _Switch(LightLimits)] = None
    haze: Annotated[HazeLimits | None, _Switch(HazeLimits)] = None
    textures: Annotated[TextureLimits | None, _Switch(TextureLimits)] = None
    people: Annotated[PeopleLimits | None, _Switch(PeopleLimits)] = None
    noise: Annotated[NoiseLimits | None, _Switch(NoiseLimits)] = None

    @property
    def on(self) -> bool:
        """Whether anything is drawn at all."""
        return any(getattr(self, feature) is not None for feature in FEATURES)

    @classmethod
    def everything(cls, seed: int) -> Randomize:
        """Every feature within its own limits."""
        return cls.model_validate({"seed": seed, **dict.fromkeys(FEATURES, True)})
