"""Finds endpoints of other nodes that share a topic's name with this node and can never match it.

DDS connects a publisher and a subscription of the same topic only if their types are equal, and if the publisher is
reliable wherever the subscription is. Otherwise nothing is sent, and nobody is told.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy

from hil.run.parts.links.ros2.dds_types import dds_name

_TOPIC, _REQUEST = "rt", ("rq", "Request")  # before the name of a topic; around that of a service
_FAST_DDS = bytes((0x01, 0x0F))  # vendor, at the begin of the id of each of its endpoints
_MOST = 100  # endpoints of one look


def _readable(name: str) -> str:
    """Return "package/Name" of "package::msg::dds_::Name_"."""
    return name.replace("::msg::dds_::", "/").removesuffix("_")


class OtherNodes:
    """Watches publishers and subscriptions of all nodes."""

    def __init__(
        self,
        participant: DomainParticipant,
        published: Mapping[str, Sequence[str]],
        subscribed: Mapping[str, Sequence[str]],
        services: Collection[str] = (),
    ) -> None:
        """`published`, `subscribed`: of this node, the types ("package/Name") by topic. `services`: its services."""
        self._services = frozenset(services)
        self._told: set[str] = set()
        self._sides = (
            (BuiltinDataReader(participant, BuiltinTopicDcpsPublication), subscribed, "publishes", "takes"),
            (BuiltinDataReader(participant, BuiltinTopicDcpsSubscription), published, "subscribes to", "publishes"),
        )

    def mismatches(self) -> Iterator[str]:
        """Return a text for each new mismatch."""
        for reader, own, does, ours in self._sides:
            for endpoint in reader.take(_MOST):
                if endpoint.topic_name is None or not endpoint.sample_info.valid_data:
                    continue
                name = endpoint.topic_name.removeprefix(_TOPIC)
                types = own.get(name)
                text = ""
                if types is None:
                    text = self._foreign_client(endpoint.topic_name, endpoint.key.bytes)
                elif endpoint.type_name not in map(dds_name, types):
                    text = (
                        f"a node {does} {name} as {_readable(endpoint.type_name)}, and this one {ours} "
                        f"{' and '.join(types)}: nothing is exchanged"
                    )
                elif does == "publishes" and _is_best_effort(endpoint):
                    text = (
                        f"a node publishes {name} as best effort, and this one takes it reliably: nothing is "
                        "exchanged; publish it with the default profile"
                    )
                if text and text not in self._told:
                    self._told.add(text)
                    yield text

    def _foreign_client(self, dds_topic: str, key: bytes) -> str:
        before, after = _REQUEST
        name = dds_topic.removeprefix(before).removesuffix(after)
        if name not in self._services or not dds_topic.startswith(before) or not key.startswith(_FAST_DDS):
            return ""
        return (
            f"a client of the service {name} uses Fast DDS, which gets no answer from CycloneDDS: start that node with "
            "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp, or publish the topics /cmd_arm, /cmd_takeoff, /cmd_land, /cmd_mode"
        )


def _is_best_effort(endpoint: Any) -> bool:
    return endpoint.qos[Policy.Reliability] in (None, Policy.Reliability.BestEffort)
