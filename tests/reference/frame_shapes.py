"""A scene with every kind of geom, turned and overlapping, to hold renderers against the reference."""

from __future__ import annotations

import mujoco
import numpy as np

_KINDS = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh")


def shapes_mjcf(seed: int, *, count: int = 40, hfield: bool = True) -> str:
    """MJCF of `count` random geoms on 20 x 20 m over a plane, a third of them mocap bodies, and a height field."""
    random = np.random.Generator(np.random.Philox(seed))
    parts = []
    for i in range(count):
        kind = _KINDS[i % len(_KINDS)]
        size = random.uniform(0.2, 1.2, 3)
        position = random.uniform((-10, -10, 0.2), (10, 10, 6))
        turn = random.normal(size=4)
        shape = 'mesh="wedge"' if kind == "mesh" else f'size="{_text(size[: _SIZES[kind]])}"'
        colour = _text([*random.uniform(0.1, 1.0, 3), 1.0])
        mocap = ' mocap="true"' if i % 3 == 0 else ""
        parts.append(
            f'<body name="thing_{i:02d}" pos="{_text(position)}" quat="{_text(turn)}"{mocap}>'
            f'<geom name="thing_{i:02d}" type="{kind}" {shape} rgba="{colour}" contype="0" conaffinity="0"/></body>'
        )
    parts.append('<body name="hidden"><geom type="sphere" size="3" pos="0 0 3" group="3"/></body>')
    parts.append('<body name="clear"><geom type="sphere" size="3" pos="0 0 3" rgba="1 0 0 0"/></body>')
    heights = _text(np.round(random.uniform(0.0, 1.0, 63), 3))
    field = f'<hfield name="hill" nrow="7" ncol="9" size="4 3 2 0.5" elevation="{heights}"/>' if hfield else ""
    hill = '<body name="hill" pos="9 6 0.2"><geom type="hfield" hfield="hill"/></body>' if hfield else ""
    wedge = _text(np.array([[0, 0, 0], [1.4, 0, 0], [0, 1.0, 0], [0, 0, 1.2], [1.0, 0.8, 0.3]]).ravel())
    return (
        f'<mujoco><asset><mesh name="wedge" vertex="{wedge}"/>{field}</asset>'
        '<visual><global offwidth="1280" offheight="720"/></visual>'
        '<worldbody><light pos="0 0 50" dir="0 0 -1" directional="true"/>'
        f'<geom name="ground" type="plane" size="30 30 1"/>{"".join(parts)}{hill}</worldbody></mujoco>'
    )


_SIZES = {"sphere": 1, "box": 3, "capsule": 2, "cylinder": 2, "ellipsoid": 3}


def posed(model: mujoco.MjModel) -> mujoco.MjData:
    """Data with all geoms where the model puts them."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def _text(values: object) -> str:
    return " ".join(f"{value:.6g}" for value in np.asarray(values, float).ravel())
