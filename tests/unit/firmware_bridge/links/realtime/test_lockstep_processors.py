"""Processors of bench and autopilot in lockstep: shared or separate, restored afterwards."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from firmware_bridge.links.realtime.processor import LockstepProcessors

pytestmark = pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="this system knows one scheduling only")


@pytest.fixture
def autopilot() -> Iterator[int]:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process.pid
        process.communicate(b"\n")


@pytest.mark.skipif(os.cpu_count() == 1, reason="one processor cannot be divided")
@pytest.mark.parametrize("share", [True, False])
def test_the_bench_has_the_last_processor_and_the_autopilot_the_same_or_the_others(autopilot: int, share: bool) -> None:
    allowed, policy = os.sched_getaffinity(0), os.sched_getscheduler(0)
    own = {max(allowed)}
    with LockstepProcessors(autopilot, share=share) as processors:
        assert (processors.shared, processors.separate) == (share, not share)
        assert os.sched_getaffinity(0) == own
        assert os.sched_getaffinity(autopilot) == (own if share else allowed - own)
        assert share or os.sched_getscheduler(0) == policy
    assert os.sched_getaffinity(0) == os.sched_getaffinity(autopilot) == allowed
    assert os.sched_getscheduler(0) == policy


def test_one_processor_is_not_divided_and_no_process_is_no_error(
    autopilot: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with LockstepProcessors(None, share=True) as processors:
        assert not processors.shared
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with LockstepProcessors(autopilot, share=False) as processors:
        assert not processors.separate


def test_a_slow_bench_ends_the_sharing(autopilot: int) -> None:
    allowed = os.sched_getaffinity(0)
    with LockstepProcessors(autopilot, share=True) as processors:
        assert processors.watch(10**15) is None
        assert "no longer share one" in str(processors.watch(0))
        assert not processors.shared
        assert os.sched_getaffinity(0) == allowed
