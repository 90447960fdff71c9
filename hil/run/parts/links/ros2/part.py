"""The section `ros2`: the run as a node of a ROS 2 graph, without ROS. Needs the extra ros2.

The messages of a tick are sent while the autopilot computes its answer. A topic without a subscriber is not encoded.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from functools import partial
from importlib import import_module
from typing import Any

from hil.config import Bench
from hil.run.live.encoders import padded
from hil.run.live.messages import CLOCK, LiveMessages, LiveTopic, Names, live_topics
from hil.run.loop.scheduler import CommandSource
from hil.run.offboard import PilotedPart, is_out_of_time, offboard_pilot, why_unflown, why_unlanded
from hil.run.part import Part, RunContext
from hil.run.parts.links.ros2.set_points import Frames, desired_pose, desired_velocity
from hil.run.recorder.mcap.topics import BODY, MAP, ODOM, WORLD
from hil.run.verdict.verdict import Verdict
from signals.desired import DesiredState
from signals.documents.validate import nearest
from signals.errors import ConfigError, Problem
from signals.latency import LatencyHistogram
from signals.samples import Sample, TruthState

INSTALL = "pip install 'hil-bench[ros2]'"
_LOOK_TICKS = 25  # between two looks for new subscribers
_SLICE_S = 0.25  # of a wait, so that it ends soon after a subscriber is lost
_STALE_S = 1.0  # simulated time without a set-point after which the vehicle holds its position


class Ros2Part(PilotedPart):
    name = "ros2"
    free_running = False
    _run: RunContext  # from `open` on
    _live: LiveMessages  # from `build` on

    def __init__(self, bench: Bench, topics: Sequence[LiveTopic]) -> None:
        self._bench, self._topics = bench, tuple(topics)
        self._settings = bench.config.ros2
        self._names = Names(bench.config.name)
        self._node: Any = None
        self._publishers: dict[str, Any] = {}
        self._always: frozenset[str] = frozenset()  # topics that are sent to nobody too: late subscribers get them
        self._awaited: list[Any] = []  # publishers whose subscribers are waited for
        self._selected: set[str] = set()
        self._reasons: list[str] = []
        self._subscriptions: list[tuple[Any, Callable[[Any, TruthState], DesiredState]]] = []
        self._commands: Any = None  # services; with `control`
        self._others: Any = None  # the endpoints of other nodes
        self._counts: dict[str, int] = {}
        self._set_points = self._refused = 0
        self._cost, self._waits = LatencyHistogram(), LatencyHistogram()  # processor time of a tick; wall clock
        self._cost_ns = 0

    # -- life cycle -----------------------------------------------------------------------------------------------

    def open(self, run: RunContext) -> None:
        from hil.run.parts.links.ros2 import node as ros2
        from hil.run.parts.links.ros2.other_nodes import OtherNodes

        self._run = run
        settings = self._settings
        assert settings.domain is not None
        vehicle = self._bench.config.name
        self._node = ros2.Node(
            settings.domain, settings.interface, name="hil", namespace=f"/{vehicle}" if vehicle else "/"
        )
        profiles = {CLOCK: ros2.CLOCK_PROFILE, "/tf": ros2.TF, "/tf_static": ros2.TF_STATIC}
        for topic in self._topics:
            waits = topic.name in settings.wait_for
            profile = ros2.WAITED_FOR if waits else profiles.get(topic.name, ros2.DEFAULT)
            self._publishers[topic.name] = self._node.publisher(topic.name, topic.type_name, profile)
        self._always = frozenset((*settings.wait_for, "/tf_static")) & self._publishers.keys()
        self._awaited = [self._publishers[name] for name in settings.wait_for]
        description = self._names.topic("/robot_description")
        self._publishers[description] = self._node.publisher(description, "std_msgs/String", ros2.LATCHED)
        if settings.tf == "map" and "/tf_static" not in self._publishers:
            self._publishers["/tf_static"] = self._node.publisher("/tf_static", "tf2_msgs/TFMessage", ros2.TF_STATIC)
        subscribed = self._subscribe() if settings.control else {}
        services = self._commands.services if self._commands is not None else ()
        published = {topic.name: [topic.type_name] for topic in self._topics}
        self._others = OtherNodes(self._node.participant, published, subscribed, services)
        self._node.announce()

    def _subscribe(self) -> dict[str, list[str]]:
        """Subscribe to set-points and offer the services. Return the types by topic."""
        from hil.run.parts.links.ros2.commands import VehicleCommands

        frames = _frames(self._names, self._settings.tf)
        types: dict[str, list[str]] = {}

        def stamped(message: Any, truth: TruthState) -> DesiredState:
            return desired_velocity(message.twist, message.header.frame_id, truth, frames)

        for path, type_name, convert in (
            ("/cmd_vel", "geometry_msgs/TwistStamped", stamped),
            ("/cmd_vel", "geometry_msgs/Twist", lambda message, truth: desired_velocity(message, "", truth, frames)),
            ("/cmd_pose", "geometry_msgs/PoseStamped", lambda message, truth: desired_pose(message, frames)),  # noqa: ARG005
            ("/cmd_land", "std_msgs/Empty", lambda message, truth: DesiredState(land=True)),  # noqa: ARG005
        ):
            name = self._names.topic(path)
            types.setdefault(name, []).append(type_name)
            self._subscriptions.append((self._node.subscription(name, type_name), convert))
        self._commands = VehicleCommands(
            self._node,
            self._names,
            self._settings.takeoff_height_m,
            lambda why: self._warn(f"a command was not carried out: {why}"),
        )
        return types | self._commands.types

    def watched_ports(self) -> frozenset[str]:
        return frozenset(topic.port for topic in self._topics if topic.port)

    def build(self, run: RunContext) -> None:
        config = self._bench.config
        self._live = LiveMessages(
            config.tick_ns,
            descriptions=run.sensors.descriptions,
            deviations=run.sensors.deviations,
            tf=self._settings.tf,
            vehicle=config.name,
            selected=self._selected,
            pad_to=4,
        )
        if self._settings.control:
            self._pilot = offboard_pilot(self._bench, run, setpoint_hz=self._settings.setpoint_hz, stale_s=_STALE_S)

    def begin(self, run: RunContext) -> None:
        if self._node.unconfined:
            run.say(
                "ros2",
                "warning: other machines reach the UDP ports of this node, because this system does not confine them "
                f"to the loopback interface ({self._node.unconfined}); use a firewall",
            )
        if self._awaited:
            run.say("ros2", f"waiting for subscribers of {', '.join(self._settings.wait_for)}")
            for publisher in self._awaited:
                self._await_subscriber(publisher)
        self._send(self._once(run))
        self._look()

    def _once(self, run: RunContext) -> list[tuple[int, str, bytes]]:
        """Return the messages that are sent once: the vehicle's description, and the fixed frames above `odom`."""
        from hil.run.parts.links.ros2.fixed_messages import identities, text
        from hil.run.parts.links.ros2.robot_description import robot_description

        name = self._names.topic("/robot_description")
        urdf = robot_description(self._bench.vehicle, run.sensors.descriptions, self._names.frame)
        messages = {name: text(urdf)}
        if self._settings.tf == "map":
            messages["/tf_static"] = identities(WORLD, MAP, self._names.frame(ODOM))
        return [(self._publishers[name].ref, name, padded(data, 4)) for name, data in messages.items()]

    def _await_subscriber(self, publisher: Any) -> None:
        from hil.run.parts.links.ros2.node import Ros2Error, wait_until

        limit_s = self._settings.wait_timeout_s
        if not wait_until(publisher.has_reliable_subscriber, limit_s):
            why = "is best effort: it acknowledges nothing" if publisher.subscribers else "did not come"
            raise Ros2Error(
                f"ros2.wait_for: a reliable subscriber of {publisher.name} is waited for, and it {why} "
                f"(ros2.wait_timeout_s is {limit_s:g})"
            )

    def command_sources(self) -> list[CommandSource]:
        return [] if self._pilot is None else [self._pilot, self._commands.commands]

    def exchange(self) -> Ros2Part:
        return self

    def close(self) -> None:
        if self._node is not None:
            self._node.close()

    def conclude(self, run: RunContext) -> None:
        """Tell of nodes in control that never flew, or never landed without a mission, goal or search."""
        pilot = self._pilot
        if pilot is None:
            return
        reasons = [why_unflown(pilot, self._bench, "ROS 2 node")]
        if is_out_of_time(run):
            reasons.append(why_unlanded(pilot, self._bench, "ROS 2 node", "let it send /cmd_land"))
        for reason in filter(None, reasons):
            if run.stopped_by_hand:  # before they came, perhaps
                run.say("warning", reason)
            else:
                self._reasons.append(reason)

    def verdict(self) -> Verdict:
        return Verdict(reasons=self._reasons)

    def repeatable(self) -> bool:
        return self._set_points == 0 and (self._commands is None or self._commands.requested == 0)

    def run_keys(self) -> dict[str, Any]:
        cost = self._cost
        return {
            "ros2": {
                "domain": self._settings.domain,
                "topics": {name: self._counts.get(name, 0) for name in sorted(self._publishers)},
                "set_points": self._set_points,
                "set_points_refused": self._refused,
                "commands": 0 if self._commands is None else self._commands.requested,
                "tick_us": {
                    "mean": self._cost_ns / 1000 / max(cost.count, 1),
                    "p50": cost.quantile_ns(0.5) / 1000,
                    "p99": cost.quantile_ns(0.99) / 1000,
                },
                "wait_ms": self._waits.quantile_ns(0.5) / 1e6 if self._waits.count else None,
            }
        }

    # -- every tick -----------------------------------------------------------------------------------------------

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:
        """Send the messages of a tick, and take the set-points that have come."""
        began_ns = time.thread_time_ns()
        run, live = self._run, self._live
        if truth.tick % _LOOK_TICKS == 0:
            self._look()
        counts, publishers = self._counts, self._publishers
        batch = []
        for topic, _, data in live.of_tick(truth, released, run.scheduler.actuators, run.physics.battery):
            name = topic.name
            if name not in publishers or (name == CLOCK and not self._node.is_first_at(truth.t_ns)):
                continue  # /tf_static comes unasked; one vehicle sends the clock of all
            batch.append((publishers[name].ref, name, bytes(data)))
            counts[name] = counts.get(name, 0) + 1
        if batch:
            self._send(batch)
        for subscription, convert in self._subscriptions:
            refuse = partial(self._refuse, subscription.name)
            for message in subscription.take(refuse):
                try:
                    desired = convert(message, truth)
                except ValueError as error:
                    refuse(error)
                    continue
                if desired.land or not self._commands.climbing:
                    self._set_point(subscription.name, desired, truth)
        if self._commands is not None:
            self._carry_out(truth)
        cost_ns = time.thread_time_ns() - began_ns
        self._cost.add(cost_ns)
        self._cost_ns += cost_ns
        awaited = [publisher for publisher in self._awaited if any(publisher.name == name for _, name, _ in batch)]
        if awaited:
            wait_began_ns = time.perf_counter_ns()
            self._node.sender.drain()
            for publisher in awaited:
                self._await_receipt(publisher)
            self._waits.add(time.perf_counter_ns() - wait_began_ns)

    def _carry_out(self, truth: TruthState) -> None:
        """Answer requests of the services."""
        assert self._pilot is not None
        before = self._commands.requested
        desired = list(self._commands.take(truth, self._pilot, partial(self._refuse, "the commands")))
        if before == 0 < self._commands.requested:
            self._run.event("ros2", "first command: the flight has an input from outside")
        for each in desired:
            self._set_point("the commands", each, truth)

    def _send(self, batch: list[tuple[int, str, bytes]]) -> None:
        sender = self._node.sender
        if sender.failed is not None:
            from hil.run.parts.links.ros2.node import Ros2Error

            raise Ros2Error(f"ros2: a message of {sender.failed} could not be sent")
        sender.send(batch)

    def serve(self, limit_s: float) -> None:
        """Do nothing: messages are exchanged once a tick."""

    def _look(self) -> None:
        """Select the topics that have subscribers."""
        self._selected.clear()
        self._selected |= self._always
        self._selected.update(name for name, publisher in self._publishers.items() if publisher.subscribers)
        for text in self._others.mismatches():
            self._warn(text)

    def _warn(self, text: str) -> None:
        self._run.event("warning", f"ros2: {text}")

    def _await_receipt(self, publisher: Any) -> None:
        from hil.run.parts.links.ros2.node import Ros2Error

        limit_s = self._settings.wait_timeout_s
        end_s = time.monotonic() + limit_s
        while not publisher.acknowledged(_SLICE_S):
            if time.monotonic() >= end_s:
                raise Ros2Error(
                    f"ros2.wait_for: the subscriber of {publisher.name} has not received a message for {limit_s:g} s "
                    "of wall-clock time (ros2.wait_timeout_s); is it stopped?"
                )
        if not publisher.subscribers:
            raise Ros2Error(f"ros2.wait_for: the subscriber of {publisher.name} is gone, and every message is for it")

    def _refuse(self, name: str, error: ValueError) -> None:
        self._refused += 1
        if self._refused == 1:
            self._warn(f"a set-point of {name} is refused, and so may be others: {error}")

    def _set_point(self, name: str, desired: DesiredState, truth: TruthState) -> None:
        run, pilot = self._run, self._pilot
        assert pilot is not None
        self._set_points += 1
        if self._set_points == 1:
            run.event("ros2", f"first set-point, of {name}: the flight has an input from outside")
        t_apply_ns = truth.t_ns + self._bench.config.tick_ns
        for part in run.parts:
            part.on_desired(desired, t_apply_ns)
        pilot.set_desired(desired, t_apply_ns)


