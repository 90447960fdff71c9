"""Messages that a node sends once, as CDR bytes. Needs the package cyclonedds."""

from __future__ import annotations

from itertools import pairwise

from hil.run.parts.links.ros2.dds_types import dds_type


def text(data: str) -> bytes:
    """Return a std_msgs/String."""
    return bytes(dds_type("std_msgs/String")(data=data).serialize())


def identities(*frames: str) -> bytes:
    """Return a tf2_msgs/TFMessage in which each frame is the child of the one before, and the same as it."""
    stamp = dds_type("builtin_interfaces/Time")(sec=0, nanosec=0)
    same = dds_type("geometry_msgs/Transform")(
        translation=dds_type("geometry_msgs/Vector3")(x=0.0, y=0.0, z=0.0),
        rotation=dds_type("geometry_msgs/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
    )
    transforms = [
        dds_type("geometry_msgs/TransformStamped")(
            header=dds_type("std_msgs/Header")(stamp=stamp, frame_id=parent), child_frame_id=child, transform=same
        )
        for parent, child in pairwise(frames)
    ]
    return bytes(dds_type("tf2_msgs/TFMessage")(transforms=transforms).serialize())
