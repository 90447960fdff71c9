"""Base of the forces that carry a vehicle by its speed through the air and that surfaces control."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.physics.forces.force import Command, ForceParameters
from sim.physics.forces.surface import Surface


class WingParameters(ForceParameters):
    """Parameters of a wing or a whole aircraft; each of its `surfaces` takes a command of -1..1."""

    if TYPE_CHECKING:
        surfaces: tuple[Surface, ...]

    @property
    def commands(self) -> tuple[Command, ...]:
        return tuple(Command(surface.name, signed=True) for surface in self.surfaces)

    @property
    def moved_surfaces(self) -> tuple[Surface, ...]:
        return self.surfaces

    @property
    def is_wing(self) -> bool:
        return True
