"""A client of the bench: says hello, receives frames, answers them.

    with Client.connect("tcp://bench:5570", name="slam", topics=["front/*", "imu"]) as client:
        for frame in client.frames():
            client.done(frame, Desired(p_W=(0, 0, 2)))

The bench sends a frame only to a client that has a credit; `hello` gives the first ones, `done` gives one back. In
lockstep the bench waits for `done`. A frame that is still unanswered when the next one is asked for is answered with
nothing desired.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections import deque
from typing import Any, Iterator, Mapping, Sequence

import zmq

from hil_companion import protocol
from hil_companion.barrier import Barrier
from hil_companion.checks import Fields
from hil_companion.connection import BYE_LINGER_MS, Connection, Keys, PathLike
from hil_companion.desired import Desired
from hil_companion.detections import Detections
from hil_companion.errors import (
    BadMessage,
    CompanionError,
    ConnectionLost,
    CutError,
    NoBench,
    OptionError,
    Refused,
    SchemaChanged,
)
from hil_companion.frame import Frame, RingView, can_map, read_samples
from hil_companion.protocol import End, Welcome, checked_report
from hil_companion.view import View

PING_EVERY_S = 1.0
PONGS_KEPT = 16
MAX_BAD_IN_A_ROW = 10
MAX_MESSAGE_BYTES = 256 << 20
DEFAULT_WAIT_S = 30.0
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}\Z")


class Client:
    """A connected client; made by `Client.connect`."""

    welcome: Welcome
    end: End | None  # what the bench said when it ended

    @classmethod
    def connect(
        cls,
        address: str,
        *,
        name: str,
        topics: Sequence[str] = ("*",),
        control: bool = False,
        hold: bool = False,
        credit: int = 1,
        shared_memory: bool = True,
        schema: str | None = None,
        key: PathLike | None = None,
        bench_key: PathLike | None = None,
        wait_s: float = DEFAULT_WAIT_S,
        max_message_bytes: int = MAX_MESSAGE_BYTES,
        context: zmq.Context[Any] | None = None,
    ) -> Client:
        """Say hello and wait for the welcome. OptionError, NoBench, WrongKeys, Refused, SchemaChanged.

        `hold`: everything desired is flown as it stands (`Desired.hold`).
        """
        if not _NAME.match(name):
            raise OptionError(f"name {name!r}: 1 to 64 of letters, digits, _ . - are needed")
        if type(credit) is not int or not 1 <= credit <= protocol.MAX_CREDIT:
            raise OptionError(f"credit {credit!r}: 1 to {protocol.MAX_CREDIT} is needed")
        if isinstance(topics, str) or not topics or not all(isinstance(t, str) and 0 < len(t) <= 128 for t in topics):
            raise OptionError(f"topics {topics!r}: a list of patterns is needed, such as ['front/*', 'imu']")
        if (key is None) != (bench_key is None):
            raise OptionError("a key needs the bench's public key, and the other way round: give both or neither")
        keys = None if key is None or bench_key is None else Keys(key, bench_key)
        self = cls(context, keys, max_message_bytes)
        self._hold = hold
        self._hello = {"name": name, "topics": list(topics), "control": control, "credit": credit}
        try:
            self._join(address, schema, shared_memory and can_map(), wait_s)
        except BaseException:
            self.close()
            raise
        return self

    def __init__(self, context: zmq.Context[Any] | None, keys: Keys | None, max_message_bytes: int) -> None:
        self.end = None
        self.clock = BenchClock()
        self.barrier = Barrier()
        self.malformed = 0  # messages of the bench that could not be used
        self._own_context = context is None
        self._context = zmq.Context() if context is None else context
        self._keys = keys
        self._max_message_bytes = max_message_bytes
        self._connections: list[Connection] = []  # the first is the one that speaks
        self._poller = zmq.Poller()
        self._hello: dict[str, Any] = {}
        self._hold = False
        self._ring: RingView | None = None
        self._ready: deque[Frame] = deque()
        self._unanswered: deque[Frame] = deque()
        self._bad_in_a_row = 0
        self._pings = 0
        self._next_ping_s = 0.0
        self._last_t2_ns = 0
        self._closed = False

    # --- connecting ---

    def _join(self, address: str, schema: str | None, shared_memory: bool, wait_s: float) -> None:
        """Say hello until there is a welcome, and then to each port."""
        speaking = self._open(address)
        known = {"magic": protocol.MAGIC, "version": protocol.VERSION, **self._hello}
        greeting = protocol.message("hello", schema=schema, shared_memory=shared_memory, **known)
        speaking.send(greeting)
        greeted = max(1, speaking.handshakes)
        deadline_s = time.monotonic() + wait_s
        while True:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise NoBench(_nobody(speaking, wait_s))
            self._poller.poll(math.ceil(min(left_s, 3600.0) * 1000))
            header = self._first_answer(speaking)
            if header is not None:
                break
            speaking.watch()
            if speaking.handshakes > greeted:  # it came back before it had answered: the hello went with it
                greeted = speaking.handshakes
                speaking.send(greeting)
        self.welcome = protocol.read_welcome(header)
        if self._hello["control"] and not self.welcome.control:
            raise Refused("control", "the bench takes no commands from this client")
        if self.welcome.ring is not None:
            self._ring = RingView(self.welcome.ring)
        # Each port learns by a hello of its own who is at the other end.
        known.update(schema=self.welcome.schema, session=self.welcome.session, shared_memory=False)
        greeting = protocol.message("hello", **known)
        for port in sorted(set(self.welcome.ports.values())):
            self._open(reachable(port, address)).send(greeting)

    def _open(self, address: str) -> Connection:
        connection = Connection(self._context, address, self._keys, self._max_message_bytes)
        self._connections.append(connection)
        self._poller.register(connection.socket, zmq.POLLIN)
        self._poller.register(connection.monitor, zmq.POLLIN)
        return connection

    def _first_answer(self, speaking: Connection) -> protocol.Header | None:
        parts = speaking.receive()
        if parts is None:
            return None
        try:
            header = protocol.unpack(parts[0].buffer)
            if header["k"] == "welcome":
                return header
            if header["k"] == "refused":
                raise _refused(header)
        except BadMessage as error:
            raise NoBench(f"{speaking.address}: what answers there is no bench ({error})") from error
        return None  # a late word to a client before us

    # --- receiving ---

    def frames(self, timeout_s: float = math.inf) -> Iterator[Frame]:
        """Frames until the bench ends (`end` then says how). ConnectionLost, Refused, BadMessage; also ConnectionLost
        where no frame comes within the time given."""
        while True:
            frame = self.receive(timeout_s)
            if frame is None and self.end is None:
                raise ConnectionLost(f"{self._address}: no frame within {timeout_s:g} s")
            if frame is None:
                return
            yield frame
            while self._unanswered and self._unanswered[0].frame <= frame.frame:
                self.done(self._unanswered[0])

    def receive(self, timeout_s: float = math.inf) -> Frame | None:
        """The next frame; None where none came in time, or the bench ended."""
        deadline_s = time.monotonic() + timeout_s
        while not self._ready and self.end is None:
            now_s = time.monotonic()
            if now_s >= self._next_ping_s:
                self.ping()
            if self._drain() == 0:
                if now_s >= deadline_s:
                    return None
                self._poller.poll(math.ceil(1000 * max(0.0, min(deadline_s, self._next_ping_s) - now_s)))
        if not self._ready:
            return None
        frame = self._ready.popleft()
        if self.clock.round_trip_ns is not None and self._last_t2_ns:
            frame.latency_ns = self.clock.round_trip_ns + self._last_t2_ns
        self._unanswered.append(frame)
        return frame

    def _drain(self) -> int:
        """Take in what is there; how many messages that were. A loss counts only once nothing is left to read."""
        taken = 0
        for connection in self._connections:
            parts = connection.receive()
            while parts is not None:
                taken += 1
                self._take(parts)
                parts = connection.receive() if self.end is None else None
        if taken == 0:
            for connection in self._connections:
                if connection.watch():
                    raise ConnectionLost(f"{connection.address}: the connection was lost")
        return taken

    def _take(self, parts: Sequence[Any]) -> None:
        t_received_ns = time.monotonic_ns()
        header: protocol.Header = {}
        try:
            header = protocol.unpack(parts[0].buffer)
            self._dispatch(header, parts, t_received_ns)
        except BadMessage as error:
            self.malformed += 1
            self._bad_in_a_row += 1
            if self._bad_in_a_row >= MAX_BAD_IN_A_ROW:
                text = f"{self._address}: {MAX_BAD_IN_A_ROW} unusable messages in a row; the last: {error}"
                raise BadMessage(text) from error
            if header.get("k") == "frame":
                self.give_credit()  # it cost one, and will never be answered
        else:
            self._bad_in_a_row = 0

    def _dispatch(self, header: protocol.Header, parts: Sequence[Any], t_received_ns: int) -> None:
        kind = header["k"]
        if kind == "frame":
            samples = read_samples(header, parts, self._ring)
            topics = protocol.ports_of_frame(header)
            part = Frame(header, samples, in_ring=self._ring is not None, t_received_ns=t_received_ns)
            frame, lost = self.barrier.add(part, topics)
            if lost:
                self.give_credit(lost)
            if frame is not None:
                self._ready.append(frame)
        elif kind == "pong":
            self.clock.add(header, t_received_ns)
        elif kind == "end":
            self.end = protocol.read_end(header)
        elif kind == "refused":
            raise _refused(header)
        elif kind != "welcome":  # the ports answer their hello with one
            raise BadMessage(f"a message of kind {kind[:40]!r}")

    # --- answering ---

    def done(
        self,
        frame: Frame,
        desired: Desired | None = None,
        *,
        t2_ns: int = 0,
        finished: bool = False,
        report: Mapping[str, Any] | None = None,
        detections: Detections | None = None,
    ) -> None:
        """Answer a frame. Its views into the ring, and those only, are invalid from here on. `report`: names and
        texts, numbers or booleans that the bench is to note of this client; it takes the place of the one before.
        `detections`: what was made out in a picture of this frame."""
        if desired is not None and not isinstance(desired, Desired):
            raise CutError(f"a CUT returns a Desired or None, not {type(desired).__name__}")
        if desired is not None and not self.welcome.control:
            raise CutError("a desired state from a client without control: connect with control=True (--control)")
        if detections is not None and not isinstance(detections, Detections):
            raise CutError(f"detections of a CUT are a Detections or None, not {type(detections).__name__}")
        if frame not in self._unanswered:
            raise CompanionError(f"frame {frame.frame} has been answered before")
        self._unanswered.remove(frame)
        self._last_t2_ns = t2_ns
        answer: dict[str, Any] = {"frame": frame.frame, "t_received_ns": frame.t_received_ns, "t2_ns": t2_ns}
        answer.update(desired=None if desired is None else desired.as_map(), finished=finished)
        if desired is not None and self._hold:
            answer["desired"]["hold"] = True
        if report is not None:
            answer["report"] = checked_report(report)
        if detections is not None:
            answer["detections"] = detections.as_map()
        self._say("done", t_sent_ns=time.monotonic_ns(), **answer)

    def show(self, frame: Frame, view: View) -> None:
        """Let people see this; it decides nothing. A bench that wants none (`welcome.views_every_ns` 0) gets none."""
        if not isinstance(view, View):
            raise CutError(f"a CUT shows a View or None, not {type(view).__name__}")
        if self.welcome.views_every_ns > 0:
            self._say("view", frame=frame.frame, t_ns=frame.t_ns, **view.as_map())

    def give_credit(self, n: int = 1) -> None:
        """Let the bench send more frames ahead of the answers."""
        self._say("credit", n=n)

    def ping(self) -> None:
        """Ask for the bench's clock; the answer goes into `clock`. Done every second by itself."""
        self._next_ping_s = time.monotonic() + PING_EVERY_S
        self._pings += 1
        clock, known = self.clock, {}
        if clock.round_trip_ns is not None:
            known = {"bench_minus_client_ns": clock.bench_minus_client_ns, "round_trip_ns": clock.round_trip_ns}
        self._say("ping", id=self._pings, t_client_ns=time.monotonic_ns(), **known)

    def _say(self, kind: str, **entries: Any) -> None:
        self._connections[0].send(protocol.message(kind, **entries))

    # --- leaving ---

    def close(self, reason: str = "done") -> None:
        """Say bye and let go of the sockets."""
        if self._closed:
            return
        self._closed = True
        if self.end is None and self._connections:
            with contextlib.suppress(ConnectionLost):  # nobody may be there to hear it
                self._say("bye", reason=reason[:200])
        for connection in self._connections:
            connection.close(BYE_LINGER_MS)
        if self._own_context:
            self._context.term()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self.close("done" if kind is None else kind.__name__)

    @property
    def _address(self) -> str:
        return self._connections[0].address


