"""Load the world of a scene: the compiled map, with the people and objects that randomisation adds to it.

Compiling takes up to several seconds, so the last few worlds are cached.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

from signals.errors import ConfigError
from sim.scene.added_person import PERSON
from sim.scene.appearance import Appearance
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
    if appearance is not None and appearance.adds:
        base = world
        key += f" {appearance.seed}"
        for limits in (appearance.people, appearance.objects):
            key += f" {limits.model_dump_json() if limits is not None else None}"
        world = _cached(key, lambda: _with_additions(base, appearance))
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


def _with_additions(base: World, appearance: Appearance) -> World:
    """Return the world with the people and objects that a seed adds; everything in `base` keeps its numbers."""
    # Imported here because most worlds have nothing added.
    from sim.randomize import objects, people
    from sim.randomize.free_ground import FreeGround

    ground, seed = FreeGround(base), appearance.seed
    # People first: so added objects never move them.
    new_people = () if appearance.people is None else people.draw_people(appearance.people, seed, ground)
    new_objects = () if appearance.objects is None else objects.draw_objects(appearance.objects, seed, ground)
    if not new_people and not new_objects:
        return base
    class_table = dict(zip(base.class_names, base.class_colours, strict=True))
    extended = objects.map_with(new_objects, people.map_with(new_people, base.map))
    world = compile_map(base.scene, extended, class_table)
    # The map's own patterns for classes may match the names of what is added, too.
    class_of = {added.name: added.class_name for added in new_objects}
    geom_class = world.geom_class.copy()
    for geom in range(base.model.ngeom, world.model.ngeom):
        body = world.model.body(world.model.geom_bodyid[geom]).name
        geom_class[geom] = base.class_names.index("person" if body.startswith(PERSON) else class_of[body])
    return replace(world, geom_class=read_only(geom_class), added_people=new_people, added_objects=new_objects)
