"""The companion's part of `hil bench link`, without timings."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_bridge.companion.settings import Arrangement
from hil.apps.bench_suite.link import second_host as second_host_module
from hil.apps.bench_suite.link import transfer as transfer_module
from hil.apps.bench_suite.link.companion import differing_arrays
from hil.apps.bench_suite.link.second_host import second_host
from hil.apps.bench_suite.link.transfer import (
    Endpoints,
    TransferRates,
    bytes_of,
    differing,
    frame_arrays,
    open_transfer,
)
from hil.apps.bench_suite.result import BenchmarkResult
from hil.run.recorder.frame_series import FrameSeries
from signals.errors import LinkClosed, PortNotFound


def test_frame_is_the_requested_one() -> None:
    arrays = frame_arrays(0)
    assert arrays["front/rgb"]["rgb"].shape == (240, 320, 3)
    assert arrays["front/depth"]["depth"].nbytes == 240 * 320 * 4
    assert len(arrays["lidar"]["range_m"]) == 16 * 900
    assert 0.9e6 < len(bytes_of(arrays)) < 1.1e6
    assert bytes_of(arrays) == bytes_of(frame_arrays(0)) != bytes_of(frame_arrays(1))


def test_changed_missing_and_unexpected_arrays_are_counted() -> None:
    one, two = np.ones(3), np.zeros(3)
    sent = {"t": {"a": one, "b": two}}
    assert differing(sent, {"t": {"a": one.copy(), "b": two}}) == 0
    assert differing(sent, {"t": {"a": one, "b": one}}) == 1
    assert differing(sent, {"t": {"a": one}, "u": {"b": two}}) == 2
    assert differing(sent, {}) == 2


def test_ratio_is_of_pairs() -> None:
    rates = TransferRates(1, link_s=[2.0, 40.0, 4.0], bare_s=[1.0, 10.0, 3.0])
    assert rates.relative_rate == 0.5


@pytest.mark.parametrize("arrangement", ["one_port", "ports"])
def test_transfer_both_ways(arrangement: Arrangement) -> None:
    result = BenchmarkResult()
    with open_transfer(Endpoints(), arrangement, scale=0.05) as transfer:
        transfer_module._measure(result, transfer, arrangement, 0.05)
        assert transfer.differing == 0
    assert [row.method for row in result.rows] == [arrangement, f"bare socket beside {arrangement}"] * 2
    assert all(row.details["mb_per_s"] > 0.0 for row in result.rows)
    assert len(result.checks) == 3


def test_far_end_that_dies_is_named() -> None:
    with open_transfer(Endpoints(), "one_port", scale=0.05) as transfer:
        transfer.peer.kill()
        transfer.peer.wait()
        with pytest.raises((LinkClosed, BrokenPipeError)):
            transfer.measure(in_flight=1, seconds=0.05)


def test_a_flight_returns_its_recorded_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    differ, compared = differing_arrays(tmp_path / "a", seconds=0.05)
    assert differ == 0
    assert compared > 10
    # A recording of other pictures is noticed.
    write = FrameSeries._add_image

    def spoilt(self: FrameSeries, file: Any, sample: Any, log_ns: int, name: str, picture: NDArray[Any]) -> None:
        write(self, file, sample, log_ns, name, picture ^ 1 if picture.ndim == 3 else picture)

    monkeypatch.setattr(FrameSeries, "_add_image", spoilt)
    differ, _ = differing_arrays(tmp_path / "b", seconds=0.05)
    assert differ > 0


def test_a_second_host_that_cannot_be_created_is_named_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[list[str]] = []

    def fake(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        done.append(words)
        return subprocess.CompletedProcess(words, "tc" in words, "", "unknown kind")

    monkeypatch.setattr(second_host_module.subprocess, "run", fake)
    monkeypatch.setattr(second_host_module.os, "geteuid", lambda: 1000)
    with pytest.raises(PortNotFound, match="root"), second_host():
        pass
    monkeypatch.setattr(second_host_module.os, "geteuid", lambda: 0)
    with pytest.raises(PortNotFound, match=r"tbf.*unknown kind"), second_host():
        pass
    assert [words[:3] for words in done[-2:]] == [["ip", "link", "delete"], ["ip", "netns", "delete"]]
