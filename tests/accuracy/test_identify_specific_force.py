"""Specific force of real flights on falling voltage and near the floor. Skips without the flights or pyarrow.

hil bench flights --logs flights/nanobench --vehicle docs/examples/identify/crazyflie_fitted.yaml --set fitted=...
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lab.flights import measure

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(os.environ.get("HIL_FLIGHTS", ROOT.parent / "shared" / "flights")) / "nanobench"
VEHICLE = ROOT / "docs" / "examples" / "identify" / "crazyflie_fitted.yaml"
FITTED = ("B2_circle_fast", "B2_circle_slow", "B3_figure8_fast", "B5_helix_fast", "B7_oval_fast", "B8_star_medium")


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_specific_force_of_flights_held_out_is_far_below_a_constant_gains() -> None:
    pytest.importorskip("pyarrow")
    if not FOLDER.is_dir():
        pytest.skip(f"{FOLDER} is not there")
    options = {
        "logs": str(FOLDER),
        "vehicle": str(VEHICLE),
        "every": "50",
        "fitted": ",".join(f"{name}_rep1" for name in FITTED),
    }
    result = measure(quick=False, status=lambda text: None, options=options)
    ratios = {r.case: r.details["ratio"] for r in result.rows if r.method == "specific force"}
    assert "B6_linear_ramp_rep1" in ratios
    assert ratios["all"] <= 0.6, ratios
    (check,) = [c for c in result.checks if c.name.startswith("error of specific force")]
    assert check.ok
