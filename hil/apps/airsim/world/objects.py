"""Objects of the scene by name: their poses and scales, and objects that clients add, move and take away.

An object of the scene becomes an actor when it is changed first, and a new one is an actor from its beginning. For that
the world is made anew, once, when it is needed next: by a camera, a ray or a tick. Later changes of an actor's pose
cost nothing of that. `reset` leaves objects where they are, as AirSim does.

The frame of an object is front, left, up, as a vehicle's: an object with the orientation (1, 0, 0, 0) of AirSim looks
north.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.world.ned import unit_rotation
from hil.run.stepped.world import SteppedWorld
from signals.errors import HilError
from signals.rotation import NO_TURN
from signals.samples import Quat, Vec3
from sim.frame.source import VEHICLE_CLASS
from sim.scene.maps.scene_map import Actor
from sim.scene.placed.actor import FixedBody, ObjectActor
from sim.scene.placed.assets import asset, asset_names
from sim.scene.placed.geoms import way_to
from sim.scene.placed.template import Materials, Template, fixed_bodies, template_of
from sim.scene.placed.worlds import Added, with_objects
from sim.scene.semantics import MAX_SURFACES
from sim.scene.world import World
from sim.sensors.ground_range import MapRays, Rays, rays_into
from sim.world_loader import load_world

MOST_SPAWNED = 1000
_MOST_M = 50_000.0  # from the world's origin
_SCALES = (1e-3, 1e3)
_MOST_NAME = 200
_DIGITS = 12
_NEAR_M = 3.0  # farther than a vehicle can move in a tick
_RESERVED = f"{VEHICLE_CLASS}:"
_ONE: Vec3 = (1.0, 1.0, 1.0)


@dataclass
class SceneObject:
    """Object of the scene. `p_W`, `q_W`: its pose (FLU to ENU); `scale` along its own axes."""

    name: str
    p_W: Vec3
    q_W: Quat = NO_TURN
    scale: Vec3 = _ONE
    body: int = 0  # of the scene's model; 0: none
    mover: Actor | None = None  # actor of the scene that moves by itself
    template: Template | None = None  # of a copy
    actor: ObjectActor | None = None
    spawned: bool = False


class Objects:
    """Objects of one server, without its vehicles."""

    def __init__(self, world: SteppedWorld, log: Callable[[str], None]) -> None:
        self._world, self._log = world, log
        self._scene = world.scene
        self._moved: dict[str, ObjectActor] = {}  # of objects of the scene, by name
        self._copies: list[Added] = []
        self._changed = False  # the world must be made anew
        self._present_actors: set[int] = set()  # by identity, of the world that was made last
        self._now: World | None = None  # None: nothing was changed yet
        self._rays: Rays = rays_into(world.scene)
        # Spheres (x, y, z, radius) around changes that the vehicles' world does not hold yet.
        self._pending_bounds: dict[str, tuple[float, ...]] = {}
        self._spheres: NDArray[np.float64] | None = None  # these, (n, 4)
        self._numbers = 0  # of bodies of copies so far
        self.version = 0  # grows with every change
        self.on_moved: Callable[[Actor], None] = lambda _: None  # an actor of the present world was put elsewhere
        self.on_new_world: Callable[[], None] = lambda: None

    @cached_property
    def _base(self) -> World:
        return load_world(self._scene)

    @cached_property
    def _known(self) -> dict[str, SceneObject]:
        """Objects by name, those of the scene first."""
        base = self._base
        model = base.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        movers = {actor.name: actor for actor in base.map.actors}
        known = {}
        first_geom = {int(i): g for g, i in reversed(list(enumerate(base.geom_instance.tolist())))}
        for number, name in enumerate(base.instance_names):
            if number == 0 or number not in first_geom:
                continue
            geom = first_geom[number]
            body = int(model.geom_bodyid[geom])
            if name in movers:
                known[name] = SceneObject(name, (0.0, 0.0, 0.0), mover=movers[name])
                continue
            while body and model.body_parentid[body]:
                body = int(model.body_parentid[body])
            p, q = (data.xpos[body], data.xquat[body]) if body else (data.geom_xpos[geom], np.array(NO_TURN))
            x, y, z = np.round(p, _DIGITS).tolist()  # MuJoCo's last digits depend on the machine
            w, i, j, k = np.round(q, _DIGITS).tolist()
            known[name] = SceneObject(name, (x, y, z), (w, i, j, k), body=body)
        return known

    @property
    def names(self) -> list[str]:
        """Names of all objects that exist, those of the scene first, then spawned ones in their order."""
        return list(self._known)

    def find(self, name: str) -> SceneObject | None:
        """Return an object at its present pose; None if there is none."""
        found = self._known.get(name)
        if found is not None and found.mover is not None:
            n = len(found.mover.bodies)
            p, q, v, w = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))
            found.mover.pose(self._world.t_ns, p, q, v, w)
            found.p_W, found.q_W = tuple(p[0].tolist()), tuple(q[0].tolist())
        return found

    # Changes ---------------------------------------------------------------------------------------------------------

    def put(self, name: str, p_W: Vec3, q_W: Quat) -> bool:
        """Put an object elsewhere. Return False, and log the reason, if it cannot be moved. Raises RpcError."""
        found = self._movable(name)
        if found is None:
            return False
        q_W = _checked_pose(p_W, q_W)
        if found.actor is None:
            self._loosen(found)
        found.p_W, found.q_W = p_W, q_W
        self._put(found)
        return True

    def sweep(self, name: str, p_W: Vec3, q_W: Quat) -> bool:
        """Move an object straight to a place, up to its first contact. Return False if it stays where it is."""
        found = self._movable(name)
        if found is None:
            return False
        q_W = _checked_pose(p_W, q_W)
        if found.actor is None:
            self._loosen(found)
            self._put(found)
        assert found.actor is not None
        start = found.p_W
        found.p_W = way_to(self.present, found.actor, start, p_W, q_W, self._world.t_ns)
        found.q_W = q_W
        self._put(found)
        return found.p_W != start

    def rescale(self, name: str, scale: Vec3) -> bool:
        """Give an object another scale. Return False, and log the reason, if it cannot have one. Raises RpcError."""
        found = self._movable(name)
        if found is None:
            return False
        _check_scale(scale)
        if scale == found.scale:
            return True
        template = self._template_of(found)
        if template is None:
            self._log(f"{name} holds a height field and keeps its scale")
            return False
        copied = self._copy(name, template, scale)
        self._remove(found)
        found.template, found.scale, found.actor = template, scale, copied.actor
        self._copies.append(copied)
        self._changed = True
        self._put(found)
        return True

    def spawn(self, name: str, asset_name: str, p_W: Vec3, q_W: Quat, scale: Vec3) -> str:
        """Add a copy of an asset and return its name, which is `name` with a number if that exists. Raises RpcError."""
        q_W = _checked_pose(p_W, q_W)
        _check_scale(scale)
        if len(name) > _MOST_NAME:
            raise RpcError(f"the name of an object has at most {_MOST_NAME} characters, not {len(name)}")
        if name.startswith(_RESERVED):
            raise RpcError(f"names that begin with {_RESERVED} are those of vehicles; choose another name")
        if sum(each.spawned for each in self._known.values()) >= MOST_SPAWNED:
            raise RpcError(f"there are {MOST_SPAWNED} spawned objects, as many as there may be; destroy some first")
        template = self._template(asset_name)
        if template is None:
            raise RpcError(
                f"There were no objects with name {asset_name[:80]} found in the Registry; simListAssets gives the "
                "names that exist"
            )
        name = self._free_name(name or asset_name)
        self._check_surfaces(template)
        copied = self._copy(name, template, scale)
        found = SceneObject(name, p_W, q_W, scale, template=template, actor=copied.actor, spawned=True)
        self._known[name] = found
        self._copies.append(copied)
        self._changed = True
        self._put(found)
        return name

    def destroy(self, name: str) -> bool:
        """Take an object away. Return False if there is none, or, with a log line, if it belongs to the ground."""
        found = self._movable(name)
        if found is None:
            return False
        if found.actor is None:
            self._loosen(found)
        self._remove(found)
        del self._known[name]
        self.version += 1
        return True

    def assets(self) -> list[str]:
        """Return the names of what `spawn` can copy: our own assets, then objects of the scene."""
        own = asset_names()
        return [*own, *(name for name, each in self._known.items() if each.body and not each.spawned)]

    def _template(self, name: str) -> Template | None:
        made = asset(name)
        found = self._known.get(name)
        return made if made is not None or found is None else self._template_of(found)

    def _template_of(self, found: SceneObject) -> Template | None:
        """Return the template of an object; None if it has no body of its own, or one that cannot be copied."""
        if found.template is not None or not found.body:
            return found.template
        base = self._base
        class_name = base.class_names[int(base.geom_class[int(base.model.body_geomadr[found.body])])]
        return template_of(f"body_{found.body}", class_name, base.model, found.body, Materials())

    def _free_name(self, name: str) -> str:
        """Return a name that no object has, as AirSim does: with the greatest number of similar names, plus 1."""
        similar = [each for each in self._known if name in each]
        if not similar:
            return name
        numbers = [each[len(each.rstrip("0123456789")) :] for each in similar]
        name += str(1 + max((int(number[-15:]) for number in numbers if number), default=0))
        while name in self._known:
            name += "_1"
        return name

    def _movable(self, name: str) -> SceneObject | None:
        """Return an object that takes a pose; None if there is none, or, with a log line, if it cannot be moved."""
        found = self.find(name)
        if found is None:
            return None
        if found.mover is not None:
            self._log(f"{found.name} moves by itself and takes no pose or scale from clients")
        elif found.actor is None and (not found.body or fixed_bodies(self._base.model, found.body) is None):
            self._log(f"{found.name} belongs to the ground, or has no name of its own in the map, and stays as it is")
        else:
            return found
        return None

    def _loosen(self, found: SceneObject) -> None:
        """Make an object of the scene an actor."""
        model = self._base.model
        bodies = fixed_bodies(model, found.body)
        assert bodies is not None
        template = template_of(found.name, "object", model, found.body, Materials())
        radius_m = template.radius_m(_ONE) if template is not None else float(model.stat.extent)
        found.actor = self._moved[found.name] = ObjectActor(found.name, bodies, radius_m)
        self._pending_bounds[f"place of {found.name}"] = (*found.p_W, radius_m)
        self._spheres = None
        self._changed = True

    def _copy(self, name: str, template: Template, scale: Vec3) -> Added:
        """Return a copy that can be compiled. Raises RpcError."""
        try:
            template.check(scale)
        except ValueError as error:
            raise RpcError(f"{name} cannot have the scale {scale}: {' '.join(str(error).split())}") from None
        self._numbers += 1
        actor = ObjectActor(name, [FixedBody(f"placed_object_{self._numbers}")], template.radius_m(scale))
        return Added(actor, template, scale)

    def _check_surfaces(self, template: Template) -> None:
        """Raise RpcError if the world would have more surfaces than ids."""
        known = set(self._base.surfaces)
        for each in (template, *(copied.template for copied in self._copies)):
            known.update(each.materials.surfaces.values())
        if len(known) > MAX_SURFACES:
            raise RpcError(f"there would be more than {MAX_SURFACES} different surfaces; destroy other objects first")

    def _put(self, found: SceneObject) -> None:
        assert found.actor is not None
        found.actor.put(self._world.t_ns, found.p_W, found.q_W)
        self._notice(found.actor)

    def _remove(self, found: SceneObject) -> None:
        """Take the actor of an object out of the world."""
        if found.actor is None:
            self._loosen(found)
        assert found.actor is not None
        found.actor.take_away(self._world.t_ns)
        # A copy leaves the world when it is made anew; an object of the scene is outside it.
        self._copies = [each for each in self._copies if each.actor is not found.actor]
        self._notice(found.actor)

    def _notice(self, actor: ObjectActor) -> None:
        """Tell all who know the world that an actor was put elsewhere."""
        self.version += 1
        now = self._now
        if now is None or id(actor) not in self._present_actors:
            centre_W, radius_m = actor.bound(self._world.t_ns)
            self._pending_bounds[actor.bodies[0]] = (*centre_W, radius_m)
            self._spheres = None
            return
        if isinstance(self._rays, MapRays):
            self._rays.pose(actor, self._world.t_ns)
        self._world.actor_changed(actor)
        self.on_moved(actor)

    # Use -------------------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """Make the world anew, if an object was changed that it holds as part of the ground, or lacks."""
        if not self._changed:
            return
        self._changed = False
        self._pending_bounds.clear()
        self._spheres = None
        moved = list(self._moved.values())
        try:
            now = with_objects(self._base, moved, self._copies)
        except HilError as error:
            self._drop_new(str(error))
            now = with_objects(self._base, moved, self._copies)
        before, self._now = self._now, now
        self._world.surround(now.scene)
        if before is not None:
            before.scene.file.cache.clear()  # it holds the world, and the world the scene
        actors = [*moved, *(each.actor for each in self._copies)]
        self._present_actors = {id(actor) for actor in actors}
        rays = MapRays(now, actors)
        for actor in actors:
            rays.pose(actor, self._world.t_ns)
        self._rays = rays
        self.on_new_world()

    def _drop_new(self, reason: str) -> None:
        """Take back the copies that the world made last does not hold."""
        new = {id(each.actor) for each in self._copies} - self._present_actors
        self._copies = [each for each in self._copies if id(each.actor) not in new]
        for found in [each for each in self._known.values() if id(each.actor) in new]:
            if found.spawned:
                self._log(f"{found.name} is taken away, because the world cannot be made with it: {reason}")
                del self._known[found.name]
            else:
                self._log(f"{found.name} has its first scale again, because the world cannot be made: {reason}")
                found.template, found.scale, found.actor = None, _ONE, self._moved[found.name]
                found.actor.put(self._world.t_ns, found.p_W, found.q_W)
        self.version += 1

    def settle_near(self) -> None:
        """Make the world anew if a vehicle could touch something of what was changed within a tick."""
        if not self._changed:
            return
        if self._spheres is None:
            self._spheres = np.array(list(self._pending_bounds.values())).reshape(-1, 4)
        centres, radii = self._spheres[:, :3], self._spheres[:, 3]
        for vehicle in self._world.vehicles.values():
            gap = np.sqrt(((centres - vehicle.truth.p_WB) ** 2).sum(axis=1)) - radii
            if np.any(gap < vehicle.vehicle.bounding_radius_m + _NEAR_M):
                self.settle()
                return

    @property
    def present(self) -> World:
        """The world with its objects, without vehicles."""
        self.settle()
        return self._base if self._now is None else self._now

    def ray_distance(self, origin_W: Vec3, direction_W: Vec3) -> float:
        """Return the distance [m] along a unit vector to the nearest surface, vehicles left out; -1 for none."""
        self.settle()
        return self._rays.ray_distance(origin_W, direction_W)


def _checked_pose(p_W: Vec3, q_W: Quat) -> Quat:
    """Return the unit quaternion of a pose. Raises RpcError for a pose beyond the world, or for no rotation."""
    if not all(abs(x) <= _MOST_M for x in p_W):
        raise RpcError(f"a position beyond {_MOST_M:g} m from the world's origin is outside the world")
    return unit_rotation(q_W)


def _check_scale(scale: Vec3) -> None:
    low, high = _SCALES
    if not all(low <= s <= high for s in scale):
        raise RpcError(f"each component of a scale goes from {low:g} to {high:g}, not {tuple(scale)}")
