"""Objects of the scene by name: their poses and scales, and objects that clients add, move and take away.

`reset` leaves objects where they are, as AirSim does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.world.ned import unit_rotation
from hil.apps.airsim.world.objects.present_world import PresentWorld
from hil.apps.airsim.world.objects.scene_object import UNSCALED, SceneObject, scene_objects
from signals.errors import ConfigError
from signals.samples import Quat, Vec3
from sim.frame.source import VEHICLE_CLASS
from sim.scene.compile.actor_geoms import way_to
from sim.scene.compile.placed_worlds import Added
from sim.scene.placed.actor import FixedBody, ObjectActor
from sim.scene.placed.assets import asset, asset_names
from sim.scene.placed.template import Materials, Template, fixed_bodies, template_of
from sim.scene.scene_map import actor_pose
from sim.scene.semantics import MAX_SURFACES

MOST_SPAWNED = 1000
_MOST_M = 50_000.0  # from the world's origin
_SCALES = (1e-3, 1e3)
_MOST_NAME = 200
_RESERVED = f"{VEHICLE_CLASS}:"


class Objects:
    """Objects of one server, without its vehicles."""

    def __init__(self, world: PresentWorld, log: Callable[[str], None]) -> None:
        self._world, self._log = world, log
        self._copies_made = 0
        world.on_refused = self._refused

    @cached_property
    def _known(self) -> dict[str, SceneObject]:
        """Objects by name, those of the scene first."""
        return scene_objects(self._world.base)

    @property
    def names(self) -> list[str]:
        """Names of all objects that exist, those of the scene first, then spawned ones in their order."""
        return list(self._known)

    def find(self, name: str) -> SceneObject | None:
        """Return an object at its present pose; None if there is none."""
        found = self._known.get(name)
        if found is not None and found.mover is not None:
            p, q, _, _ = actor_pose(found.mover, self._world.t_ns)
            found.p_W, found.q_W = tuple(p[0].tolist()), tuple(q[0].tolist())
        return found

    def class_of(self, name: str) -> str:
        """Return the class of an object that exists."""
        return self._known[name].class_name

    # Changes ---------------------------------------------------------------------------------------------------------

    def put(self, name: str, p_W: Vec3, q_W: Quat) -> bool:
        """Put an object elsewhere. Return False, and log the reason, if it cannot be moved. Raises RpcError."""
        found = self._movable(name)
        if found is None:
            return False
        q_W = _checked_pose(p_W, q_W)
        actor = self._actor_of(found)
        found.p_W, found.q_W = p_W, q_W
        self._world.put(actor, p_W, q_W)
        return True

    def sweep(self, name: str, p_W: Vec3, q_W: Quat) -> bool:
        """Move an object straight to a place, up to its first contact. Return False if it stays where it is."""
        found = self._movable(name)
        if found is None:
            return False
        q_W = _checked_pose(p_W, q_W)
        start, actor = found.p_W, self._actor_of(found)
        found.p_W = way_to(self._world.world, actor, start, p_W, q_W, self._world.t_ns)
        found.q_W = q_W
        self._world.put(actor, found.p_W, q_W)
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
        self._world.take_away(self._actor_of(found))
        found.template, found.scale, found.actor = template, scale, copied.actor
        self._world.add(copied)
        self._world.put(copied.actor, found.p_W, found.q_W)
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
        self._known[name] = SceneObject(
            name, template.class_name, p_W, q_W, scale, template=template, actor=copied.actor, spawned=True
        )
        self._world.add(copied)
        self._world.put(copied.actor, p_W, q_W)
        return name

    def destroy(self, name: str) -> bool:
        """Take an object away. Return False if there is none, or, with a log line, if it belongs to the ground."""
        found = self._movable(name)
        if found is None:
            return False
        self._world.take_away(self._actor_of(found))
        del self._known[name]
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
        base = self._world.base
        class_name = base.class_names[int(base.geom_class[int(base.model.body_geomadr[found.body])])]
        key, from_file = f"body_{found.body}", base.map.from_file
        return template_of(key, class_name, base.model, found.body, Materials(), from_file=from_file)

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
        elif found.actor is None and (not found.body or fixed_bodies(self._world.base.model, found.body) is None):
            self._log(f"{found.name} belongs to the ground, or has no name of its own in the map, and stays as it is")
        else:
            return found
        return None

    def _actor_of(self, found: SceneObject) -> ObjectActor:
        """Return the actor of an object that can be moved. An object of the scene becomes one, where it is."""
        if found.actor is None:
            model = self._world.base.model
            bodies = fixed_bodies(model, found.body)
            assert bodies is not None
            template = template_of(found.name, "object", model, found.body, Materials())
            radius_m = template.radius_m(UNSCALED) if template is not None else float(model.stat.extent)
            found.actor = self._world.loosen(found.name, bodies, found.p_W, radius_m)
            self._world.put(found.actor, found.p_W, found.q_W)
        return found.actor

    def _copy(self, name: str, template: Template, scale: Vec3) -> Added:
        """Return a copy that can be compiled. Raises RpcError."""
        try:
            template.check(scale)
        except (ValueError, ConfigError) as error:
            raise RpcError(f"{name} cannot have the scale {scale}: {' '.join(str(error).split())}") from None
        self._copies_made += 1
        actor = ObjectActor(name, [FixedBody(f"placed_object_{self._copies_made}")], template.radius_m(scale))
        return Added(actor, template, scale)

    def _check_surfaces(self, template: Template) -> None:
        """Raise RpcError if the world would have more surfaces than ids."""
        known = set(self._world.base.surfaces)
        for each in (template, *(copied.template for copied in self._world.copies)):
            known.update(each.materials.surfaces.values())
        if len(known) > MAX_SURFACES:
            raise RpcError(f"there would be more than {MAX_SURFACES} different surfaces; destroy other objects first")

    def _refused(self, dropped: Sequence[Added], reason: str) -> None:
        """Take back objects whose copies the world cannot hold."""
        actors = {id(each.actor) for each in dropped}
        for found in [each for each in self._known.values() if id(each.actor) in actors]:
            if found.spawned:
                self._log(f"{found.name} is taken away, because the world cannot be made with it: {reason}")
                del self._known[found.name]
            else:
                self._log(f"{found.name} has its first scale again, because the world cannot be made: {reason}")
                found.template, found.scale, found.actor = None, UNSCALED, self._world.original(found.name)
                self._world.put(found.actor, found.p_W, found.q_W)


def _checked_pose(p_W: Vec3, q_W: Quat) -> Quat:
    """Return the unit quaternion of a pose. Raises RpcError for a pose beyond the world, or for no rotation."""
    if not all(abs(x) <= _MOST_M for x in p_W):
        raise RpcError(f"a position beyond {_MOST_M:g} m from the world's origin is outside the world")
    return unit_rotation(q_W)


def _check_scale(scale: Vec3) -> None:
    low, high = _SCALES
    if not all(low <= s <= high for s in scale):
        raise RpcError(f"each component of a scale goes from {low:g} to {high:g}, not {tuple(scale)}")
