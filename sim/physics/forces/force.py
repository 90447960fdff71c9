"""Interface of the forces that act on a vehicle, and how they are found.

A kind of force is a file of this folder with a model of its parameters, a `ForceParameters`, and a C++ file of the same
name in sim/native/forces with its equation. In a vehicle file:

    forces:
      - {kind: buoyancy, volume_m3: 0.002}
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union

from pydantic import Field

from signals.documents.validate import StrictModel
from sim import _kernels

if TYPE_CHECKING:
    from sim.physics.forces.surface import Surface

Metres = Annotated[float, Field(ge=-10.0, le=10.0)]
Point = tuple[Metres, Metres, Metres]


class Effects(StrictModel):
    """Switches of the optional parts of the model.

    A part that is off costs nothing. Motor lag, gyroscopic torque and drag have no switch: set their coefficients in
    the vehicle file to zero.
    """

    ground_effect: bool = True  # more thrust near the ground
    descent_loss: bool = True  # less thrust in the vortex ring state
    air_density: bool = True  # follows the height, unless `rotor_model: quadratic`
    battery: bool = False  # rotor speed limit follows the voltage; needs a vehicle with a battery


class Command(NamedTuple):
    """One command of a vehicle, a slot of its autopilot's controls."""

    name: str
    signed: bool  # -1..1, else 0..1


class ForceParameters(StrictModel):
    """Parameters of one entry of `forces`. A kind has a field `kind` with its name, a Literal."""

    @property
    def commands(self) -> tuple[Command, ...]:
        """Commands that the force takes, in the order of the kernel's."""
        return ()

    @property
    def moved_surfaces(self) -> tuple[Surface, ...]:
        """Control surfaces of the force, whose deflections are its own states, in that order."""
        return ()

    @property
    def is_wing(self) -> bool:
        """True if the force carries the vehicle by its speed through the air, whose density it follows."""
        return False

    def standing_height_m(self, weight_n: float) -> float | None:  # noqa: ARG002 (of one that carries it)
        """Return the height of the body origin over level ground that the force rests on; None: it carries nothing."""
        return None

    def standing_pitch_rad(self, weight_n: float) -> float:  # noqa: ARG002 (of one that carries it)
        """Return the pitch, nose up above 0, at which the body rests on the force on level ground."""
        return 0.0

    @property
    def rolling_resistance(self) -> float:
        """Rolling resistance over load of wheels with free brakes."""
        return 0.0

    @property
    def mean_chord_m(self) -> float | None:
        """Chord of a wing, over which a static margin is counted."""
        return None

    def make(self, effects: Effects) -> _kernels.Force:
        """Return a new force; it belongs to one body."""
        raise NotImplementedError


def kinds() -> tuple[type[ForceParameters], ...]:
    """Return the parameters of every kind of force in this folder, by name of the file."""
    from sim.physics import forces

    found = []
    for module in sorted(info.name for info in pkgutil.iter_modules(forces.__path__)):
        for member in vars(importlib.import_module(f"{forces.__name__}.{module}")).values():
            if isinstance(member, type) and issubclass(member, ForceParameters) and "kind" in member.model_fields:
                found.append(member)
    return tuple(found)


def any_kind() -> Any:
    """Return the type of an entry of `forces`: the model that its `kind` selects."""
    models = kinds()
    return Annotated[Union[models], Field(discriminator="kind")] if len(models) > 1 else models[0]  # noqa: UP007
