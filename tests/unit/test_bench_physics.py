"""The stability benchmark's own parts: inputs out of range, a cell of its map."""

from __future__ import annotations

from hil.bench_suite import stability
from hil.bench_suite.flight_cases import ThisProject, hover


def test_inputs_out_of_range_end_with_a_name() -> None:
    assert stability._unnamed() == 0


def test_a_cell_against_the_fine_solution() -> None:
    swept = stability._against_fine("wind", 5.0, "m/s", hover(0.2), "position")
    assert swept.error(ThisProject(4.0)) < 1e-9
