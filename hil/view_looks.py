"""How `hil view` shows a scene: quality, weather and randomisation, by the keys that a bench file has for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hil.config.layers import Settings, lay_settings
from hil.config.schema import BenchConfig
from hil.signals.documents.document import Document
from hil.signals.documents.validate import Section, validate
from hil.signals.errors import ConfigError
from sim.frame.quality import QualityName, with_quality
from sim.randomize.looks import in_weather, randomized
from sim.randomize.settings import FEATURES, Randomize
from sim.scene.scene import Scene
from sim.scene.weather import Weather

# A picture of `hil view` that names no quality.
_PLAIN: dict[str, Any] = {"supersample": 2, "shadows": True, "textures": True}


class ViewLooks(Section):
    """Keys of a bench file that change how a scene looks."""

    quality: QualityName | None = None
    weather: Weather | None = None
    randomize: Randomize = Randomize()

    def of(self, scene: Scene) -> Scene:
        """The scene in this weather, as the seed makes it look; a bench's seed, where none is given."""
        seed: int = BenchConfig.model_fields["seed"].default
        return randomized(in_weather(scene, self.weather), self.randomize, seed)

    def variant(self, number: int) -> ViewLooks:
        """With the seed that comes so many after its own, and every feature on where none is."""
        seed = (self.randomize.seed or 0) + number
        chosen = self.randomize if self.randomize.on else Randomize.model_validate(dict.fromkeys(FEATURES, True))
        return self.model_copy(update={"randomize": chosen.model_copy(update={"seed": seed})})

    def drawing(self, size: tuple[int, int], *, said: bool) -> tuple[tuple[int, int], dict[str, Any]]:
        """Pixels of the pictures, and what their renderer is told. `said`: the pixels are not to be changed."""
        if self.quality is None:
            return size, dict(_PLAIN)
        values = with_quality({"resolution": size}, self.quality, said=("resolution",) if said else ())
        width, height = values["resolution"]
        return (width, height), {key: values[key] for key in _PLAIN}


def read_looks(settings: Sequence[str]) -> ViewLooks:
    """From the texts of `--set`. Raises ConfigError with every problem."""
    laid = Settings()
    laid.lay(Document("defaults", {}))
    problems = lay_settings(laid, settings)
    looks, wrong = validate(ViewLooks, laid.data, laid)
    if problems or wrong or looks is None:
        raise ConfigError([*problems, *wrong])
    return looks
