"""Methods about which objects exist: list, spawn, destroy, and the level."""

from __future__ import annotations

from hil.apps.airsim.api.objects import finite, object_names, pose_in_W
from hil.apps.airsim.rpc.arguments import BOOL, NAME, POSE, TEXT, VECTOR_OR_NAN, Pose, Vector
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.settings.scene_names import scene_name
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.objects.names import matching
from sim.frame.source import VEHICLE_CLASS


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group. The tag of an object is its class, as in segmentation (docs/scenes.md)."""
    sim, objects = simulation, simulation.objects

    def list_objects(pattern: str) -> list[str]:
        return matching(pattern, object_names(sim), any_case=False)

    def tag(name: str) -> str:
        return VEHICLE_CLASS if name in sim.drones else objects.class_of(name)

    def list_by_tag(pattern: str) -> list[str]:
        names = object_names(sim)
        tags = {name: tag(name) for name in names}
        wanted = set(matching(pattern, sorted(set(tags.values())), any_case=False))
        return [name for name in names if tags[name] in wanted]

    def spawn(name: str, asset: str, pose: Pose, scale: Vector, has_physics: bool, is_blueprint: bool) -> str:
        p_W, q_W = pose_in_W(sim, pose)
        if is_blueprint:
            raise RpcError("there are no blueprints here; spawn an asset of simListAssets with is_blueprint=False")
        if name in sim.drones:
            name += "_1"
        name = objects.spawn(name, asset, p_W, q_W, finite("scale", scale))
        if has_physics:
            sim.log(f"{name} stays where it was spawned: objects with physics_enabled do not fall here")
        return name

    def load_level(level: str) -> bool:
        if scene_name(level) == sim.scene.name:
            return True
        raise RpcError(
            f"the scene is {sim.scene.name} until the server ends; start `hil airsim --scene {level[:40]}` for another"
        )

    regex, name = optional("name_regex", TEXT, ".*"), Parameter("object_name", NAME)
    return [
        method("simListSceneObjects", list_objects, regex),
        method("simListSceneObjectsTags", lambda pattern: [(each, tag(each)) for each in list_objects(pattern)], regex),
        method("simListSceneObjectsByTag", list_by_tag, optional("tag_regex", TEXT, ".*")),  # Colosseum's
        method("simListAssets", objects.assets),
        method(
            "simSpawnObject",
            spawn,
            name,
            Parameter("load_component", TEXT),
            Parameter("pose", POSE),
            Parameter("scale", VECTOR_OR_NAN),
            optional("physics_enabled", BOOL, False),
            optional("is_blueprint", BOOL, False),
        ),
        method("simDestroyObject", objects.destroy, name),
        method("simLoadLevel", load_level, Parameter("level_name", TEXT)),
    ]
