"""Checks of a search for objects against the scene: it must have some."""

from __future__ import annotations

import numpy as np

from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from signals.documents.validate import at, nearest
from signals.errors import Problem
from sim.scene.scene import Scene
from sim.world_loader import load_world


def search_problems(config: BenchConfig, scene: Scene, settings: Settings) -> list[Problem]:
    """Report a label of which the scene has no object, before a flight that could find none."""
    if config.search is None:
        return []
    world, label = load_world(scene), config.search.label
    classes, objects = list(world.class_names), np.asarray(world.geom_class)[np.asarray(world.geom_instance) > 0]
    there = [classes[number] for number in np.unique(objects)]
    if label in there:
        return []
    message = f"is {label!r}, of which the scene {scene.name!r} has no object: nothing could be found"
    return [at(settings, ("search", "label"), message, nearest(label, there))]
