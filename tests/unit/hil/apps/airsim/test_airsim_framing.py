"""Messages of a stream: found without being decoded, and refused beyond the limits before they are complete."""

from __future__ import annotations

import struct
from typing import Any

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.apps.airsim.rpc import framing
from hil.apps.airsim.rpc.framing import MOST_BYTES, MOST_DEPTH, MOST_ITEMS, Framer, TooLarge

SCALARS = (
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | st.text(max_size=80)
    | st.binary(max_size=80) | st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=40))
)  # fmt: skip
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=20,
)
LONG = ["x" * 300, "x" * 70_000, b"y" * 300, b"y" * 70_000, list(range(70_000)), {i: i for i in range(70_000)},
        msgpack.ExtType(1, b"z" * 300), msgpack.ExtType(1, b"z" * 70_000)]  # fmt: skip


@settings(max_examples=50, deadline=None)
@given(st.lists(VALUES, min_size=1, max_size=4), st.integers(1, 40))
def test_messages_are_those_of_the_library_whatever_the_pieces(values: list[Any], step: int) -> None:
    messages = [msgpack.packb(value) for value in values]
    data = b"".join(messages)
    framer, found = Framer(), []
    for start in range(0, len(data), step):
        framer.feed(data[start : start + step])
        while (message := framer.next()) is not None:
            found.append(message)
    assert found == messages
    assert len(framer) == 0


@pytest.mark.parametrize("value", LONG, ids=lambda value: f"{type(value).__name__}{len(value)}")
def test_long_values(value: Any) -> None:
    data = msgpack.packb(value)
    framer = Framer()
    framer.feed(data[:-1])
    assert framer.next() is None
    framer.feed(data[-1:] + b"\x01")
    assert framer.next() == data
    assert framer.next() == b"\x01"


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"\xc6" + struct.pack(">I", MOST_BYTES), "bytes"),
        (b"\xdb\xff\xff\xff\xff", "bytes"),
        (b"\xc9\xff\xff\xff\xff", "bytes"),
        (b"\xdd\xff\xff\xff\xff", "values"),
        (b"\xdf" + struct.pack(">I", MOST_ITEMS // 2), "values"),
        (b"\x91" * (MOST_DEPTH + 1), "deep"),
        (b"\x81\x00" * (MOST_DEPTH + 1), "deep"),
    ],
)
def test_a_message_beyond_a_limit_is_refused_at_its_announcement(data: bytes, told: str) -> None:
    framer = Framer()
    framer.feed(b"\x94\x00\x01\xa4ping" + data)
    with pytest.raises(TooLarge, match=told):
        framer.next()


@pytest.mark.parametrize("item", [b"\x90", b"\x80", b"\xe0", b"\xa2\xc3\xbf"])
def test_the_limits_hold_for_small_parts(item: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(framing, "MOST_ITEMS", 1000)
    monkeypatch.setattr(framing, "MOST_BYTES", 100_000)
    part = b"\xdc" + struct.pack(">H", 500) + item * 500
    framer = Framer()
    framer.feed(b"\xdd" + struct.pack(">I", 900))
    framer.feed(part)
    assert framer.next() is None
    framer.feed(part)
    with pytest.raises(TooLarge, match="more than 1000 values"):
        framer.next()


def test_bytes_count_over_all_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(framing, "MOST_BYTES", 100_000)
    framer = Framer()
    framer.feed(b"\xdd" + struct.pack(">I", 900))
    for _ in range(9):
        framer.feed(msgpack.packb(bytes(10_000)))
        assert framer.next() is None
    framer.feed(msgpack.packb(bytes(10_000)))
    with pytest.raises(TooLarge, match="more than 100000 bytes"):
        framer.next()
