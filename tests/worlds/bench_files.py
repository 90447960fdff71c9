"""Bench files for tests: written and loaded, and the problems of those that are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hil.config import Bench, load_bench
from hil.run.bench_run import RunResult, run_bench
from signals.errors import ConfigError

FLIGHT_SENSORS = """sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run every test in an empty folder, so that only installed rigs are found."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(text: str, **options: Any) -> Bench:
    """Write b.yaml with this text and return its bench."""
    Path("b.yaml").write_text(text, encoding="utf-8")
    return load_bench("b.yaml", **options)


def refused(text: str, **options: Any) -> list[str]:
    """Return the problems for which the bench of this text is refused."""
    with pytest.raises(ConfigError) as caught:
        load(text, **options)
    return [str(problem) for problem in caught.value.problems]


def flown(folder: Path, text: str) -> RunResult:
    """Write bench.yaml with this text into a folder, and fly it into its folder `out`."""
    file = folder / "bench.yaml"
    file.write_text(text, encoding="utf-8")
    return run_bench(load_bench(file), folder / "out", quiet=True)
