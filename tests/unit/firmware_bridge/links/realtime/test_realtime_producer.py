"""The producer's priority: requested, reported, restored, not inherited."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from firmware_bridge.links.realtime.processor import RealtimeProducer

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="this system knows one scheduling only")


def _policy() -> int:
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def test_raised_inside_where_permitted_and_normal_outside() -> None:
    before = _policy()
    with RealtimeProducer():
        if _policy() == os.SCHED_FIFO:
            assert os.sched_getparam(0).sched_priority == 40
            child = "import os; print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)"
            said = subprocess.run([sys.executable, "-c", child], capture_output=True, check=True, text=True)
            assert int(said.stdout) == os.SCHED_OTHER
        else:
            assert _policy() == before
    assert _policy() == before


@pytest.mark.parametrize("processors", [{0}, {0, 1}])
def test_a_refusal_is_no_exception_and_one_processor_is_not_asked_for(
    monkeypatch: pytest.MonkeyPatch, processors: set[int]
) -> None:
    asked: list[object] = []

    def refuse(*wanted: object) -> None:
        asked.append(wanted)
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: processors)
    with RealtimeProducer():
        pass
    assert len(asked) == len(processors) - 1
