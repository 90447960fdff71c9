"""Appearance of a scene in `hil view`: quality, weather and randomisation, with the keys of a bench file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from hil.config.layers import Settings, merge_options
from hil.config.schema import BenchConfig
from signals.documents.document import Document
from signals.documents.validate import Section, validate
from signals.errors import ConfigError
from sim.frame.quality import QUALITIES, QualityName, with_quality
from sim.randomize.settings import FEATURES, Randomize
from sim.randomize.variant import in_weather, randomized
from sim.scene.scene import Scene
from sim.scene.weather import Weather

_DEFAULT_QUALITY: QualityName = "epic"


class ViewAppearance(Section):
    """The keys of a bench file that change the appearance of a scene."""

    quality: QualityName | None = None
    colour: Literal["native", "egl", "filament", "path_traced"] = "native"
    weather: Weather | None = None
    randomize: Randomize = Randomize()

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene in this weather, randomised with the given seed or else a bench's default seed."""
        seed: int = BenchConfig.model_fields["seed"].default
        return randomized(in_weather(scene, self.weather), self.randomize, seed)

    def variant(self, number: int) -> ViewAppearance:
        """Return a copy with the seed raised by `number`; if no feature is randomised, all of them are."""
        seed = (self.randomize.seed or 0) + number
        randomize = self.randomize if self.randomize.on else Randomize.model_validate(dict.fromkeys(FEATURES, True))
        return self.model_copy(update={"randomize": randomize.model_copy(update={"seed": seed})})

    def rendering(self, size: tuple[int, int], *, fixed_size: bool) -> tuple[tuple[int, int], dict[str, Any]]:
        """Return width and height [px] and the renderer's keyword arguments.

        The quality may change the size, unless `fixed_size`.
        """
        quality = self.quality or _DEFAULT_QUALITY
        given = ("resolution",) if fixed_size else ()
        values = with_quality({"resolution": size, "colour": self.colour, "supersample": 1}, quality, given)
        width, height = values["resolution"]
        options = {key: values[key] for key in ("supersample", "shadows")} | {"shading": QUALITIES[quality].shading}
        if self.colour != "native":
            options["colour"] = self.colour
        if self.colour == "path_traced":
            options["samples"] = values["samples"]
        return (width, height), options


def read_appearance(settings: Sequence[str]) -> ViewAppearance:
    """Read the appearance from `KEY=VALUE` texts of `--set`. Raises ConfigError with every problem."""
    layers = Settings()
    layers.merge(Document("defaults", {}))
    problems = merge_options(layers, settings)
    appearance, invalid = validate(ViewAppearance, layers.data, layers)
    if problems or invalid or appearance is None:
        raise ConfigError([*problems, *invalid])
    return appearance
