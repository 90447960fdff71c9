"""`explore` flies the mock through a small unmapped place, as a process of its own over TCP, judged by truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil.config import load_bench
from hil.run.bench_run import run_bench
from tests.worlds.hop_flights import saved

SCENE = """name: one_hall
description: "one hall"
site: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_m: 488.0}
ground_friction: 0.7
gravity_mps2: 9.80665
wind_W_mps: [0.0, 0.0, 0.0]
boxes: [{name: hall, center_m: [5.5, 0.5, 4.0], size_m: [1.0, 4.0, 8.0]}]
"""
BENCH = """rig: mock
scene: ./one_hall.yaml
duration_s: 60
tick_hz: 100
autopilot: {transport: loopback}
goal: {p_W: [10.0, 0.0, 3.0]}
companion:
  start: [explore]
  control: true
  arrangement: one_port
  port: 0
  rate_hz: 10
  reply_timeout_s: 60
  connect_timeout_s: 60
  settings: {localiser: truth, picture_every_s: 4}
sensors:
  imu:   {preset: icm20689}
  gps:   {preset: here_plus, rate_hz: 10}
  baro:  {preset: ms5611, rate_hz: 50}
  mag:   {preset: ist8310, rate_hz: 50}
  lidar:  # coarse, for a fast test
    preset: vlp16
    rate_hz: 10
    mount_m: [0.0, 0.0, 0.12]
    pattern: {kind: spinning, elevation_deg: [-15, -9, -5, -3, -1, 1, 3, 5], firing_ns: 0, columns: 450}
record: {mcap: false, tlog: false}
"""


def test_a_flight_round_a_hall_is_judged_and_shown(tmp_path: Path) -> None:
    (tmp_path / "one_hall.yaml").write_text(SCENE)
    (tmp_path / "b.yaml").write_text(BENCH)
    out = tmp_path / "run"
    result = run_bench(load_bench(tmp_path / "b.yaml"), out, quiet=True)
    run = saved(out)
    assert result.status == "PASS", (run["error"], run["verdict"]["reasons"])
    goal = run["goal"]
    assert goal["outcome"] == "goal"
    assert goal["goal_error_m"] < 1.0
    assert goal["clearance_m"] >= 0.5
    assert goal["contacts"] == 0
    # Round the corners (5, 2.5) and (6, 2.5), or (5, -1.5) and (6, -1.5), with 0.9 m to spare.
    assert 10.2 < goal["shortest_m"] < 12.5
    report = run["companion"]["clients"]["explore"]["report"]
    assert report["outcome"] == "goal"
    assert report["replans"] > 30
    shown = (out / "report.html").read_text()
    assert "Picture by explore" in shown
    assert "explore: goal" in shown
    assert (out / "companion_explore" / "report.png").stat().st_size > 1000
    assert np.frombuffer((out / "companion_explore" / "film.avi").read_bytes()[:4], "S4")[0] == b"RIFF"
