"""The stability benchmark's own parts: inputs out of range, a cell of its table."""

from __future__ import annotations

from hil.apps.bench_suite.physics import stability
from hil.apps.bench_suite.physics.flight_cases import ThisProject, hover


def test_inputs_out_of_range_raise_an_error_that_names_them() -> None:
    assert stability._inputs_without_error() == 0


def test_a_cell_compared_with_the_reference() -> None:
    swept = stability._compared_with_reference("wind", 5.0, "m/s", hover(0.2), "position")
    assert swept.measure_error(ThisProject(4.0)) < 1e-9
