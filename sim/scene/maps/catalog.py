"""Map generators that a scene file may name: each is one file of this folder with `Parameters` and `generate`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, NamedTuple

from signals.documents.validate import StrictModel
from sim.scene import maps
from sim.scene.scene_map import SceneMap


class Generator(NamedTuple):
    """Map generator. `generate(parameters, seed)` is a pure function of its arguments."""

    parameters: type[StrictModel]
    generate: Callable[[Any, int], SceneMap]


_MODULES = {info.name: import_module(f"{maps.__name__}.{info.name}") for info in iter_modules(maps.__path__)}
GENERATORS = {
    name: Generator(module.Parameters, module.generate)
    for name, module in _MODULES.items()
    if hasattr(module, "generate")
}
