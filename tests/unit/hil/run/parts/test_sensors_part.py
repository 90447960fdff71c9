"""The geometry by which past flights are judged: other vehicles of the run are not in it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hil.config import load_bench
from hil.run.parts.simulated.sensors import SensorsPart
from hil.run.sensors.frame_stages import make_frames
from sim.frame.source import SharedFrames
from sim.physics.vehicle_bodies import with_vehicles
from sim.world_loader import load_world


def test_the_judges_geometry_has_no_other_vehicles(tmp_path: Path) -> None:
    """Their places are kept for a second only, and a clearance or a picture of the past needs them all."""
    (tmp_path / "bench.yaml").write_text("rig: mock\nvehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}\n")
    bench = load_bench(tmp_path / "bench.yaml", flown=False)
    world = with_vehicles(load_world(bench.scene), {name: one.vehicle for name, one in bench.vehicles.items()})
    run: Any = SimpleNamespace(bench=bench.vehicles["a"], make_frames=lambda: SharedFrames(world).seen_by("a"))
    part = SensorsPart(bench.vehicles["a"].config)
    assert not part.scene(run).geometry.world.map.actors
    part.close()

    alone = load_bench(settings=["mission=null"])
    run = SimpleNamespace(bench=alone, make_frames=partial(make_frames, alone))
    part = SensorsPart(alone.config)
    assert part.scene(run) is part.scene(run)
    part.close()
