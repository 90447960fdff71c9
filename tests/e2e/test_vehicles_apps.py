"""Applications given a bench or a run of several vehicles: they take the one that is named, or say that one must be."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.apps.radar.sources import open_source
from hil.config import load_bench
from hil.run.bench_run import run_bench
from signals.errors import ConfigError
from tests.worlds.hop_flights import HOP

BENCH = """
rig: mock
mission: hop.waypoints
duration_s: 1
autopilot: {transport: loopback}
record: {report: false, tlog: false}
vehicles: {lead: {}, wing: {}}
formation: {spacing_m: 4}
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  radar: {preset: bgt60tr13c, rate_hz: 5, outputs: [raw]}
"""


@pytest.fixture(scope="module")
def bench_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("apps")
    (folder / "hop.waypoints").write_text(HOP)
    (folder / "bench.yaml").write_text(BENCH)
    return folder / "bench.yaml"


def test_radar_data_of_one_vehicle_is_found_by_its_folder(bench_file: Path) -> None:
    out = bench_file.parent / "run"
    run_bench(load_bench(bench_file), out, quiet=True)
    frames = {}
    for name in ("lead", "wing"):
        source = open_source(out / name, preset=None, texts=())
        assert (source.description, source.count) == ("raw frames of 'radar'", 5)
        frames[name] = next(source.frames)
    assert frames["lead"].t_ns == frames["wing"].t_ns
    assert (frames["lead"].raw != frames["wing"].raw).any()  # own noise
    with pytest.raises(ConfigError, match=r"of several vehicles \(lead, wing\)"):
        open_source(out, preset=None, texts=())
    with pytest.raises(ConfigError, match=r"third.*does not exist"):
        open_source(out / "third", preset=None, texts=())
