"""Load the world of a scene: the compiled map, with the people that randomisation adds to it.

Compiling takes up to several seconds, so the last few worlds are cached.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from signals.errors import ConfigError
from sim.scene.appearance import PeopleLimits
from sim.scene.compile.world_compiler import compile_map, compile_source, map_source, read_only
from sim.scene.scene import Scene
from sim.scene.world import World

_MAX_CACHED = 6  # worlds
_worlds: OrderedDict[str, World] = OrderedDict()


def load_world(scene: Scene, *, map_seed: int | None = None) -> World:
    """Return the world of a scene, of its variant `map_seed` if given. Raises ConfigError."""
    if map_seed is not None:
        try:
            scene = scene.with_map_seed(map_seed)
        except ValueError as error:
            raise ConfigError([scene.file.problem(("map",), f"takes no seed: {error}")]) from None
    cached = scene.file.cache.get("world")
    if cached is not None and cached.scene == scene:
        return cached
    source = map_source(scene)
    key = source.key(scene)
    world = _cached(key, lambda: compile_source(scene, source))
    appearance = scene.appearance
    if appearance is not None and appearance.people is not None:
        base, limits, seed = world, appearance.people, appearance.seed
        key += f" {seed} {limits.model_dump_json()}"
        world = _cached(key, lambda: _with_people(base, limits, seed))
    if world.scene != scene:
        world = _worlds[key] = replace(world, scene=scene)
    scene.file.cache["world"] = world
    return world


def _cached(key: str, make: Callable[[], World]) -> World:
    if key not in _worlds:
        _worlds[key] = make()
        while len(_worlds) > _MAX_CACHED:
            _worlds.popitem(last=False)
    _worlds.move_to_end(key)
    return _worlds[key]


def _with_people(base: World, limits: PeopleLimits, seed: int) -> World:
    """Return the world with the people that a seed adds; everything in `base` keeps its numbers."""
    # Imported here because most worlds have no added people.
    from sim.randomize.free_ground import FreeGround
    from sim.randomize.people import draw_people, map_with

    people = draw_people(limits, seed, FreeGround(base))
    if not people:
        return base
    class_table = dict(zip(base.class_names, base.class_colours, strict=True))
    world = compile_map(base.scene, map_with(people, base.map), class_table)
    # The map's own patterns for classes may match the names of added people too.
    is_added = np.arange(world.model.ngeom) >= base.model.ngeom
    geom_class = np.where(is_added, base.class_names.index("person"), world.geom_class).astype(np.uint8)
    return replace(world, geom_class=read_only(geom_class), added_people=people)
