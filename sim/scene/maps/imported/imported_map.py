"""A map made from a file of another program."""

from __future__ import annotations

from dataclasses import dataclass

from sim.scene.scene_map import SceneMap


@dataclass(frozen=True)
class Walk:
    """A straight way on which somebody walks to and fro. `seed`, `name`: of the random generator of the person."""

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    ground_m: float
    seed: int
    name: str


@dataclass(frozen=True)
class ImportedMap:
    """The map, with the patterns of the user's section `map` that match nothing."""

    scene_map: SceneMap
    unmatched_classes: tuple[tuple[str, int], ...] = ()  # class, index of the pattern
    unmatched_surfaces: tuple[str, ...] = ()
    names: tuple[str, ...] = ()  # that patterns can match, for hints
    walks: tuple[Walk, ...] = ()
