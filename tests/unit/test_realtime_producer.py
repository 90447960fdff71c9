"""The producer's priority: asked for, reported, given back, never passed on."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from firmware_bridge.links.realtime_producer import RealtimeProducer

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="this system knows one scheduling only")


def _policy() -> int:
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def test_raised_inside_and_normal_outside() -> None:
    before = _policy()
    with RealtimeProducer(7) as producer:
        if producer.scheduling == "SCHED_FIFO 7":
            assert _policy() == os.SCHED_FIFO
            assert os.sched_getparam(0).sched_priority == 7
            child = "import os; print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)"
            said = subprocess.run([sys.executable, "-c", child], capture_output=True, check=True, text=True)
            assert int(said.stdout) == os.SCHED_OTHER
        else:
            assert producer.scheduling.startswith("normal scheduling (")
            assert _policy() == before
    assert _policy() == before


def test_a_refusal_is_words_and_no_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    with RealtimeProducer() as producer:
        assert producer.scheduling == "normal scheduling (SCHED_FIFO 40 refused: Operation not permitted)"
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with RealtimeProducer() as producer:
        assert "only one processor" in producer.scheduling
