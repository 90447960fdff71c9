"""The companion's part of `hil bench link`: what is no timing."""

from __future__ import annotations

import subprocess
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from numpy.typing import NDArray

from firmware_bridge.companion.settings import Arrangement
from hil.bench_suite import link_companion, second_host
from hil.bench_suite.link_companion_flight import differing_arrays
from hil.bench_suite.link_companion_frame import bytes_of, checksums, frame_arrays, size_of
from hil.bench_suite.link_companion_transfer import Rates, Wire, _wrong, far_end
from hil.bench_suite.result import BenchmarkResult
from hil.recorder.frame_series import FrameSeries
from hil.signals.errors import LinkClosed, PortNotFound


def test_frame_is_the_one_that_is_asked_for() -> None:
    arrays = frame_arrays(0)
    assert arrays["front/rgb"]["rgb"].shape == (240, 320, 3)
    assert arrays["front/depth"]["depth"].nbytes == 240 * 320 * 4
    assert len(arrays["lidar"]["range_m"]) == 16 * 900
    assert 0.9e6 < size_of(arrays) == len(bytes_of(arrays)) < 1.1e6
    assert 3.9 < size_of(frame_arrays(0, scale=4.0)) / size_of(arrays) < 4.1
    assert checksums(arrays) == checksums(frame_arrays(0)) != checksums(frame_arrays(1))


def test_changed_missing_and_strange_arrays_are_counted() -> None:
    assert _wrong({"a": 1, "b": 2}, StringIO('{"a": 1, "b": 2}\n')) == 0
    assert _wrong({"a": 1, "b": 2}, StringIO('{"a": 1, "b": 3}\n')) == 1
    assert _wrong({"a": 1, "b": 2}, StringIO('{"a": 1, "c": 2}\n')) == 2
    assert _wrong({"a": 1, "b": 2}, StringIO("")) == 2  # the far end is gone


def test_ratio_is_of_pairs() -> None:
    rates = Rates(1, link_s=[2.0, 40.0, 4.0], bare_s=[1.0, 10.0, 3.0])
    assert rates.of_bare == 0.5


@pytest.mark.parametrize("arrangement", ["one_port", "ports"])
def test_transfer_both_ways(arrangement: Arrangement) -> None:
    arrays = frame_arrays(0, scale=0.05)
    with far_end(Wire(), arrangement, arrays) as transfer:
        assert transfer.differing(2) == 0
        for ahead in (1, 4):
            rates = transfer.measure(ahead=ahead, seconds=0.05, least_pairs=1)
            assert len(rates.link_s) == len(rates.bare_s) >= 1


def test_far_end_that_dies_is_named() -> None:
    with far_end(Wire(), "one_port", frame_arrays(0, scale=0.05)) as transfer:
        transfer._peer.kill()
        transfer._peer.wait()
        with pytest.raises((LinkClosed, BrokenPipeError)):
            transfer.measure(ahead=1, seconds=0.05)


def test_a_flight_gives_what_it_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    differ, compared = differing_arrays(tmp_path / "a", seconds=0.05)
    assert differ == 0
    assert compared > 10
    # A recording of other pictures is noticed.
    write = FrameSeries._image

    def spoilt(self: FrameSeries, file: Any, sample: Any, log_ns: int, name: str, picture: NDArray[Any]) -> None:
        write(self, file, sample, log_ns, name, picture ^ 1 if picture.ndim == 3 else picture)

    monkeypatch.setattr(FrameSeries, "_image", spoilt)
    differ, _ = differing_arrays(tmp_path / "b", seconds=0.05)
    assert differ > 0


def test_rows_of_a_transfer() -> None:
    rates = Rates(1_000_000, link_s=[1e-3], bare_s=[5e-4])
    result = BenchmarkResult()
    link_companion._rows(result, "transfer", "ports", rates, 0, wire="loopback")
    assert result.rows[0].details["of_bare"] == 0.5
    assert result.rows[0].details["mb_per_s"] == pytest.approx(1000.0)


def test_second_host_that_cannot_be_made_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[list[str]] = []

    def fake(words: tuple[str, ...], **_: object) -> subprocess.CompletedProcess[str]:
        done.append(list(words))
        return subprocess.CompletedProcess(words, "tc" in words, "", "unknown kind")

    monkeypatch.setattr(second_host.subprocess, "run", fake)
    with pytest.raises(PortNotFound, match="neither netem nor tbf"):
        second_host.SecondHost()
    assert [words[:3] for words in done[-2:]] == [["ip", "link", "delete"], ["ip", "netns", "delete"]]


def test_what_a_second_host_needs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_host.os, "geteuid", lambda: 1000)
    assert "root" in (second_host.why_not() or "")
    monkeypatch.setattr(second_host.os, "geteuid", lambda: 0)
    monkeypatch.setattr(second_host.shutil, "which", lambda tool: None if tool == "tc" else tool)
    assert "no tc" in (second_host.why_not() or "")
