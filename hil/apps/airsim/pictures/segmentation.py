"""Segmentation ids of the objects, and the colours that pictures show for them.

At the start the id of an object is 5 plus the sum of the letters of its name, modulo 256 (a = 97, upper case as lower
case, digits and underscores left out), so that Cone_1 and Cone_2 have the same id; names that begin with default_ have
the id 0. Source: InitializeObjectStencilID in AirSim's AirBlueprintLib.h. An id of -1 hides the object. For
Cosys-AirSim every object has an id of its own: its place in the list of all objects. An object of the scene that was
destroyed keeps its place there, as in Cosys-AirSim (GetAllComponentNames in ObjectAnnotator.cpp), so that no other
object gets another id.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.pictures.palette import AIRSIM_COLOURS, instance_colours
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.world.frames import Frames
from sim.frame.source import VEHICLE_CLASS

HIDDEN, NOT_FOUND = -1, -1
_MOST_ID, _MOST_INSTANCE = 255, 50_000


def initial_id(name: str) -> int:
    """Return the id that AirSim gives an object of this name at the start."""
    letters = name.lower()
    if letters.startswith("default_"):
        return 0
    return (5 + sum(code for code in letters.encode("utf-8", "replace") if code >= ord("a"))) % 256


class Segmentation:
    """Ids of all objects of one server."""

    def __init__(self, frames: Frames, random_ids: bool) -> None:
        self._frames, self._random = frames, random_ids
        self._generation = -1
        self._names: tuple[str, ...] = ()  # index: instance id of the renderer; [0]: no object
        self._given: dict[str, int] = {}
        self._ids: NDArray[np.int32] = np.zeros(1, np.int32)  # of each instance, 0 for hidden ones
        self._colours: dict[bool, NDArray[np.uint8]] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all instances of the world, destroyed ones too; [0] stands for no object."""
        frames = self._frames
        world = frames.seen_by().world
        if frames.generation != self._generation:
            self._generation = frames.generation
            prefix = f"{VEHICLE_CLASS}:"
            self._names = tuple(name.removeprefix(prefix) for name in world.instance_names)
            self._colours.clear()
            self._ids = np.array([0, *(max(self.id_of(name), 0) for name in self._names[1:])], np.int32)
        return self._names

    def id_of(self, name: str) -> int:
        """Return the id of an object that exists."""
        given = self._given.get(name)
        return given if given is not None else initial_id(name) if self._random else 0

    def number_of(self, name: str) -> int:
        """Return the id of an object as Cosys-AirSim numbers them, -1 if there was never one of this name."""
        names = self.names[1:]
        return self._given.get(name, names.index(name)) if name in names else NOT_FOUND

    def give(self, names: Iterable[str], number: int) -> None:
        """Give objects an id. Raises RpcError."""
        if not HIDDEN <= number <= _MOST_INSTANCE:
            raise RpcError(f"an object's id is 0 to {_MOST_ID}, or -1 to hide it, not {number}")
        self._given |= dict.fromkeys(names, number)
        self._generation = -1

    def grey(self) -> NDArray[np.uint8]:
        """Return the id of each instance as a shade, (n,)."""
        _ = self.names
        return (self._ids & 0xFF).astype(np.uint8)

    def _numbers(self) -> list[int]:
        return [self._given.get(name, place) for place, name in enumerate(self.names[1:])]

    def instance_palette(self) -> NDArray[np.uint8]:
        """Return RGB of Cosys-AirSim's ids from 0 to the greatest one of an object, (n, 3)."""
        return instance_colours(max([0, *self._numbers()]) + 1)

    def colours(self, instances: bool) -> NDArray[np.uint8]:
        """Return RGB of each instance, (n, 3). `instances`: as Cosys-AirSim colours them."""
        _ = self.names
        if instances not in self._colours:
            if instances:
                numbers, table = self._numbers(), self.instance_palette()
                shown = [table[number] if number >= 0 else (0, 0, 0) for number in numbers]
                self._colours[True] = np.array([(0, 0, 0), *shown], np.uint8)
            else:
                self._colours[False] = AIRSIM_COLOURS[self._ids & 0xFF]
                self._colours[False][0] = 0
        return self._colours[instances]
