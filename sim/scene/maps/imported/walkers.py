"""People who walk on an imported map. They are added in the bench's own process: an actor cannot leave one."""

from __future__ import annotations

from sim.scene.maps.imported.imported_map import Walk
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import PersonTraits, add_walker
from sim.scene.maps.walk_path import there_and_back
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

LANE_M = 0.6  # between the way there and the way back
_PREFIX = "walkers_"  # of materials and meshes


def with_walkers(base: SceneMap, walks: tuple[Walk, ...]) -> SceneMap:
    """Return the map with people who walk, at its end."""
    if not walks:
        return base
    builder = MapBuilder("walkers", assets=_PREFIX)
    for number, walk in enumerate(walks):
        rng = RandomGenerator(walk.seed, walk.name)
        path = there_and_back(walk.start_m, walk.end_m, rng.between(0.9, 1.5), lane_m=LANE_M, start_lap=rng.unit())
        add_walker(builder, rng, path, ground_m=walk.ground_m, traits=PersonTraits(name=f"person_walking_{number:02d}"))
    return builder.added_to(base)
