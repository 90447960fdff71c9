"""A FaultyTransport over a wire whose far side is the test, and numbered frames to send through it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from hypothesis import strategies as st

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.codecs.signing import Signer, SigningClock, SigningKey
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from signals.errors import LinkClosed

MS = 1_000_000
SECOND = 1000 * MS
Attitude = message_class("ATTITUDE")


@cache
def _frames(count: int) -> tuple[bytes, ...]:
    encoder = FrameEncoder(1, 1)
    return tuple(
        encoder.frame(MSGID["ATTITUDE"], pack(Attitude(k, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6))) for k in range(count)
    )


def frames(count: int) -> list[bytes]:
    """Return numbered ATTITUDE frames."""
    return list(_frames(count))


def numbers(data: bytes) -> list[int]:
    """Return the numbers of the frames in `data`, in order."""
    return [int.from_bytes(frame.payload[:4], "little") for frame in FrameParser().feed(data)]


def signed(frame: bytes) -> bytes:
    """Return the frame signed, always with the same time."""
    return Signer(SigningKey(bytes(32)), 1, SigningClock(lambda: 7)).sign(frame)


PIECES = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.sampled_from([*frames(3), signed(frames(1)[0]), b"\xfd", b"\xfe\xff", b"\xfd\xff\x00\x00\x00\x01\x01"]),
    ),
    max_size=20,
)


class Clock:
    """Simulated time and wall clock, set by the test."""

    def __init__(self) -> None:
        self.sim_ns = 0
        self.wall_ns = 50 * SECOND

    def pass_s(self, seconds: float) -> None:
        self.wall_ns += round(seconds * 1e9)


class Wire:
    """A transport whose far side is this test. Waiting advances the wall clock."""

    name = "wire"

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.sent = b""
        self.inbox: list[bytes] = []
        self.opened = 0
        self.is_open = False
        self.hung_up = False

    def open(self) -> None:
        self.opened += 1
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def write(self, data: bytes) -> None:
        assert self.is_open
        assert data
        self.sent += data

    def read(self, timeout_s: float) -> bytes:
        assert self.is_open
        assert timeout_s >= 0.0
        if self.inbox:
            return self.inbox.pop(0)
        if self.hung_up:
            raise LinkClosed(self.name, "hung up")
        self.clock.pass_s(timeout_s)
        return b""

    def fileno(self) -> int | None:
        return 99


class Rig:
    """A FaultyTransport over a Wire."""

    def __init__(self, *faults: LinkFault, seed: int = 1) -> None:
        self.clock = Clock()
        self.wire = Wire(self.clock)
        self.events: list[tuple[int, str, str]] = []
        self.line = FaultyTransport(
            self.wire,
            faults,
            seed,
            lambda: self.clock.sim_ns,
            lambda *event: self.events.append(event),
            wall_ns=lambda: self.clock.wall_ns,
            sleep=self.clock.pass_s,
        )
        self.line.open()

    def through(self, units: Sequence[bytes], direction: str) -> bytes:
        """Send `units` one after the other and return all bytes that come out."""
        if direction == "to_autopilot":
            for unit in units:
                self.line.write(unit)
            self.line.read(5.0)  # time for held-back units
            return self.wire.sent
        self.wire.inbox += units
        out = b""
        while data := self.line.read(5.0):
            out += data
        return out
