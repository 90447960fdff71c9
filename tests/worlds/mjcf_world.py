"""A world for tests of rays and LiDARs: any MJCF as native geometry, and frames over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import TruthState
from sim._kernels import Geometry, RayCaster

ZERO = (0.0, 0.0, 0.0)
GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # geom groups that mj_ray sees: below 3


def compiled(mjcf: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def visible(model: mujoco.MjModel, geom: int) -> bool:
    material = model.geom_matid[geom]
    alpha = model.mat_rgba[material, 3] if material >= 0 else model.geom_rgba[geom, 3]
    return bool(alpha > 0.0 and model.geom_group[geom] < 3)


def native(model: mujoco.MjModel, data: mujoco.MjData) -> Geometry:
    """Geoms of mocap bodies move, all others do not. No height fields."""
    made = Geometry()
    for k in range(model.nmesh):
        first, count = model.mesh_vertadr[k], model.mesh_vertnum[k]
        vertex = np.ascontiguousarray(model.mesh_vert[first : first + count], np.float32)
        first, count = model.mesh_faceadr[k], model.mesh_facenum[k]
        made.add_mesh(vertex, np.ascontiguousarray(model.mesh_face[first : first + count], np.int32), None, None)
    for g in range(model.ngeom):
        kind = int(model.geom_type[g])
        made.add_geom(
            kind,
            tuple(model.geom_size[g]),
            tuple(data.geom_xpos[g]),
            tuple(data.geom_xmat[g]),
            int(model.geom_dataid[g]) if kind == mujoco.mjtGeom.mjGEOM_MESH else -1,
            bool(model.body_mocapid[model.geom_bodyid[g]] >= 0),
            visible(model, g),
            0,
            0,
            0,
        )
    made.finish()
    return made


def cast(caster: Any, origins: Any, directions: Any, **options: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return range and geom of rays, by default from t = 0 to 1e6 m."""
    directions = np.ascontiguousarray(directions, float).reshape(-1, 3)
    range_m, geom = np.empty(len(directions)), np.empty(len(directions), np.int32)
    t_min, t_max = options.pop("t_min", 0.0), options.pop("t_max", 1e6)
    origins = np.ascontiguousarray(origins, float).reshape(-1, 3)
    caster.cast(origins, directions, t_min, t_max, range_m, geom, **options)
    return range_m, geom


def mujoco_rays(
    model: mujoco.MjModel, data: mujoco.MjData, origins: Any, directions: Any
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return range and geom by mj_ray."""
    directions = np.asarray(directions, float).reshape(-1, 3)
    origins = np.broadcast_to(np.asarray(origins, float).reshape(-1, 3), directions.shape)
    range_m, geom = np.empty(len(directions)), np.empty(len(directions), np.int32)
    met = np.zeros(1, np.int32)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        t = mujoco.mj_ray(model, data, o, d, GROUPS, True, -1, met)
        range_m[i], geom[i] = (t, met[0]) if met[0] >= 0 else (np.inf, -1)
    return range_m, geom


@dataclass(frozen=True)
class Reflecting:
    lidar_reflectivity: float


@dataclass
class World:
    geom_class: NDArray[np.uint8]
    geom_surface: NDArray[np.uint8]
    surfaces: tuple[Reflecting, ...]


@dataclass
class GeometryOf:
    native: Geometry
    world: World
    pose_all: Callable[[], None]

    def pose_within(self, reach: Any = None) -> None:
        self.pose_all()

    @property
    def caster(self) -> RayCaster:
        return RayCaster(self.native)


@dataclass
class ModelFrames:
    """A stand-in for `SharedFrames` over a model. Mover m is mocap body m, at `speed_mps[m]` from its place."""

    model: mujoco.MjModel
    data: mujoco.MjData
    reflectivity: dict[str, float] = field(default_factory=dict)  # by name of geom; 0.5 for all others
    speed_mps: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        n = self.model.ngeom
        names = [self.model.geom(g).name for g in range(n)]
        surfaces = tuple(Reflecting(self.reflectivity.get(name, 0.5)) for name in names)
        world = World((np.arange(n) % 200 + 1).astype(np.uint8), np.arange(n, dtype=np.uint8), surfaces)
        self.geometry: Any = GeometryOf(native(self.model, self.data), world, self._pose_all)
        self.class_names = ("none", *names)
        self.t_ns = 0
        self.posed: list[int] = []
        self._start = self.data.mocap_pos.copy()

    def expect(self, t_ns: int) -> None:
        self.t_ns = t_ns

    def _pose_all(self) -> None:
        t_ns = self.t_ns
        self.posed.append(t_ns)
        for m, speed in enumerate(self.speed_mps):
            self.data.mocap_pos[m] = self._start[m] + np.asarray(speed) * t_ns * 1e-9
        mujoco.mj_kinematics(self.model, self.data)
        moved = [g for g in range(self.model.ngeom) if self.model.body_mocapid[self.model.geom_bodyid[g]] >= 0]
        if moved and self.speed_mps:
            speeds = np.array(
                [self.speed_mps[self.model.body_mocapid[self.model.geom_bodyid[g]]] for g in moved], float
            )
            self.geometry.native.move(
                np.array(moved, np.int32),
                np.ascontiguousarray(self.data.geom_xpos[moved]),
                np.ascontiguousarray(self.data.geom_xmat[moved]).reshape(-1, 3, 3),
                speeds,
                np.zeros((len(moved), 3)),
            )

    def renderer(self, camera: Any, **options: Any) -> Any:
        raise NotImplementedError


def truth_at(t_ns: int, **changes: Any) -> TruthState:
    """Return the truth of a level vehicle at rest, 2 m above the origin."""
    return TruthState(0, t_ns, (0.0, 0.0, 2.0), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (), False)._replace(
        **changes
    )
