"""A ROS 2 node without ROS: a DDS participant whose endpoints have the names, types and QoS of ROS 2 Jazzy.

    topic /imu          DDS topic rt/imu, type sensor_msgs::msg::dds_::Imu_, XCDR1 little-endian
    USER_DATA           of an endpoint "typehash=RIHS01_...;", of the participant "enclave=/;"
    ros_discovery_info  which endpoints belong to the node, for `ros2 node list` and `ros2 topic info`

Messages are sent as the CDR bytes that they are, without Python objects for their fields.
"""

from __future__ import annotations

import os
import socket
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from cyclonedds.core import DDSException, Listener
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from hil.run.parts.links.ros2.dds_ports import MAX_PARTICIPANTS, has_free_port, receive_on
from hil.run.parts.links.ros2.dds_types import (
    GRAPH_HASH,
    Gid,
    NodeEntitiesInfo,
    ParticipantEntitiesInfo,
    dds_type,
    service_type,
)
from hil.run.parts.links.ros2.sender import Sender
from hil.run.parts.links.ros2.type_hash import type_hash
from signals.errors import HilError

_BUSY = (
    "ros2.domain {domain} has no free ports: other programs have all "
    f"{MAX_PARTICIPANTS} of this machine; end some, or take another domain"
)
LOOPBACK = "lo"
_MOST_TAKEN = 64  # messages of one subscription in one tick
_UNBLOCKED = duration(milliseconds=100)
# On the loopback interface there is no multicast, so participants are looked for at the ports of this machine. The
# limit of unacknowledged data is high: a history of a few messages bounds them, and a writer never waits for a reader.
# Heartbeats ask for acknowledgements at once.
_CONFIG = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface name="{interface}"/></Interfaces>{general}</General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{most}</MaxAutoParticipantIndex>
<SPDPInterval>1s</SPDPInterval>{peers}</Discovery>
<Internal><HeartbeatInterval min="1ms" minsched="1ms">2ms</HeartbeatInterval>
<Watermarks><WhcHigh>1GB</WhcHigh></Watermarks></Internal>
<Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"""
_LOOPBACK_GENERAL = (
    "<AllowMulticast>false</AllowMulticast><MaxMessageSize>65000B</MaxMessageSize><FragmentSize>63000B</FragmentSize>"
)
_LOOPBACK_PEERS = '<Peers><Peer address="127.0.0.1"/></Peers>'


class Ros2Error(HilError):
    """The connection to the ROS 2 graph broke, or a subscriber that is waited for is missing."""


class Profile(NamedTuple):
    """QoS of an endpoint in the terms of ROS 2. `depth` 0: keep all."""

    depth: int = 10
    reliable: bool = True
    transient_local: bool = False


DEFAULT = Profile()  # rmw_qos_profile_default: subscriptions with the sensors' profile (best effort) match it too
CLOCK_PROFILE = Profile(1, reliable=False)  # rclcpp::ClockQoS
TF = Profile(100)  # tf2_ros::DynamicBroadcasterQoS
LATCHED = Profile(1, transient_local=True)  # what later subscribers get too
TF_STATIC = Profile(100, transient_local=True)  # tf2_ros::StaticBroadcasterQoS, one message for each sensor
WAITED_FOR = Profile(0)


def _qos(profile: Profile, user_data: str) -> Qos:
    """Return QoS of an endpoint. `user_data`: "key=value", as `_hashed` makes it."""
    history = Policy.History.KeepLast(profile.depth) if profile.depth else Policy.History.KeepAll
    policies = [
        Policy.Reliability.Reliable(_UNBLOCKED) if profile.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if profile.transient_local else Policy.Durability.Volatile,
        history,
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.Userdata(f"{user_data};".encode()),
    ]
    if profile.transient_local:
        policies.append(Policy.DurabilityService(0, history, -1, -1, -1))
    return Qos(*policies)


def _hashed(type_name: str) -> str:
    return f"typehash={type_hash(type_name)}"


class _Domains:
    """The DDS domains of this process: a domain is made once and shared by the nodes of all vehicles."""

    def __init__(self) -> None:
        self._domains: dict[int, tuple[Domain, str | None, int]] = {}
        self.unconfined: dict[int, str] = {}  # why other machines reach the ports of a domain on loopback
        self.clock_ns: dict[int, int] = {}  # newest time that a node of this process has sent, by domain

    def enter(self, number: int, interface: str | None) -> None:
        """Make the domain, or share it. Raises Ros2Error."""
        domain, used, users = self._domains.get(number, (None, interface, 0))
        if interface != used:
            raise Ros2Error(
                f"ros2.interface: another vehicle of this run has domain {number} on {used}, this one on {interface}; "
                "take one interface, or another domain"
            )
        if domain is None:
            config = os.environ.get("CYCLONEDDS_URI") if interface is None else _config(interface)
            try:
                domain = Domain(number, config)
            except DDSException as error:
                if not has_free_port(number):
                    raise Ros2Error(_BUSY.format(domain=number)) from error
                where = "as CYCLONEDDS_URI says" if interface is None else f"on the interface {interface}"
                raise Ros2Error(f"ros2.domain {number} cannot be opened {where}: {error}") from error
            if interface == LOOPBACK:
                try:
                    receive_on(LOOPBACK, number)
                except OSError as error:
                    self.unconfined[number] = error.strerror or str(error)
        self._domains[number] = (domain, interface, users + 1)

    def leave(self, number: int) -> None:
        """Give back the domain; the last user ends it."""
        domain, interface, users = self._domains[number]
        if users > 1:
            self._domains[number] = (domain, interface, users - 1)
            return
        del self._domains[number]
        self.clock_ns.pop(number, None)
        self.unconfined.pop(number, None)
        domain.__del__()


def _config(interface: str) -> str:
    names = [name for _, name in socket.if_nameindex()]
    if interface not in names:
        known = ", ".join(names)
        raise Ros2Error(f"ros2.interface: this machine has no network interface {interface!r} (it has {known})")
    loopback = interface == LOOPBACK
    return _CONFIG.format(
        interface=interface,
        general=_LOOPBACK_GENERAL if loopback else "",
        peers=_LOOPBACK_PEERS if loopback else "",
        most=MAX_PARTICIPANTS - 1,
    )


_DOMAINS = _Domains()


class Publisher:
    """A publisher of one topic. A `Sender` sends its messages: CDR bytes of a multiple of 4."""

    def __init__(self, node: Node, name: str, dds_topic: Topic[Any], qos: Qos) -> None:
        self.name = name
        self.subscribers = 0  # that match now; set by a thread of the DDS library
        listener = Listener(on_publication_matched=self._matched)
        self._writer = DataWriter(node.participant, dds_topic, qos, listener)
        self.ref = self._writer._ref
        self.gid = self._writer.get_guid().bytes

    def _matched(self, writer: Any, status: Any) -> None:  # noqa: ARG002 (the signature of a listener)
        self.subscribers = int(status.current_count)

    def has_reliable_subscriber(self) -> bool:
        """Return True if one of the subscriptions acknowledges what it has received."""
        for handle in self._matched_subscriptions():
            endpoint = self._writer.get_matched_subscription_data(handle)
            if endpoint is not None and endpoint.qos[Policy.Reliability] not in (None, Policy.Reliability.BestEffort):
                return True
        return False

    def _matched_subscriptions(self) -> Sequence[Any]:
        while True:
            try:
                return self._writer.get_matched_subscriptions()
            except IndexError:  # one more has come since the library counted them (cyclonedds 11.0)
                continue

    def acknowledged(self, limit_s: float) -> bool:
        """Wait until all reliable subscribers have everything that was written. Return False past the limit."""
        result = self._writer._wait_for_acks(self.ref, duration(seconds=limit_s))
        if result not in (DDSException.DDS_RETCODE_OK, DDSException.DDS_RETCODE_TIMEOUT):
            raise Ros2Error(f"{self.name}: no acknowledgement can be waited for ({DDSException(result)})")
        return bool(result == DDSException.DDS_RETCODE_OK)


class Subscription:
    """A subscription of one topic."""

    def __init__(self, node: Node, name: str, dds_topic: Topic[Any], qos: Qos) -> None:
        self.name = name
        self._has_more = False  # set by a thread of the DDS library once a message can be taken
        listener = Listener(on_data_available=self._arrived)
        self._reader = DataReader(node.participant, dds_topic, qos, listener)
        self.ref = self._reader._ref
        self.gid = self._reader.get_guid().bytes

    def take(self, refuse: Callable[[ValueError], None]) -> Iterator[Any]:
        """Return the messages since the last call. `refuse` is called for one whose texts are not UTF-8."""
        if not self._has_more:
            return
        for _ in range(_MOST_TAKEN):
            self._has_more = False
            try:
                taken = self._reader.take()
            except UnicodeDecodeError as error:
                refuse(error)
                continue
            if not taken:
                return
            if taken[0].sample_info.valid_data:
                yield taken[0]
        self._has_more = True

    def _arrived(self, reader: Any) -> None:  # noqa: ARG002 (the signature of a listener)
        self._has_more = True


class Node:
    """One node with its publishers and subscriptions."""

    def __init__(self, domain: int, interface: str | None, *, name: str = "hil", namespace: str = "/") -> None:
        """Join a domain. Raises Ros2Error."""
        self._domain, self._name, self._namespace = domain, name, namespace
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []
        _DOMAINS.enter(domain, interface)
        try:
            self.participant = DomainParticipant(domain, Qos(Policy.Userdata(b"enclave=/;"), Policy.EntityName("/")))
        except DDSException as error:
            _DOMAINS.leave(domain)
            raise Ros2Error(f"ros2.domain {domain} cannot be joined: {error}") from error
        self._open = True
        self.unconfined = _DOMAINS.unconfined.get(domain, "")  # why other machines reach its ports, on loopback
        self.sender = Sender()
        graph = Topic(self.participant, "ros_discovery_info", ParticipantEntitiesInfo)
        self._graph = DataWriter(self.participant, graph, _qos(LATCHED, f"typehash={GRAPH_HASH}"))

    def publisher(self, name: str, type_name: str, profile: Profile = DEFAULT) -> Publisher:
        """Add a publisher."""
        topic = Topic(self.participant, f"rt{name}", dds_type(type_name))
        self._publishers.append(Publisher(self, name, topic, _qos(profile, _hashed(type_name))))
        return self._publishers[-1]

    def subscription(self, name: str, type_name: str) -> Subscription:
        """Add a subscription."""
        topic = Topic(self.participant, f"rt{name}", dds_type(type_name))
        self._subscriptions.append(Subscription(self, name, topic, _qos(DEFAULT, _hashed(type_name))))
        return self._subscriptions[-1]

    def service_endpoints(self, name: str, type_name: str) -> tuple[Subscription, Publisher]:
        """Add the endpoints of a server, which rmw_cyclonedds_cpp finds together by a common "serviceid"."""
        qos = _qos(DEFAULT, "serviceid=" + ".".join(f"{byte:x}" for byte in uuid.uuid4().bytes))
        request = Topic(self.participant, f"rq{name}Request", service_type(f"{type_name}_Request"))
        reply = Topic(self.participant, f"rr{name}Reply", service_type(f"{type_name}_Response"))
        self._subscriptions.append(Subscription(self, name, request, qos))
        self._publishers.append(Publisher(self, name, reply, qos))
        return self._subscriptions[-1], self._publishers[-1]

    def is_first_at(self, t_ns: int) -> bool:
        """Return True for the first node of this process that asks about a time: it sends `/clock`."""
        if _DOMAINS.clock_ns.get(self._domain, -1) >= t_ns:
            return False
        _DOMAINS.clock_ns[self._domain] = t_ns
        return True

    def announce(self) -> None:
        """Tell the other nodes which endpoints this node has."""
        gid = Gid(data=list(self.participant.get_guid().bytes))
        endpoints: list[Sequence[Publisher | Subscription]] = [self._subscriptions, self._publishers]
        readers, writers = ([Gid(data=list(end.gid)) for end in ends] for ends in endpoints)
        node = NodeEntitiesInfo(
            node_namespace=self._namespace, node_name=self._name, reader_gid_seq=readers, writer_gid_seq=writers
        )
        self._graph.write(ParticipantEntitiesInfo(gid=gid, node_entities_info_seq=[node]))

    def close(self) -> None:
        """Leave the graph."""
        if not self._open:
            return
        self._open = False
        self.sender.close()
        self._publishers.clear()
        self._subscriptions.clear()
        self.participant.__del__()
        _DOMAINS.leave(self._domain)


def wait_until(condition: Callable[[], bool], limit_s: float) -> bool:
    """Wait for a condition, at most `limit_s` of wall-clock time. Return it."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() >= end_s:
            return False
        time.sleep(0.005)
    return True
