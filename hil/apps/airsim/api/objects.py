"""Methods about the objects of the scene: list, pose, scale, spawn, destroy; lines of sight; meshes and voxels."""

from __future__ import annotations

import math
from typing import Any

from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.api.state import place
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    FLOAT,
    INT,
    NAME,
    POSE,
    TEXT,
    VECTOR,
    VECTOR_OR_NAN,
    Pose,
    Quaternion,
    Vector,
    struct,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.settings.scene_names import scene_name
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.ned import q_WB_from_q_NF
from hil.apps.airsim.world.objects.bounds import Bounds
from hil.apps.airsim.world.objects.line_of_sight import is_clear
from hil.apps.airsim.world.objects.mesh_buffers import mesh_buffers
from hil.apps.airsim.world.objects.names import matching
from hil.apps.airsim.world.objects.voxel_grid import binvox, occupied
from signals.samples import Quat, Vec3

_MOST_CELLS = 20_000_000
_NAN = math.nan
GEO_POINT = struct(
    "GeoPoint",
    lambda latitude=0.0, longitude=0.0, altitude=0.0: Vector(latitude, longitude, altitude),
    latitude=FLOAT,
    longitude=FLOAT,
    altitude=FLOAT,
)
NO_POSE = Pose(Vector(_NAN, _NAN, _NAN), Quaternion(_NAN, _NAN, _NAN, _NAN))


