"""Types of a map: an MJCF text with its files, the classes and surfaces of its parts, and its actors.

A map comes from a generator with parameters and a seed, or from the user's own MJCF file with patterns for its classes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from signals.samples import Quat, Vec3

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Optical and radar properties of one MJCF material."""

    lidar_reflectivity: float  # 0..1 at 905 nm, Lambertian
    relative_permittivity: float  # real part, 60 GHz
    conductivity_s_per_m: float  # 60 GHz
    roughness_m: float  # rms height
    retroreflection: float = 0.0  # R_A of EN 12899-1, head on [cd / (lx m2)]; 0: none


@dataclass(frozen=True)
class CornerReflector:
    """Three static square plates at right angles. Their inner faces span the axes of frame K from its origin.

    A radar's pictures hold single bounces only; the echo of three bounces is computed from these values
    (sim/radar/corner_echoes.py).
    """

    p_WK: Vec3  # [m], where the plates meet
    q_WK: Quat
    edge_m: float
    class_name: str


class Actor(Protocol):
    """Moving object, a pure function of time.

    Its mocap bodies are named `<name>_<limb>`. Velocities are the exact time derivatives of the poses: `v_WB_W` of the
    body's origin, `w_WB_W` the angular velocity, both in W.
    """

    @property
    def name(self) -> str: ...

    @property
    def bodies(self) -> tuple[str, ...]: ...

    @property
    def max_speed_mps(self) -> float:
        """Greatest speed of the centre of `bound` at any time."""
        ...

    def bound(self, t_ns: int) -> tuple[Vec3, float]:
        """Return centre [m, W] and radius [m] of a sphere that encloses the actor at `t_ns`."""
        ...

    def pose(self, t_ns: int, p_WB: Float64, q_WB: Float64, v_WB_W: Float64, w_WB_W: Float64) -> None:
        """Fill poses and velocities in the order of `bodies`: (n, 3), (n, 4) w-x-y-z, (n, 3), (n, 3)."""
        ...


def actor_pose(actor: Actor, t_ns: int) -> tuple[Float64, Float64, Float64, Float64]:
    """Return what `Actor.pose` fills, p_WB, q_WB, v_WB_W and w_WB_W, in new arrays."""
    n = len(actor.bodies)
    pose = np.empty((n, 3)), np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
    actor.pose(t_ns, *pose)
    return pose


@dataclass(frozen=True)
class SceneMap:
    """Map as data. Solid geoms have contype = conaffinity = 1; geoms that are only visible have 0."""

    mjcf: str  # static geoms and actors (mocap bodies, one per limb); no vehicle; world ENU, ground around z = 0
    assets: Mapping[str, bytes]  # files that the MJCF names
    classes: Mapping[str, tuple[str, ...]]  # class -> patterns of names of bodies, and of geoms of the worldbody
    surfaces: Mapping[str, Surface]  # MJCF material name -> Surface
    actors: tuple[Actor, ...]
    corners: tuple[CornerReflector, ...] = ()  # of plates in the MJCF
    notes: tuple[str, ...] = ()  # what an imported map leaves out or simplifies
    from_file: bool = False  # it holds what a user's file describes, and compiles in a process with limits