class BenchClock:
    """The bench's clock as seen from here, from pings: offset and round trip, None before the first answer.

    With client times t0 (ping sent) and t3 (pong received) and bench times t1, t2 in between, the round trip is
    (t3 - t0) - (t2 - t1), and the offset bench - client is ((t1 - t0) + (t2 - t3)) / 2, wrong by at most half the round
    trip. The shortest of the last few round trips is believed.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[int, int]] = deque(maxlen=PONGS_KEPT)  # round trip, offset

    def add(self, pong: protocol.Header, t_received_ns: int) -> None:
        """BadMessage."""
        at = Fields(pong, "pong")
        t0, t1, t2 = (at.integer(f"t_{name}_ns") for name in ("client", "bench_received", "bench_sent"))
        round_trip_ns, there_ns, back_ns = (t_received_ns - t0) - (t2 - t1), t1 - t0, t2 - t_received_ns
        if round_trip_ns >= 0:  # below 0: an answer that no clock can have given
            self._seen.append((round_trip_ns, (there_ns + back_ns) // 2))

    @property
    def round_trip_ns(self) -> int | None:
        return min(self._seen)[0] if self._seen else None

    @property
    def bench_minus_client_ns(self) -> int | None:
        return min(self._seen)[1] if self._seen else None


def reachable(port: str, address: str) -> str:
    """A port's address as this client can reach it: a bench that listens everywhere is at the host we know it by."""
    match = re.match(r"tcp://(?:\*|0\.0\.0\.0|\[::\]):(\d+)\Z", port)
    known = re.match(r"tcp://(.*):\d+\Z", address)
    return f"tcp://{known.group(1)}:{match.group(1)}" if match and known else port


def _refused(header: protocol.Header) -> Refused:
    at = Fields(header, "refused")
    code, text = at.text("code", 40), at.text("text")
    return SchemaChanged(text) if code == "schema" else Refused(code, text)


def _nobody(speaking: Connection, wait_s: float) -> str:
    if speaking.handshakes:
        return f"{speaking.address}: somebody listens there, but did not answer as a bench within {wait_s:g} s"
    return (
        f"{speaking.address}: no bench there within {wait_s:g} s; is `hil run` up, with a companion, at this address?"
    )
