"""Methods about the scene's geometry: lines of sight, extents, meshes and voxels."""

from __future__ import annotations

from typing import Any

from hil.apps.airsim.api.objects import pose_in_W
from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.rpc.arguments import FLOAT, INT, TEXT, VECTOR, Pose, Vector, struct
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.objects.bounds import Bounds
from hil.apps.airsim.world.objects.line_of_sight import is_clear
from hil.apps.airsim.world.objects.mesh_buffers import mesh_buffers
from hil.apps.airsim.world.objects.voxel_grid import binvox, occupied

_MOST_CELLS = 20_000_000
GEO_POINT = struct(
    "GeoPoint",
    lambda latitude=0.0, longitude=0.0, altitude=0.0: Vector(latitude, longitude, altitude),
    latitude=FLOAT,
    longitude=FLOAT,
    altitude=FLOAT,
)


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

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
        middle_W, _ = pose_in_W(sim, Pose(position))
        cells = occupied(sim.frames.seen_by(), middle_W, (east, north, up), edge_m)
        sim.files.write(file, binvox(cells.transpose(1, 0, 2), size_m))
        return True

    return [
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
    ]
