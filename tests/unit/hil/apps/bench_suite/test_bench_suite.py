"""Output of `hil bench` that is common to all benchmarks."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from hil.apps.bench_suite import suite
from hil.apps.bench_suite.result import BenchmarkResult
from signals.errors import ConfigError


def test_a_part_that_was_not_run_is_not_blamed_on_quick() -> None:
    console = Console(width=120, record=True, file=StringIO())
    suite._print(BenchmarkResult(left_out=["px4_sitl: the environment variable PX4_BINARY is not set"]), console)
    text = console.export_text()
    assert "left out: px4_sitl: the environment variable PX4_BINARY is not set" in text
    assert "--quick" not in text


def test_an_unknown_benchmark_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="use one of: airsim, dash"):
        suite.run_benchmark("nonsense", json=None, quick=True, console=Console(quiet=True))
