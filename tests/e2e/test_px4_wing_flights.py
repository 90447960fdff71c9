"""A plane and a standard VTOL on a real PX4 SITL, which the environment variable PX4_BINARY names."""

import os
from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench

RIGS = Path(__file__).parents[2] / "rigs"
BINARY = Path(os.environ.get("PX4_BINARY", "/nowhere"))
WIND = "wind={steady_W_mps: [4, 3, 0], turbulence: {wind_20ft_mps: 5}}"

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("bench", "module"), [("plane", "fw_att_control"), ("vtol", "vtol_att_control")])
def test_px4_flies_the_bench_in_gusty_wind(bench, module, tmp_path):
    if not (BINARY.parent / f"px4-{module}").exists():
        pytest.skip(f"the environment variable PX4_BINARY names no PX4 with {module}")
    settings = [f"autopilot.binary='{BINARY}'", WIND, "record.report=false", "record.mcap=false"]
    result = run_bench(load_bench(RIGS / f"{bench}.yaml", rig="px4_sitl", settings=settings), tmp_path, quiet=True)
    assert result.status == "PASS", result