def object_names(simulation: Simulation) -> list[str]:
    """Return the names of all objects that exist, then those of the vehicles."""
    return [*simulation.objects.names, *simulation.drones]


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim, objects = simulation, simulation.objects
    told: set[str] = set()  # methods without a meaning here that were logged

    def in_W(pose: Pose) -> tuple[Vec3, Quat]:
        (x, y, z), q_NF = pose
        return sim.frame.to_W((x, y, z)), q_WB_from_q_NF((q_NF.w_val, q_NF.x_val, q_NF.y_val, q_NF.z_val))

    def get_pose(name: str, ned: bool) -> Pose:
        drone = sim.drones.get(name)
        if drone is not None:
            p_W, q_W = drone.vehicle.truth.p_WB, drone.vehicle.truth.q_WB
        else:
            found = objects.find(name)
            if found is None:
                return NO_POSE
            p_W, q_W = found.p_W, found.q_W
        pose = sim.frame.pose(p_W, q_W)
        return pose if ned else _unreal(pose)

    def set_pose(name: str, pose: Pose, teleport: bool) -> bool:
        drone = sim.drones.get(name)
        if drone is not None:
            p_N = drone.origin.from_W(in_W(pose)[0])
            place(sim, drone, Pose(Vector(*p_N), pose.orientation), collides=not teleport)
            return True
        p_W, q_W = in_W(pose)
        return objects.put(name, p_W, q_W) if teleport else objects.sweep(name, p_W, q_W)

    def get_scale(name: str) -> Vector:
        found = objects.find(name)
        if found is not None:
            return Vector(*found.scale)
        return Vector(1.0, 1.0, 1.0) if name in sim.drones else Vector()  # zeros, as AirSim

    def set_scale(name: str, scale: Vector) -> bool:
        if name in sim.drones:
            sim.log(f"{name} is a vehicle and keeps its size")
            return False
        return objects.rescale(name, _finite("scale", scale))

    def spawn(name: str, asset: str, pose: Pose, scale: Vector, has_physics: bool, is_blueprint: bool) -> str:
        p_W, q_W = in_W(pose)
        if is_blueprint:
            raise RpcError("there are no blueprints here; spawn an asset of simListAssets with is_blueprint=False")
        if name in sim.drones:
            name += "_1"
        name = objects.spawn(name, asset, p_W, q_W, _finite("scale", scale))
        if has_physics:
            sim.log(f"{name} stays where it was spawned: objects with physics_enabled do not fall here")
        return name

    def list_objects(pattern: str) -> list[str]:
        return matching(pattern, object_names(sim), any_case=False)

    def to_point(point: Vector, name: str) -> bool:
        drone = sim.drone(name)
        return is_clear(sim.frames.seen_by(drone.name), drone.vehicle.truth.p_WB, sim.earth.point_W(*point))

    def between_points(begin: Vector, end: Vector) -> bool:
        return is_clear(sim.frames.seen_by(), sim.earth.point_W(*begin), sim.earth.point_W(*end))

    def extents() -> list[dict[str, float]]:
        return [geo_point(sim, corner) for corner in Bounds(sim.present.world).extents(sim.world.t_ns)]

    def meshes() -> list[dict[str, Any]]:
        return mesh_buffers(sim.present.world, sim.world.t_ns, sim.frame.from_W)

    def voxel_grid(position: Vector, x: int, y: int, z: int, edge_m: float, file: str) -> bool:
        size_m = (float(x), float(y), float(z))
        if not (edge_m > 0.0 and min(size_m) >= edge_m):
            raise RpcError(f"a voxel grid of {x} x {y} x {z} m has no cell of {edge_m:g} m")
        north, east, up = (int(size / edge_m + 1e-6) for size in size_m)
        if north * east * up > _MOST_CELLS:
            raise RpcError(
                f"a voxel grid of {north} x {east} x {up} cells is too large: at most {_MOST_CELLS} cells in all; "
                "take a greater res, or a smaller grid"
            )
        if not file.lower().endswith(".binvox"):
            raise RpcError(f"'{file[:80]}' does not end with .binvox, the format of a voxel grid")
        sim.files.place(file)  # a mistake is told before the work
        middle_W, _ = in_W(Pose(position))
        cells = occupied(sim.frames.seen_by(), middle_W, (east, north, up), edge_m)
        sim.files.write(file, binvox(cells.transpose(1, 0, 2), size_m))
        return True

    def not_here(name: str, reason: str, result: Any) -> Any:
        if name not in told:
            told.add(name)
            sim.log(f"{name} does nothing: {reason}")
        return result

    def load_level(level: str) -> bool:
        if scene_name(level) == sim.scene.name:
            return True
        raise RpcError(
            f"the scene is {sim.scene.name} until the server ends; start `hil airsim --scene {level[:40]}` for another"
        )

    textures = "a scene keeps its materials; --scene and random appearances of the bench give other ones"
    lights = "no scene has lights that can be switched; simSetTimeOfDay moves the sun"
    component, light = optional("component_id", INT, 0), Parameter("light_name", TEXT)
    pose, scale = Parameter("pose", POSE), Parameter("scale", VECTOR_OR_NAN)
    name = Parameter("object_name", NAME)
    return [
        method("simListSceneObjects", list_objects, optional("name_regex", TEXT, ".*")),
        method(
            "simListSceneObjectsTags",
            lambda pattern: [(each, "") for each in list_objects(pattern)],
            optional("name_regex", TEXT, ".*"),
        ),
        method("simGetObjectPose", get_pose, name, optional("ned", BOOL, True)),
        method("simSetObjectPose", set_pose, name, pose, optional("teleport", BOOL, True))._replace(
            is_long=lambda name, _, teleport: not teleport and not sim.present.is_settled and name not in sim.drones
        ),
        method("simGetObjectScale", get_scale, name),
        method("simSetObjectScale", set_scale, name, scale),
        method("simListAssets", objects.assets),
        method(
            "simSpawnObject",
            spawn,
            name,
            Parameter("load_component", TEXT),
            pose,
            scale,
            optional("physics_enabled", BOOL, False),
            optional("is_blueprint", BOOL, False),
        ),
        method("simDestroyObject", objects.destroy, name),
        method("simTestLineOfSightToPoint", to_point, Parameter("point", GEO_POINT), VEHICLE),
        method(
            "simTestLineOfSightBetweenPoints", between_points, Parameter("p1", GEO_POINT), Parameter("p2", GEO_POINT)
        ),
        method("simGetWorldExtents", extents),
        method("simGetMeshPositionVertexBuffers", meshes),
        method(
            "simCreateVoxelGrid",
            voxel_grid,
            Parameter("position", VECTOR),
            *(Parameter(each, INT) for each in ("x", "y", "z")),
            Parameter("res", FLOAT),
            Parameter("output_file", TEXT),
        )._replace(is_long=lambda *_: True),
        method(
            "simSwapTextures",
            lambda *_: not_here("simSwapTextures", textures, []),
            Parameter("tag", TEXT),
            optional("tex_id", INT, 0),
            component,
            optional("material_id", INT, 0),
        ),
        method(
            "simSetObjectMaterial",
            lambda *_: not_here("simSetObjectMaterial", textures, False),
            name,
            Parameter("material_name", TEXT),
            component,
        ),
        method(
            "simSetObjectMaterialFromTexture",
            lambda *_: not_here("simSetObjectMaterialFromTexture", textures, False),
            name,
            Parameter("texture_path", TEXT),
            component,
        ),
        *(
            method(each, lambda *_, each=each: not_here(each, lights, False), light, Parameter("intensity", FLOAT))
            for each in ("simSetLightIntensity", "simSetWorldLightIntensity")
        ),
        method(
            "simSetWorldLightVisibility",
            lambda *_: not_here("simSetWorldLightVisibility", lights, False),
            light,
            optional("is_visible", BOOL, True),
        ),
        method(
            "simSetVehicleLightIntensity",
            lambda *_: not_here("simSetVehicleLightIntensity", lights, False),
            Parameter("vehicle_name", TEXT),
            light,
            Parameter("intensity", FLOAT),
        ),
        method(
            "simSetVehicleLightVisibility",
            lambda *_: not_here("simSetVehicleLightVisibility", lights, False),
            Parameter("vehicle_name", TEXT),
            light,
            optional("is_visible", BOOL, True),
        ),
        method("simLoadLevel", load_level, Parameter("level_name", TEXT)),
    ]


def _finite(what: str, vector: Vector) -> Vec3:
    if not vector.is_finite:
        raise RpcError(f"the {what} {tuple(vector)} is not finite")
    return tuple(vector)  # type: ignore[return-value]


def _unreal(pose: Pose) -> Pose:
    """Return a pose in Unreal's axes [cm]: north, east, up."""
    (x, y, z), (w, i, j, k) = pose
    return Pose(Vector(100.0 * x, 100.0 * y, -100.0 * z), Quaternion(w, -i, -j, k))
