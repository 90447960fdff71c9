"""A radar or LiDAR that sees nothing of the scene is told of: its empty or clipped frames passed without a word."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench

RADAR = (
    "scene=airfield",
    "duration_s=0.5",
    "mission=null",
    "autopilot.transport=loopback",
    "record={mcap: true, tlog: false, report: false}",
    "sensors.radar={preset: bgt60tr13c, rate_hz: 10, outputs: [raw], mount_m: [0, 0, 1], mount_rpy_deg: [0, 30, 0]}",
)


def told(folder: Path, *settings: str) -> list[str]:
    run = run_bench(load_bench(settings=(*RADAR, *settings)), folder, quiet=True).run
    assert run["sensors"]["radar"]["samples"] > 0
    return [row["text"] for row in run["warnings"] if row["text"].startswith("radar ")]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sensors.radar.mount_rpy_deg=[0, -90, 0]", "no echo in any of 5 frames: look where it or its camera points"),
        ("sensors.radar.receiver.conversion_gain_db=100", "of the samples, so that ranges and speeds are false: lower"),
    ],
)
def test_a_radar_without_echoes_or_with_clipped_ones_is_told(setting: str, words: str, tmp_path: Path) -> None:
    (text,) = told(tmp_path, setting)
    assert words in text


def test_a_radar_over_the_ground_is_not(tmp_path: Path) -> None:
    assert told(tmp_path) == []


@pytest.mark.parametrize(("setting", "words"), [("max_range_m: 0.3", "no return in any of 5 sweeps: look"), ("", "")])
def test_a_lidar_without_a_return_is_told(setting: str, words: str, tmp_path: Path) -> None:
    lidar = f"sensors.lidar={{preset: vlp16, rate_hz: 10, min_range_m: 0.1, {setting}}}"
    run = run_bench(load_bench(settings=(*RADAR[:-1], lidar)), tmp_path, quiet=True).run
    assert run["sensors"]["lidar"]["samples"] == 5
    told = [row["text"] for row in run["warnings"] if row["text"].startswith("lidar ")]
    assert [words in text for text in told] == [True] * bool(words)
