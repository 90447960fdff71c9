"""What a map is: an MJCF text with its files, the meaning of its parts, and what moves in it.

A generator makes one from parameters and a seed; any MJCF file with a few globs makes one too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hil.signals.samples import Quat, Vec3

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Optical and radar properties of one MJCF material."""

    lidar_reflectivity: float  # 0..1 at 905 nm, Lambertian
    relative_permittivity: float  # real part, 60 GHz
    conductivity_s_per_m: float  # 60 GHz
    roughness_m: float  # rms height


@dataclass(frozen=True)
class CornerReflector:
    """Three square plates at right angles that stand still. Their inner faces span the axes of frame K from its origin.

    A radar's pictures know single bounces only; what comes back after three follows from this
    (sim/radar/corner_echoes.py).
    """

    p_WK: Vec3  # [m], where the plates meet
    q_WK: Quat
    edge_m: float
    class_name: str


class Actor(Protocol):
    """Something that moves by itself: a pure function of time.

    Its mocap bodies are named `<name>_<limb>`. Velocities are the exact time derivatives of the poses: `v_WB_W` of the
    body's origin, `w_WB_W` the angular velocity, both in W.
    """

    @property
    def name(self) -> str: ...

    @property
    def bodies(self) -> tuple[str, ...]: ...

    @property
    def max_speed_mps(self) -> float:
        """Greatest speed that the centre of `bound` ever has."""
        ...

    def bound(self, t_ns: int) -> tuple[Vec3, float]:
        """Centre [m, W] and radius [m] of a sphere that holds all of it at `t_ns`."""
        ...

    def pose(self, t_ns: int, p_WB: Float64, q_WB: Float64, v_WB_W: Float64, w_WB_W: Float64) -> None:
        """Fills (n, 3), (n, 4) w-x-y-z, (n, 3) and (n, 3), in the order of `bodies`."""
        ...


@dataclass(frozen=True)
class SceneMap:
    """A map as data. Solid geoms have contype = conaffinity = 1; geoms that are only looked at have 0."""

    mjcf: str  # static geoms and actors (mocap bodies, one per limb); no vehicle; world ENU, ground around z = 0
    assets: Mapping[str, bytes]  # files that the MJCF names
    classes: Mapping[str, tuple[str, ...]]  # class -> globs over bodies of the world and geoms on the worldbody
    surfaces: Mapping[str, Surface]  # MJCF material name -> Surface
    actors: tuple[Actor, ...]
    corners: tuple[CornerReflector, ...] = ()  # among what the MJCF holds
