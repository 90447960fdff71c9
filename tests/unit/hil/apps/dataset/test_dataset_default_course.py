"""The default data set of `hil dataset`: its radar sees objects, and its course is clear of trees and people."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.plan import make_plan
from hil.apps.dataset.trajectory import course, waypoints_text
from hil.config.missions import load_mission
from hil.config.schema import Trajectory
from hil.run.sensors.frame_stages import make_frames
from hil.run.sensors.simulated_sensors import SimulatedSensors
from hil.run.verdict.clearance import Clearance
from signals.samples import TruthState
from sim.scene.scene import Site

_EVERY_M = 3.0


def truths_along(trajectory: Trajectory) -> Iterator[TruthState]:
    """Yield true states along the course from the take-off place, level and at full speed, from 15 s on."""
    zero, t_s = (0.0, 0.0, 0.0), 15.0
    points = [(0.0, 0.0), *course(trajectory)]
    for (x0, y0), (x1, y1) in pairwise([*points, points[1]]):
        length_m, yaw = math.hypot(x1 - x0, y1 - y0), math.atan2(y1 - y0, x1 - x0)
        v = (trajectory.speed_mps * math.cos(yaw), trajectory.speed_mps * math.sin(yaw), 0.0)
        for i in range(round(length_m / _EVERY_M)):
            s_m = i * _EVERY_M
            p = (x0 + s_m * math.cos(yaw), y0 + s_m * math.sin(yaw), trajectory.height_m)
            t_ns = round((t_s + s_m / trajectory.speed_mps) * 1e9)
            q = (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
            yield TruthState(t_ns // 4_000_000, t_ns, p, q, v, zero, zero, zero, (0.0,) * 4, False)
        t_s += length_m / trajectory.speed_mps


def test_radar_of_the_default_data_set_sees_objects(tmp_path: Path) -> None:
    plan = make_plan(None, frames=10, quality=None, seed=None, settings=(), work=lambda: tmp_path)
    trajectory = plan.config.dataset.trajectory
    assert trajectory is not None
    frames = make_frames(plan.bench)
    frames.expect(0)
    world = frames.geometry.world
    catalogue = Catalogue.of_geoms(frames.classes, np.asarray(world.geom_instance), np.asarray(world.geom_class))
    radar = SimulatedSensors(plan.bench, plan.frame_sensors, frames).make("radar", labelled=catalogue.labelled)
    clearance = Clearance(frames.geometry)
    seen: list[set[str]] = []
    levels_db = []
    for seq, truth in enumerate(truths_along(trajectory)):
        assert clearance.nearest_m(truth.p_WB, truth.t_ns) > 1.0
        power = radar.sample(truth, seq).channels["range_doppler"]
        levels_db.append(10.0 * math.log10(power.max() / np.median(power)))
        objects = radar.objects
        seen.append({catalogue.classes.name(catalogue.class_of_instance[o.instance]) for o in objects})
    assert np.mean([bool(classes) for classes in seen]) > 0.9
    assert np.mean(["person" in classes for classes in seen]) >= 0.5
    assert np.mean(["tree" in classes for classes in seen]) >= 0.25
    assert np.mean(np.array(levels_db) > 13.0) > 0.9  # noise alone reaches 9 dB


def test_points_are_flown_in_their_order_and_looking_ahead(tmp_path: Path) -> None:
    points = ((0.0, 10.0), (10.0, 10.0), (10.0, 0.0))
    trajectory = Trajectory.model_validate({"preset": "points", "points_m": points, "height_m": 3.0})
    assert course(trajectory) == [(0.0, 10.0), (10.0, 10.0), (10.0, 0.0)]
    path = tmp_path / "course.waypoints"
    path.write_text(waypoints_text(trajectory, Site(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0)))
    items = load_mission(path, site=None).items
    assert [round(item.param4) for item in items[2:6]] == [0, 90, 180, -45]  # clockwise from north
    with pytest.raises(ValueError, match="points_m with at least 2 points"):
        Trajectory.model_validate({"preset": "points"})
