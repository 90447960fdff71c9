"""DDS types of ROS 2 messages, made from the definitions of the recording. Needs the package cyclonedds.

    sensor_msgs/Imu  ->  sensor_msgs::msg::dds_::Imu_     final, members numbered in order
    std_srvs/SetBool_Request  ->  std_srvs::srv::dds_::SetBool_Request_

as `rmw_cyclonedds_cpp` makes them, so that the type identifiers of XTypes are also the same.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cyclonedds.idl.types as idl
from cyclonedds.idl import make_idl_struct

from hil.run.recorder.mcap.cdr import fields

_PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "byte": idl.uint8,
    "int8": idl.int8,
    "uint8": idl.uint8,
    "int16": idl.int16,
    "uint16": idl.uint16,
    "int32": idl.int32,
    "uint32": idl.uint32,
    "int64": idl.int64,
    "uint64": idl.uint64,
    "float32": idl.float32,
    "float64": idl.float64,
    "string": str,
}


def dds_name(type_name: str) -> str:
    """Return the name of a type "package/Name" in DDS."""
    package, name = type_name.split("/")
    kind = "srv" if name.endswith(("_Request", "_Response")) else "msg"
    return f"{package}::{kind}::dds_::{name}_"


@cache
def dds_type(type_name: str) -> Any:
    """Return the class of the messages of a type "package/Name"."""
    return _message(type_name, {})


@cache
def service_type(type_name: str) -> Any:
    """Return the class of the requests or replies of a service, which begin with client and number of the request."""
    return _message(type_name, {"client": idl.uint64, "number": idl.int64})


def _message(type_name: str, members: dict[str, Any]) -> Any:
    """Return a class with these members and those of a type."""
    for field in fields(type_name):
        kind = _PRIMITIVES.get(field.type) or dds_type(field.type)
        if field.length == -1:
            kind = idl.sequence[kind]
        elif field.length is not None:
            kind = idl.array[kind, field.length]
        members[field.name] = kind
    return make_idl_struct(type_name.split("/")[1], dds_name(type_name).replace("::", "."), members)


def _struct(name: str, members: dict[str, Any]) -> Any:
    return make_idl_struct(name, f"rmw_dds_common.msg.dds_.{name}_", members)


# The graph of the nodes (rmw_dds_common): one message of each participant says which endpoints belong to which node.
Gid = _struct("Gid", {"data": idl.array[idl.uint8, 16]})
NodeEntitiesInfo = _struct(
    "NodeEntitiesInfo",
    {
        "node_namespace": idl.bounded_str[256],
        "node_name": idl.bounded_str[256],
        "reader_gid_seq": idl.sequence[Gid],
        "writer_gid_seq": idl.sequence[Gid],
    },
)
ParticipantEntitiesInfo = _struct(
    "ParticipantEntitiesInfo", {"gid": Gid, "node_entities_info_seq": idl.sequence[NodeEntitiesInfo]}
)
GRAPH_HASH = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"  # of ROS 2 Iron to Lyrical
