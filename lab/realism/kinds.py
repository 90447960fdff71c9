"""Kinds of objects that the networks are asked for, and the labels under which each network knows them.

A further kind is one line of `KINDS`. An object of a scene belongs to the first kind whose prefix begins its name
(`bus_003`), else to the first kind of its class. Boxes of one group count for all objects of the group: a bus that is
called a car is found, and the share found under a label of the kind's own is stated separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.scene.world import World


@dataclass(frozen=True)
class Kind:
    """Kind of object: `labels` of Open Images under which it is known, lower case."""

    name: str
    group: str
    labels: tuple[str, ...]
    prefixes: tuple[str, ...]  # of objects' names, without the "_" that follows
    classes: tuple[str, ...] = ()


KINDS = (
    Kind("bus", "vehicle", ("vehicle",), ("bus",)),
    Kind("truck", "vehicle", ("vehicle",), ("truck", "lorry")),
    Kind("bicycle", "bicycle", ("bicycle",), ("bicycle", "bike")),
    Kind("vehicle", "vehicle", ("car", "vehicle"), ("car", "van", "vehicle"), ("vehicle",)),
    Kind("person", "person", ("person",), ("person",), ("person",)),
    Kind("dog", "dog", ("dog",), ("dog",)),
)
BY_NAME = {kind.name: kind for kind in KINDS}
MAIN = ("person", "vehicle")  # kinds with checks


def group_labels(group: str) -> frozenset[str]:
    """Return the labels that count as found for a group."""
    return frozenset(label for kind in KINDS if kind.group == group for label in kind.labels)


def kind_of(name: str, class_name: str) -> Kind | None:
    """Return the kind of an object by its name and class, None if the networks are not asked for it."""
    for kind in KINDS:
        if any(name == prefix or name.startswith(f"{prefix}_") for prefix in kind.prefixes):
            return kind
    return next((kind for kind in KINDS if class_name in kind.classes), None)


def objects_of(world: World) -> dict[int, Kind]:
    """Return the kind of each instance that has one. An instance has the class of most of its visible geoms."""
    kinds: dict[int, Kind] = {}
    for instance in np.unique(world.geom_instance[world.geom_visible]).tolist():
        if instance:
            ids = world.geom_class[(world.geom_instance == instance) & world.geom_visible]
            kind = kind_of(world.instance_names[instance], world.class_names[int(np.bincount(ids).argmax())])
            if kind is not None:
                kinds[instance] = kind
    return kinds
