"""The stability benchmark's own parts: inputs out of range, a cell of its map."""

from __future__ import annotations

from hil.apps.bench_suite.physics import stability
from hil.apps.bench_suite.physics.flight_cases import ThisProject, hover


def test_inputs_out_of_range_end_with_a_name() -> None:
    assert stability._inputs_without_named_error() == 0


def test_a_cell_against_the_fine_solution() -> None:
    swept = stability._against_fine("wind", 5.0, "m/s", hover(0.2), "position")
    assert swept.error(ThisProject(4.0)) < 1e-9
