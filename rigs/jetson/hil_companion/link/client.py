"""A client session with the bench: connects, receives frames, answers them.

    with Client.connect("tcp://bench:5570", name="slam", topics=["front/*", "imu"]) as client:
        for frame in client.frames():
            client.done(frame, Desired(p_W=(0, 0, 2)))

The bench sends a frame only to a client that has a credit: `hello` grants the first ones and every `done` returns one.
In lockstep the bench waits for `done`. A frame that the caller has not answered when it takes the next one is answered
without a desired state.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections import deque
from typing import Any, Iterator, Mapping, Sequence

import zmq

from hil_companion.desired import Desired
from hil_companion.detections import Detections
from hil_companion.errors import (
    BadMessage,
    CompanionError,
    ConnectionLost,
    CutError,
    NoBench,
    Refused,
    SchemaChanged,
)
from hil_companion.frame import Frame, RingView, can_map, read_samples
from hil_companion.link import protocol
from hil_companion.link.barrier import Barrier
from hil_companion.link.bench_clock import BenchClock
from hil_companion.link.checks import Fields
from hil_companion.link.connection import BYE_LINGER_MS, Connection
from hil_companion.link.options import ClientOptions
from hil_companion.link.protocol import End, Welcome, checked_report
from hil_companion.view import View

PING_EVERY_S = 1.0
MAX_BAD_IN_A_ROW = 10


class Client:
    """A connected client; made by `Client.connect`."""

    welcome: Welcome
    end: End | None  # the bench's status and text when it ended; None while it runs

    @classmethod
    def connect(
        cls,
        address: str,
        *,
        name: str,
        schema: str | None = None,
        context: zmq.Context[Any] | None = None,
        **options: Any,
    ) -> Client:
        """Say hello and wait for the welcome. Raises OptionError, NoBench, WrongKeys, Refused, SchemaChanged.

        `options`: the fields of `ClientOptions`. `schema`: the schema of an earlier session; if the bench's schema
        differs now, SchemaChanged is raised.
        """
        self = cls(ClientOptions(name=name, **options), context)
        try:
            self._join(address, schema)
        except BaseException:
            self.close()
            raise
        return self

    def __init__(self, options: ClientOptions, context: zmq.Context[Any] | None) -> None:
        self._keys = options.keys()
        self._options = options
        self.end = None
        self.clock = BenchClock()
        self.barrier = Barrier()
        self.malformed = 0  # messages from the bench that could not be used
        self._own_context = context is None
        self._context = zmq.Context() if context is None else context
        self._connections: list[Connection] = []  # the first carries this client's messages
        self._poller = zmq.Poller()
        self._ring: RingView | None = None
        self._ready: deque[Frame] = deque()
        self._unanswered: deque[Frame] = deque()
        self._bad_in_a_row = 0
        self._pings = 0
        self._next_ping_s = 0.0
        self._last_t2_ns = 0
        self._closed = False

    # --- connecting ---

    def _join(self, address: str, schema: str | None) -> None:
        """Say hello until the welcome comes, then say hello to each further port."""
        options = self._options
        connection = self._open(address)
        entries: dict[str, Any] = {
            "magic": protocol.MAGIC,
            "version": protocol.VERSION,
            "name": options.name,
            "topics": list(options.topics),
            "control": options.control,
            "credit": options.credit,
        }
        shared_memory = options.shared_memory and can_map()
        hello = protocol.message("hello", schema=schema, shared_memory=shared_memory, **entries)
        connection.send(hello)
        hello_handshakes = max(1, connection.handshakes)  # handshakes at the last hello
        deadline_s = time.monotonic() + options.wait_s
        while True:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise NoBench(_no_answer(connection, options.wait_s))
            self._poller.poll(math.ceil(min(left_s, 3600.0) * 1000))
            header = self._first_answer(connection)
            if header is not None:
                break
            connection.watch()
            if connection.handshakes > hello_handshakes:  # the bench restarted before it answered; the hello is lost
                hello_handshakes = connection.handshakes
                connection.send(hello)
        self.welcome = protocol.read_welcome(header)
        if options.control and not self.welcome.control:
            raise Refused("control", "the bench takes no commands from this client")
        if self.welcome.ring is not None:
            self._ring = RingView(self.welcome.ring)
        # The bench assigns each port's connection to this client by a hello of its own.
        entries.update(schema=self.welcome.schema, session=self.welcome.session, shared_memory=False)
        hello = protocol.message("hello", **entries)
        for port in sorted(set(self.welcome.ports.values())):
            self._open(reachable(port, address)).send(hello)

    def _open(self, address: str) -> Connection:
        connection = Connection(self._context, address, self._keys, self._options.max_message_bytes)
        self._connections.append(connection)
        self._poller.register(connection.socket, zmq.POLLIN)
        self._poller.register(connection.monitor, zmq.POLLIN)
        return connection

    def _first_answer(self, connection: Connection) -> protocol.Header | None:
        """Return the welcome, None if it has not come yet. Raises Refused, NoBench."""
        parts = connection.receive()
        if parts is None:
            return None
        try:
            header = protocol.unpack(parts[0].buffer)
            if header["k"] == "welcome":
                return header
            if header["k"] == "refused":
                raise _refused(header)
        except BadMessage as error:
            raise NoBench(f"{connection.address}: the program that answers there is not a bench ({error})") from error
        return None  # a late message to an earlier client

    # --- receiving ---

    def frames(self, timeout_s: float = math.inf) -> Iterator[Frame]:
        """Yield frames until the bench ends; `end` then holds its status.

        Raises ConnectionLost (also if no frame comes within `timeout_s`), Refused, BadMessage.
        """
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
        """Return the next frame; None if none came in time, or the bench ended."""
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
        """Read all messages that have arrived and return their number.

        A lost connection is reported only once nothing is left to read. Raises ConnectionLost.
        """
        count = 0
        for connection in self._connections:
            parts = connection.receive()
            while parts is not None:
                count += 1
                self._handle(parts)
                parts = connection.receive() if self.end is None else None
        if count == 0:
            for connection in self._connections:
                if connection.watch():
                    raise ConnectionLost(f"{connection.address}: the connection was lost")
        return count

    def _handle(self, parts: Sequence[Any]) -> None:
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
                self.give_credit()  # the frame used a credit and will never be answered
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
        elif kind != "welcome":  # each port answers its hello with one
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
        """Answer a frame. Its views into the shared ring are invalid afterwards, its other arrays stay valid.

        `t2_ns`: the CUT's computing time. `report`: names with texts, numbers or booleans that the bench records for
        this client in place of the previous report. `detections`: boxes and objects of a picture in this frame.
        Raises CutError, CompanionError, ConnectionLost.
        """
        if desired is not None and not isinstance(desired, Desired):
            raise CutError(f"a CUT returns a Desired or None, not {type(desired).__name__}")
        if desired is not None and not self.welcome.control:
            message = "a desired state from a client without control: connect with control=True (--control)"
            raise CutError(f"{message}, or give the CUT the attribute control = True")
        if detections is not None and not isinstance(detections, Detections):
            raise CutError(f"detections of a CUT are a Detections or None, not {type(detections).__name__}")
        if frame not in self._unanswered:
            raise CompanionError(f"frame {frame.frame} has been answered before")
        self._unanswered.remove(frame)
        self._last_t2_ns = t2_ns
        answer: dict[str, Any] = {"frame": frame.frame, "t_received_ns": frame.t_received_ns, "t2_ns": t2_ns}
        answer.update(desired=None if desired is None else desired.as_map(), finished=finished)
        if desired is not None and self._options.hold:
            answer["desired"]["hold"] = True
        if report is not None:
            answer["report"] = checked_report(report)
        if detections is not None:
            answer["detections"] = detections.as_map()
        self._send("done", t_sent_ns=time.monotonic_ns(), **answer)

    def show(self, frame: Frame, view: View) -> None:
        """Send a view for display and replay, unless `welcome.views_every_ns` is 0: then the bench wants none."""
        if not isinstance(view, View):
            raise CutError(f"a CUT shows a View or None, not {type(view).__name__}")
        if self.welcome.views_every_ns > 0:
            self._send("view", frame=frame.frame, t_ns=frame.t_ns, **view.as_map())

    def give_credit(self, n: int = 1) -> None:
        """Allow the bench to send `n` more frames without waiting for answers."""
        self._send("credit", n=n)

    def ping(self) -> None:
        """Ask for the bench's clock; the answer goes into `clock`. `receive` does this once a second."""
        self._next_ping_s = time.monotonic() + PING_EVERY_S
        self._pings += 1
        clock, estimate = self.clock, {}
        if clock.round_trip_ns is not None:
            estimate = {"bench_minus_client_ns": clock.bench_minus_client_ns, "round_trip_ns": clock.round_trip_ns}
        self._send("ping", id=self._pings, t_client_ns=time.monotonic_ns(), **estimate)

    def _send(self, kind: str, **entries: Any) -> None:
        self._connections[0].send(protocol.message(kind, **entries))

    # --- leaving ---

    def close(self, reason: str = "done") -> None:
        """Say bye and close the sockets."""
        if self._closed:
            return
        self._closed = True
        if self.end is None and self._connections:
            with contextlib.suppress(ConnectionLost):  # the bench may be gone already
                self._send("bye", reason=reason[:200])
        for connection in self._connections:
            connection.close(BYE_LINGER_MS)
        if self._own_context:
            self._context.destroy(linger=0)  # `term` would wait for a socket whose set-up was interrupted

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self.close("done" if kind is None else kind.__name__)

    @property
    def _address(self) -> str:
        return self._connections[0].address


def reachable(port: str, address: str) -> str:
    """Return a port's address; a wildcard host is replaced by the host of `address`, to which this client connected."""
    wildcard = re.match(r"tcp://(?:\*|0\.0\.0\.0|\[::\]):(\d+)\Z", port)
    connected = re.match(r"tcp://(.*):\d+\Z", address)
    return f"tcp://{connected.group(1)}:{wildcard.group(1)}" if wildcard and connected else port


def _refused(header: protocol.Header) -> Refused:
    fields = Fields(header, "refused")
    code, text = fields.text("code", 40), fields.text("text")
    return SchemaChanged(text) if code == "schema" else Refused(code, text)


def _no_answer(connection: Connection, wait_s: float) -> str:
    if connection.handshakes:
        return f"{connection.address}: a program listens there, but did not answer as a bench within {wait_s:g} s"
    return (
        f"{connection.address}: no bench there within {wait_s:g} s; "
        "does `hil run` listen there, with a section companion?"
    )
