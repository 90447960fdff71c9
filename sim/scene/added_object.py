"""An object that randomisation adds to a world."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from signals.samples import Vec3
from sim.scene.appearance import ObjectKind

OBJECT = "random_object_"  # prefix of the names of added objects and of their materials


@dataclass(frozen=True)
class AddedObject:
    """A still object added to a map."""

    name: str  # of its body
    kind: ObjectKind
    class_name: str
    at_m: Vec3  # where it stands, in W
    heading_deg: float  # from east to north
    look: int  # seed of its colours and shape

    def as_data(self) -> dict[str, Any]:
        """Return the object as plain data for run.json."""
        return asdict(self)
