"""Repeats clients' messages in simulated time when the bench runs faster than real time.

An autopilot measures the age of a ground station's heartbeat or an OFFBOARD set-point in its own, simulated time. A
client sends by the wall clock: at 20 times real time its 20 Hz stream arrives at 1 Hz of simulated time, and PX4's
COM_OF_LOSS_T treats it as lost. So the last heartbeat of each client is repeated at 1 Hz of simulated time, and its
last set-point at the client's own rate: measured by the wall clock, applied to simulated time.

A copy is the client's own frame, sequence number included, sent to the autopilot only. Repetition ends when the client
has been silent for 2 s of wall clock; that of set-points also when their stream has ended (5 periods, at least 1 s and
at most 2 s). A set-point that was sent only once is not repeated. The autopilot therefore notices the loss of a client
up to 2 s x speed late in simulated time. The first copy waits a quarter of a period longer, so that nothing is repeated
where the originals come often enough: at real time, or slower.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.router.ports import Client
from signals.time import NS_PER_S

HEARTBEAT = MSGID["HEARTBEAT"]
SETPOINTS = frozenset(
    MSGID[name] for name in ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET")
)

_ALIVE_NS = 2 * NS_PER_S
_STREAM_MIN_NS = NS_PER_S
_STREAM_PERIODS = 5
_PERIOD_MIN_NS = 10_000_000
_ARRIVALS = 10  # kept to measure the rate
_SOURCES_LIMIT = 64


@dataclass
class _Source:
    """The last frames of one system of one client. Wall-clock times end in `_wall_ns`, the others are simulated."""

    client: Client
    heartbeat: Frame | None = None
    heartbeat_due_ns: int = 0
    setpoint: Frame | None = None
    setpoint_due_ns: int = 0
    arrivals_wall_ns: list[int] = field(default_factory=list)

    def period_ns(self) -> int:
        """Return the period of the set-points by the wall clock; 0 if there are too few for a stream."""
        arrivals = self.arrivals_wall_ns
        if len(arrivals) < 2:
            return 0
        return max((arrivals[-1] - arrivals[0]) // (len(arrivals) - 1), _PERIOD_MIN_NS)

    def stream_ended(self, wall_ns: int) -> bool:
        limit_ns = min(max(_STREAM_PERIODS * self.period_ns(), _STREAM_MIN_NS), _ALIVE_NS)
        return wall_ns - self.arrivals_wall_ns[-1] > limit_ns


class Hold:
    """The clients' streams. Call `add` for every frame that goes to the autopilot, `due` once per tick."""

    def __init__(self) -> None:
        self._sources: dict[tuple[int, int, int], _Source] = {}
        self.heartbeats = 0
        self.setpoints = 0

    def add(self, client: Client, frame: Frame, t_ns: int, wall_ns: int) -> None:
        msgid = frame.msgid
        if msgid != HEARTBEAT and msgid not in SETPOINTS:
            return
        key = (id(client), frame.sysid, frame.compid)
        source = self._sources.get(key)
        if source is None:
            if len(self._sources) >= _SOURCES_LIMIT:
                return
            source = self._sources[key] = _Source(client)
        if msgid == HEARTBEAT:
            source.heartbeat = frame
            source.heartbeat_due_ns = t_ns + NS_PER_S * 5 // 4
            return
        arrivals = source.arrivals_wall_ns
        if arrivals and wall_ns - arrivals[-1] > _ALIVE_NS:
            arrivals.clear()  # a new stream
        arrivals.append(wall_ns)
        del arrivals[:-_ARRIVALS]
        source.setpoint = frame
        source.setpoint_due_ns = t_ns + source.period_ns() * 5 // 4

    def due(self, t_ns: int, wall_ns: int) -> list[Frame]:
        """Return the copies to send now."""
        copies: list[Frame] = []
        dead: list[tuple[int, int, int]] = []
        for key, source in self._sources.items():
            if wall_ns - source.client.last_frame_ns > _ALIVE_NS:
                dead.append(key)
                continue
            if source.heartbeat is not None and t_ns >= source.heartbeat_due_ns:
                source.heartbeat_due_ns = t_ns + NS_PER_S
                copies.append(source.heartbeat)
                self.heartbeats += 1
            if source.setpoint is None or t_ns < source.setpoint_due_ns:
                continue
            period_ns = source.period_ns()
            if not period_ns:
                continue
            if source.stream_ended(wall_ns):
                source.setpoint = None
                source.arrivals_wall_ns.clear()
                continue
            # Counted from the due time, so that there is no drift if no tick falls on it.
            source.setpoint_due_ns += period_ns * ((t_ns - source.setpoint_due_ns) // period_ns + 1)
            copies.append(source.setpoint)
            self.setpoints += 1
        for key in dead:
            del self._sources[key]
        return copies
