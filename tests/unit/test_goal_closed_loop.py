"""A short flight of the explorer with the bench's own LiDAR, judged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hil.config import load_bench
from hil.config.schema import Goal
from hil.view_command import load_frames
from tests.explorer_flights import START_Z_M, ClosedLoop
from tests.unit.companion_bench import CLIENT
from tests.unit.test_goal_judgement import SCENE

from hil_companion.explore.true_pose import TruePose  # isort: skip

assert CLIENT
COARSE = {"kind": "spinning", "elevation_deg": [-15, -5, -3, -1, 1, 3], "firing_ns": 0, "columns": 450}


def test_a_short_flight_round_a_hall_is_judged(tmp_path: Path) -> None:
    (tmp_path / "two_boxes.yaml").write_text(SCENE)
    scene, _, frames = load_frames(str(tmp_path / "two_boxes.yaml"), None)
    vehicle = load_bench(None, settings=["mission=null"]).vehicle

    def flown(change: Any) -> Any:
        loop = ClosedLoop(
            scene,
            frames,
            vehicle,
            Goal(p_W=(15.0, -1.0, 4.0)),
            lambda told: TruePose(told["lidar"], 4.0, half_m=60.0),
            frame_hz=10,
            sensors={"lidar": {"preset": "vlp16", "rate_hz": 10.0, "pattern": COARSE}},
            flight={"hover_s": 0.2},
            change=change,
        )
        return loop.fly(60.0).result, loop.measurement.judged()[1], loop.vehicle.p

    result, reasons, _ = flown(None)
    assert reasons == []
    assert result.outcome == "goal"
    assert 0.98 < result.path_ratio < 1.35

    def lost(truth: Any, name: str, sample: Any) -> Any:
        return None if name == "lidar" and truth.t_ns > 4_000_000_000 else sample

    result, reasons, p = flown(lost)
    assert result.outcome == "lidar_lost"
    assert "the client ended as 'lidar_lost'" in reasons[0]
    assert result.clearance_m > 0.5
    assert p[2] > START_Z_M + 1.0
    frames.close()
