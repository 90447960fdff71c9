"""A small map for tests: one named geom of every shape that can be hit, and a person who walks to and fro."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from signals.samples import Vec3
from sim.scene.scene import Scene, load_scene
from sim.scene.scene_map import SceneMap

TETRAHEDRON = "v 1 1 1\nv -1 -1 1\nv -1 1 -1\nv 1 -1 -1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"

YARD = """<mujoco model="yard">
<asset>
  <material name="stone" rgba="0.6 0.6 0.6 1"/>
  <material name="steel" rgba="0.6 0.6 0.7 1"/>
  <material name="unseen" rgba="1 0 0 0"/>
  <mesh name="rock" vertex="1 1 1  -1 -1 1  -1 1 -1  1 -1 -1"/>
  <hfield name="hill" nrow="9" ncol="9" size="4 4 2 0.5" elevation="{heights}"/>
</asset>
<worldbody>
  <geom name="floor" type="plane" size="50 50 1" material="stone"/>
  <geom name="hump" type="hfield" hfield="hill" pos="-12 0 -0.2" material="stone"/>
  <body name="wall_0" pos="6 0 0" quat="0.9238795325112867 0 0 0.3826834323650898">
    <geom type="box" size="0.1 3 3" pos="0 0 3" material="steel"/>
  </body>
  <body name="tree_0" pos="0 8 0">
    <geom name="trunk" type="cylinder" size="0.2 2" pos="0 0 2"/>
    <body name="crown_0" pos="0 0 4"><geom type="ellipsoid" size="1.5 1.2 1"/></body>
    <geom type="box" size="9 9 9" contype="0" conaffinity="0" group="4"/>
  </body>
  <body name="pole_0" pos="0 -8 0"><geom type="capsule" size="0.1 2" pos="0 0 2"/></body>
  <body name="ball_0" pos="-3 -8 3"><geom type="sphere" size="0.7"/></body>
  <body name="rock_0" pos="8 -8 2"><geom type="mesh" mesh="rock"/></body>
  <body name="leaf_0" pos="3 3 2"><geom type="box" size="2 2 2" contype="0" conaffinity="0"/></body>
  <body name="ghost_0" pos="-8 -8 2"><geom type="box" size="1 1 1" material="unseen"/></body>
{more}
</worldbody>
</mujoco>
""".replace(
    "{heights}", " ".join(str(max(0, 4 - abs(i - 4)) * max(0, 4 - abs(j - 4))) for i in range(9) for j in range(9))
)

PERSON = """
  <body name="person_00_body" mocap="true"><geom type="capsule" size="0.25 0.5"/></body>
  <body name="person_00_head" mocap="true"><geom type="sphere" size="0.15"/></body>
"""


class Pacer:
    """A walk along x at 1 m/s, back and forth between x0 - 2 and x0 + 2."""

    name = "person_00"
    bodies = ("person_00_body", "person_00_head")

    def __init__(self, x0: float = 0.0, y0: float = 0.0, *, max_speed_mps: float = 1.0) -> None:
        self._x0, self._y0 = x0, y0
        self.posed = 0
        self.max_speed_mps = max_speed_mps

    def _x(self, t_ns: int) -> float:
        phase = t_ns % 8_000_000_000 / 1e9
        return self._x0 + (phase - 2.0 if phase < 4.0 else 6.0 - phase)

    def bound(self, t_ns: int) -> tuple[Vec3, float]:
        return (self._x(t_ns), self._y0, 0.95), 1.0

    def pose(self, t_ns: int, p_WB: Any, q_WB: Any, v_WB_W: Any, w_WB_W: Any) -> None:
        self.posed += 1
        p_WB[:] = ((self._x(t_ns), self._y0, 0.75), (self._x(t_ns), self._y0, 1.65))
        q_WB[:] = (1.0, 0.0, 0.0, 0.0)
        v_WB_W[:] = ((1.0 if t_ns % 8_000_000_000 < 4_000_000_000 else -1.0), 0.0, 0.0)
        w_WB_W[:] = 0.0


def yard(folder: Path, **section: Any) -> Scene:
    """Return the yard as a user's own MJCF file."""
    path = folder / "yard.xml"
    path.write_text(YARD.replace("{more}", ""))
    plain = load_scene("airfield").model_dump()
    return Scene.model_validate(plain | {"name": "yard", "map": {"mjcf": str(path), **section}})


def yard_map(actor: Pacer) -> SceneMap:
    """Return the yard as from a generator, with a person in it."""
    return SceneMap(YARD.replace("{more}", PERSON), {}, {"person": ("person_*",)}, {}, (actor,))
