"""The stability benchmark's own parts: verdicts, the map, inputs out of range."""

from __future__ import annotations

import math
from pathlib import Path

from hil.bench_suite import stability
from hil.bench_suite.flight_cases import ThisProject, hover
from hil.bench_suite.result import BenchmarkResult
from hil.bench_suite.stability import LOST, NAMED, OUT, WITHIN
from hil.signals.errors import ModelRangeError


def cell(error: float) -> stability.Cell:
    return stability.Cell("sweep", 1.0, "x", 1e-3, "m", lambda _method: error)


def test_verdicts() -> None:
    def named(_method: object) -> float:
        raise ModelRangeError(3, "speed_mps", 250.0, "<= 200 m/s")

    method = ThisProject(4.0)
    seen = [stability._row(cell(e), "m", method).details["verdict"] for e in (1e-4, 0.5, math.inf, math.nan)]
    assert seen == [WITHIN, OUT, LOST, LOST]
    row = stability._row(stability.Cell("sweep", 1.0, "x", 1e-3, "m", named), "m", method)
    assert row.details["verdict"] == NAMED
    assert "speed_mps = 250.0" in row.details["said"]
    assert math.isfinite(row.error)  # JSON has no infinity


def test_map_is_drawn(tmp_path: Path) -> None:
    rows = [stability._row(cell(e), f"method {e}", ThisProject(4.0)) for e in (0.0, 1e-4, 0.5, math.inf)]
    stability.plot(BenchmarkResult(rows), "title", tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 5000


def test_inputs_out_of_range_end_with_a_name() -> None:
    assert stability._unnamed() == 0


def test_a_cell_against_the_fine_solution() -> None:
    swept = stability._against_fine("wind", 5.0, "m/s", hover(0.2), "position")
    assert swept.error(ThisProject(4.0)) < 1e-9
