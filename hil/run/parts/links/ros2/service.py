"""A service of ROS 2 on DDS, for clients with `rmw_cyclonedds_cpp`.

    service /arm    DDS topics rq/armRequest and rr/armReply, types std_srvs::srv::dds_::SetBool_Request_, ..._Response_
    message         client (uint64) and number (int64), then the fields; the reply repeats client and number

`rmw_fastrtps_cpp` keeps client and number outside the message, in an inline QoS that CycloneDDS neither shows nor
sends: ROS 2 has no services between the two. `OtherNodes` tells of such a client; topics command the vehicle, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from hil.run.live.encoders import padded
from hil.run.parts.links.ros2.dds_types import service_type
from hil.run.parts.links.ros2.node import Node


class Request(NamedTuple):
    """One request. `reply` sends the answer, given by field."""

    message: Any
    reply: Callable[..., None]


class Service:
    """The server of one service."""

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        """`type_name`: "package/Name"."""
        self.name = name
        self._node = node
        self._response = service_type(f"{type_name}_Response")
        self._requests, self._replies = node.service_endpoints(name, type_name)

    def take(self, refuse: Callable[[ValueError], None]) -> Iterator[Request]:
        """Return the requests since the last call. `refuse` is called for one whose texts are not UTF-8."""
        for message in self._requests.take(refuse):
            yield Request(message, partial(self._send, message))

    def _send(self, request: Any, /, **fields: Any) -> None:
        data = bytes(self._response(client=request.client, number=request.number, **fields).serialize())
        self._node.sender.send([(self._replies.ref, self.name, padded(data, 4))])