def _frames(names: Names, tf: str) -> Frames:
    """Return the frames of set-points. A frame that another node places (`Ros2.tf`) is none of them."""
    placed = {"odom": (ODOM,), "none": ()}.get(tf, (MAP, ODOM))
    return Frames(names.frame(BODY), tuple(dict.fromkeys((WORLD, *placed, *map(names.frame, placed)))))


def _problems(bench: Bench, known: Sequence[str]) -> list[Problem]:
    problems = []
    settings = bench.config.ros2
    for package, module in (("cyclonedds", "cyclonedds.core"), ("rosbags", "rosbags.typesys")):
        try:
            import_module(module)
        except ImportError as error:
            problems.append(Problem("ros2", f"needs the package {package}, which is not installed ({error})", INSTALL))
    for name in settings.wait_for:
        if name not in known:
            problems.append(Problem("ros2.wait_for", f"names an unknown topic: {name!r}", nearest(name, known)))
    for pattern in settings.topics:
        if not any(fnmatchcase(name, pattern) for name in known):
            hint = nearest(pattern, known) or f"topics: {', '.join(known)}"
            problems.append(Problem("ros2.topics", f"fits no topic: {pattern!r}", hint))
    return problems


def make(bench: Bench) -> Part:
    """Return the part. Raises ConfigError for an unknown topic, or without a package that it needs."""
    settings = bench.config.ros2
    topics = live_topics(bench, settings.tf)
    problems = _problems(bench, [topic.name for topic in topics])
    if problems:
        raise ConfigError(problems)
    patterns = (*settings.topics, *settings.wait_for)
    return Ros2Part(bench, [topic for topic in topics if any(fnmatchcase(topic.name, p) for p in patterns)])
