"""Boxes of a scene's people and vehicles for Foxglove's 3-D panel.

/scene/boxes   foxglove.SceneUpdate: the tight upright box of each, a line to its front, and its class

The boxes are those of data sets (sim/frame/object_box.py), at the run's own time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hil.run.parts.links.foxglove.server import LiveServer
from hil.run.recorder.mcap.topics import WORLD
from sim.frame.object_box import ObjectBox, tight_boxes
from sim.frame.object_shapes import ObjectShapes

BOXES = "/scene/boxes"
_EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4))  # of ObjectBox.corners_W
_TEXT_PX = 12.0


class BoxView:
    """Boxes of one run."""

    def __init__(self, server: LiveServer, world: Any) -> None:
        """`world`: sim.scene.world.World without the drones."""
        self._server, self._world = server, world
        moving = world.geom_instance[(world.geom_actor >= 0) & world.geom_visible]
        self._instances: list[int] = np.unique(moving).tolist()
        self._shapes: ObjectShapes | None = None  # made for the first client that asks
        if self._instances:
            server.declare_typed(BOXES, "SceneUpdate")

    def update(self, t_ns: int) -> None:
        """Send the boxes at `t_ns`; only if there are any."""
        if self._shapes is None:
            self._shapes = ObjectShapes(self._world)
        objects = [self._shapes.posed(instance, t_ns) for instance in self._instances]
        boxes = tight_boxes(self._shapes, objects)
        entities = [
            self._entity(instance, box) for instance, box in zip(self._instances, boxes, strict=True) if box is not None
        ]
        self._server.log(BOXES, self._server.sdk.messages.SceneUpdate(entities=entities), t_ns)

    def _entity(self, instance: int, box: ObjectBox) -> Any:
        m, world = self._server.sdk.messages, self._world
        geom = int(np.argmax(world.geom_instance == instance))
        class_id = int(world.geom_class[geom])
        red, green, blue = (value / 255.0 for value in world.class_colours[class_id])
        colour = m.Color(r=red, g=green, b=blue, a=1.0)
        corners = box.corners_W
        ends = [corners[i] for edge in _EDGES for i in edge]
        ends += [box.centre_W, box.centre_W + 0.5 * box.size_m[0] * box.axes_W[0]]
        still = m.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        line = m.LinePrimitive(
            type=m.LinePrimitiveLineType.LineList,
            pose=m.Pose(position=m.Vector3(x=0.0, y=0.0, z=0.0), orientation=still),
            thickness=2.0,
            scale_invariant=True,
            points=[m.Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in ends],
            color=colour,
        )
        x, y, z = (box.centre_W + 0.5 * box.size_m[2] * box.axes_W[2]).tolist()
        text = m.TextPrimitive(
            pose=m.Pose(position=m.Vector3(x=x, y=y, z=z), orientation=still),
            billboard=True,
            font_size=_TEXT_PX,
            scale_invariant=True,
            color=colour,
            text=world.class_names[class_id],
        )
        return m.SceneEntity(frame_id=WORLD, id=world.instance_names[instance], lines=[line], texts=[text])
