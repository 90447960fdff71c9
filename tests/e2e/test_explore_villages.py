"""Twenty unknown villages: the goal reached, nothing near, no long way round. With SLAM, without an autopilot."""

from __future__ import annotations

from typing import Any

import pytest

from hil.config import load_bench
from hil.config.schema import Goal
from hil.view_command import load_frames
from tests.explorer_flights import START_Z_M, ClosedLoop
from tests.unit.companion_bench import CLIENT

from hil_companion.explore.slam import Slam  # isort: skip
from hil_companion.explore.slam_settings import SlamSettings, lidar_settings  # isort: skip

assert CLIENT
GOAL = Goal(p_W=(70.0, 60.0, 10.0))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
def test_a_village_that_nobody_has_mapped(seed: int) -> None:
    scene, _, frames = load_frames("training_village", seed)

    def localiser(told: Any) -> Any:
        chosen = SlamSettings(**lidar_settings(told["lidar"]))
        return Slam(chosen, start_W=(0.0, 0.0, START_Z_M, 0.0), seed=seed)

    vehicle = load_bench(None, settings=["mission=null"]).vehicle
    loop = ClosedLoop(scene, frames, vehicle, GOAL, localiser, seed=seed)
    flown = loop.fly()
    frames.close()
    rows, reasons = loop.measurement.judged()
    assert not reasons, flown.result
    assert len(rows) == 4
