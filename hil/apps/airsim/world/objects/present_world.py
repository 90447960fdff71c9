"""World of the scene with the objects that clients moved and added, without vehicles.

An object of the scene becomes an actor when it is changed first, and a new one is an actor from its beginning. For that
the world is made anew, once, when it is needed next: by a camera, a ray, or a vehicle that comes near. Later changes of
an actor's pose cost nothing of that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hil.run.stepped.world import SteppedWorld
from signals.errors import HilError
from signals.samples import Quat, Vec3
from sim.scene.compile.placed_worlds import Added, with_objects
from sim.scene.placed.actor import FixedBody, ObjectActor
from sim.scene.scene_map import Actor
from sim.scene.world import World
from sim.sensors.ground_range import MapRays, Rays, rays_into
from sim.world_loader import load_world

_NEAR_M = 3.0  # farther than a vehicle can move in a tick


class PresentWorld:
    """World of one server. `on_...` are called with what changed."""

    def __init__(self, stepped: SteppedWorld) -> None:
        self._stepped = stepped
        self._scene = stepped.scene
        self._moved: dict[str, ObjectActor] = {}  # of objects of the scene, by name
        self._copies: list[Added] = []
        self._changed = False  # the world must be made anew
        self._actors: set[int] = set()  # by identity, of the world that was made last
        self._now: World | None = None  # None: nothing was changed yet
        self._rays: Rays = rays_into(self._scene)
        # Spheres (x, y, z, radius) around changes that the vehicles' world does not hold yet.
        self._pending_bounds: dict[str, tuple[float, ...]] = {}
        self._spheres: NDArray[np.float64] | None = None  # these, (n, 4)
        self.on_moved: Callable[[Actor], None] = lambda _: None  # an actor of the present world was put elsewhere
        self.on_new_world: Callable[[], None] = lambda: None
        self.on_refused: Callable[[Sequence[Added], str], None] = lambda *_: None  # copies, and why they are dropped

    @property
    def t_ns(self) -> int:
        """Present time."""
        return self._stepped.t_ns

    @cached_property
    def base(self) -> World:
        """World of the scene as it began."""
        return load_world(self._scene)

    @property
    def world(self) -> World:
        """World with its objects."""
        self.settle()
        return self.base if self._now is None else self._now

    def ray_distance(self, origin_W: Vec3, direction_W: Vec3) -> float:
        """Return the distance [m] along a unit vector to the nearest surface, vehicles left out; -1 for none."""
        self.settle()
        return self._rays.ray_distance(origin_W, direction_W)

    # Changes ---------------------------------------------------------------------------------------------------------

    @property
    def copies(self) -> Sequence[Added]:
        """Copies that were added, and not taken away."""
        return self._copies

    def loosen(self, name: str, bodies: Sequence[FixedBody], p_W: Vec3, radius_m: float) -> ObjectActor:
        """Return the actor of an object of the scene, which becomes one; `p_W`: its place so far."""
        actor = self._moved[name] = ObjectActor(name, bodies, radius_m)
        self._pend(f"place of {name}", p_W, radius_m)
        self._changed = True
        return actor

    def add(self, copied: Added) -> None:
        """Add a copy; `put` it then."""
        self._copies.append(copied)
        self._changed = True

    def put(self, actor: ObjectActor, p_W: Vec3, q_W: Quat) -> None:
        """Put an actor elsewhere."""
        actor.put(p_W, q_W)
        self._tell(actor)

    def take_away(self, actor: ObjectActor) -> None:
        """Put an actor outside the world. A copy leaves the world when that is made anew."""
        actor.take_away()
        self._copies = [each for each in self._copies if each.actor is not actor]
        self._tell(actor)

    def original(self, name: str) -> ObjectActor:
        """Return the actor that an object of the scene has without a scale."""
        return self._moved[name]

    def _pend(self, name: str, centre_W: Vec3, radius_m: float) -> None:
        self._pending_bounds[name] = (*centre_W, radius_m)
        self._spheres = None

    def _tell(self, actor: ObjectActor) -> None:
        """Tell all who know the world that an actor was put elsewhere."""
        if id(actor) not in self._actors:
            self._pend(actor.bodies[0], *actor.bound(self.t_ns))
            return
        if isinstance(self._rays, MapRays):
            self._rays.pose(actor, self.t_ns)
        self._stepped.actor_changed(actor)
        self.on_moved(actor)

    # Making the world anew -------------------------------------------------------------------------------------------

    @property
    def is_settled(self) -> bool:
        """True if the world holds all changes."""
        return not self._changed

    def settle(self) -> None:
        """Make the world anew, if an object was changed that it holds as part of the ground, or lacks."""
        if not self._changed:
            return
        self._changed = False
        self._pending_bounds.clear()
        self._spheres = None
        moved = list(self._moved.values())
        try:
            now = with_objects(self.base, moved, self._copies)
        except HilError as error:
            dropped = [each for each in self._copies if id(each.actor) not in self._actors]
            self._copies = [each for each in self._copies if id(each.actor) in self._actors]
            self.on_refused(dropped, str(error))
            now = with_objects(self.base, moved, self._copies)
        before, self._now = self._now, now
        self._stepped.surround(now.scene)
        if before is not None:
            before.scene.file.cache.clear()  # it holds the world, and the world the scene
        actors = [*moved, *(each.actor for each in self._copies)]
        self._actors = {id(actor) for actor in actors}
        self._rays = rays = MapRays(now, actors)
        for actor in actors:
            rays.pose(actor, self.t_ns)
        self.on_new_world()

    @property
    def is_near(self) -> bool:
        """True if a vehicle could touch within a tick what was changed, and the world must be made anew for that."""
        if not self._changed:
            return False
        if self._spheres is None:
            self._spheres = np.array(list(self._pending_bounds.values())).reshape(-1, 4)
        centres, radii = self._spheres[:, :3], self._spheres[:, 3]
        for vehicle in self._stepped.vehicles.values():
            gap = np.sqrt(((centres - vehicle.truth.p_WB) ** 2).sum(axis=1)) - radii
            if np.any(gap < vehicle.vehicle.bounding_radius_m + _NEAR_M):
                return True
        return False

    def settle_near(self) -> None:
        """Make the world anew if `is_near`."""
        if self.is_near:
            self.settle()
