"""Object that is put elsewhere from outside, as an actor: it rests between two changes of its pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from signals.rotation import NO_TURN
from signals.samples import Quat, Vec3
from sim import _kernels

_STILL: Vec3 = (0.0, 0.0, 0.0)
_OUTSIDE: Vec3 = (1e8, 0.0, 0.0)  # beyond the geometry's world, where nothing is shown


class FixedBody(NamedTuple):
    """Body of an object, at a fixed pose in the object's frame."""

    name: str
    position_m: Vec3 = _STILL
    quaternion: Quat = NO_TURN


class ObjectActor(_kernels.PlacedVehicle):
    """`Actor` of one object. Its first body has the object's frame; it is outside the world until `put`."""

    def __init__(self, name: str, bodies: Sequence[FixedBody], radius_m: float) -> None:
        """`radius_m`: of a sphere about the origin of the object's frame that encloses the object."""
        self.name = name
        self.fixed = tuple(bodies)
        self.bodies = tuple(body.name for body in bodies)
        self.max_speed_mps = 0.0  # its pose changes in `put` alone
        others = bodies[1:]
        super().__init__(
            p_BR=[body.position_m for body in others],
            q_BR=[body.quaternion for body in others],
            spin=[1.0] * len(others),
            radius_m=radius_m,
        )

    def put(self, p_WB: Vec3, q_WB: Quat) -> None:
        """Put the object there, for all times."""
        self.place_at(0, p_WB, q_WB, _STILL, _STILL, (0.0,) * (len(self.bodies) - 1))

    def take_away(self) -> None:
        """Put the object outside the world."""
        self.put(_OUTSIDE, NO_TURN)
