"""Who stays awake for a short wait, on both ends of the companion link."""

from __future__ import annotations

import os

import pytest

from firmware_bridge.companion.patience import Patience
from hil.companion.started import use_client

use_client()
from hil_companion import patience as client_patience  # noqa: E402


def test_awake_after_a_short_wait_and_not_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    yields: list[int] = []
    monkeypatch.setattr(os, "sched_yield", lambda: yields.append(1))
    bench, client = Patience(), client_patience.Patience()
    assert not bench.stays_awake(0)
    assert not client.stays_awake(0.0)
    bench.waited(50_000)
    client.waited(50e-6)
    assert bench.stays_awake(0)
    assert client.stays_awake(0.0)
    assert len(yields) == 2
    assert not bench.stays_awake(1_000_000)
    assert not client.stays_awake(1e-3)
    bench.waited(5_000_000)
    client.waited(5e-3)
    assert not bench.stays_awake(0)
    assert not client.stays_awake(0.0)


@pytest.mark.parametrize(("computes", "asleep"), [(False, 0), (True, 64)])
def test_asleep_where_somebody_else_wants_the_core(
    computes: bool, asleep: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    busy_s = -1.0 if computes else 1e9
    monkeypatch.setattr("firmware_bridge.companion.patience._CROWDED_NS", -1)
    monkeypatch.setattr("firmware_bridge.companion.patience._BUSY_NS", busy_s)
    monkeypatch.setattr(client_patience, "CROWDED_S", -1.0)
    monkeypatch.setattr(client_patience, "BUSY_S", busy_s)
    bench, client = Patience(), client_patience.Patience()
    bench.waited(1)
    client.waited(1e-9)
    assert [bench.stays_awake(0), bench.stays_awake(0)] == [True, False]
    assert [client.stays_awake(0.0), client.stays_awake(0.0)] == [True, False]
    waits = 0
    while not bench.stays_awake(0):  # that wait is slept through, and more where somebody computes
        bench.waited(1)
        waits += 1
        assert waits < 100
    assert waits == max(1, asleep)
    for _ in range(waits):
        assert not client.stays_awake(0.0)
        client.waited(1e-9)
    assert client.stays_awake(0.0)


def test_awake_for_the_rest_of_what_has_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(os, "sched_yield", lambda: None)
    client = client_patience.Patience()
    client.waited(1.0)
    assert [client.stays_awake(0.0), client.stays_awake(0.0, begun=True)] == [False, True]
    assert not client.stays_awake(1e-3, begun=True)


def test_never_awake_on_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
    bench, client = Patience(), client_patience.Patience()
    bench.waited(1)
    client.waited(1e-9)
    assert not bench.stays_awake(0)
    assert not client.stays_awake(0.0)
