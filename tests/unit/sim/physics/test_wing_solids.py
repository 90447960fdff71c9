"""Planes as seen: the convex bodies that follow from their forces, and their outline in a picture."""

from __future__ import annotations

import math

import numpy as np
import pytest

from signals.channels import CHANNELS
from signals.rotation import NO_TURN
from signals.samples import TruthState
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames
from sim.physics.forces.wing import WingParameters, spindle, tapered
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_bodies import with_vehicles
from sim.scene.scene import load_scene
from sim.world_loader import load_world

ZERO = (0.0, 0.0, 0.0)
HEIGHT_M = 20.0


def wing(vehicle: Vehicle) -> WingParameters:
    (found,) = (force for force in vehicle.forces if isinstance(force, WingParameters))
    return found


def test_a_half_has_its_chords_where_its_stations_are() -> None:
    corners = np.array(tapered(((0.0, 0.0, 0.1), (0.1, 0.0, 0.0)), ((-0.2, 1.0, 0.1), (0.05, 0.0, 0.0))))
    root, tip = corners[:4], corners[4:]
    assert root[:, 0].max() == pytest.approx(0.1)
    assert root[:, 0].min() == pytest.approx(-0.3)
    assert tip[:, 0].max() == pytest.approx(-0.15)
    assert tip[:, 0].min() == pytest.approx(-0.35)
    assert np.ptp(root[:, 2]) == pytest.approx(0.1 * 0.4)  # 10 % of the chord
    assert np.all(tip[[0, 2], 1] == 1.0)


def test_a_spindle_is_as_wide_and_high_as_told() -> None:
    corners = np.array(spindle((0.5, 0.0, 0.0), (-0.5, 0.0, 0.2), 0.2, 0.3))
    assert np.ptp(corners, axis=0) == pytest.approx([1.0, 0.2, 0.3])


def test_a_table_draws_its_wing_to_the_tips_of_the_hull() -> None:
    x8 = load_vehicle("skywalker_x8")
    hull = [(sphere.position_m, sphere.radius_m) for sphere in x8.hull]
    ends = [max(corners, key=lambda p: abs(p[1]))[1] for corners in wing(x8).solids(hull)[:2]]
    assert sorted(ends) == pytest.approx([-1.03, 1.03], abs=0.01)
    straight = [max(corners, key=lambda p: abs(p[1])) for corners in wing(x8).solids([])]
    assert sorted(p[1] for p in straight) == pytest.approx([-1.05, 1.05])


@pytest.mark.parametrize(("name", "span_m"), [("skywalker_x8", 2.1), ("aerosonde", 2.88), ("trainer", 1.26)])
def test_a_plane_is_seen_with_its_span_and_length(name: str, span_m: float) -> None:
    vehicle = load_vehicle(name)
    world = with_vehicles(load_world(load_scene("meadow")), {"plane": vehicle})
    frames = SharedFrames(world)
    frames.place("plane", _truth((0.0, 0.0, HEIGHT_M)))
    camera = CameraModel.from_fov(801, 801, math.degrees(2.0 * math.atan(2.0 / 10.0)))
    out = {channel: CHANNELS[channel].empty(801, 801) for channel in ("depth", "segmentation")}
    frames.expect(0)
    above = Mount(ZERO, (0.0, 90.0, 0.0)).pose(_truth((0.0, 0.0, HEIGHT_M + 10.0)))
    frames.renderer(camera, shadows=False, supersample=1, near_m=0.05, far_m=1e3).render(above, out)
    drone = out["segmentation"] == world.class_names.index("drone")
    assert np.array_equal(drone, out["depth"] < 15.0)
    across = np.flatnonzero(drone.any(axis=0))
    m_per_pixel = 4.0 / 801
    assert np.ptp(across) * m_per_pixel == pytest.approx(span_m, rel=0.05)
    force = wing(vehicle)
    area_m2 = np.count_nonzero(drone) * m_per_pixel**2
    chord_m = force.mean_chord_m
    assert chord_m is not None
    assert span_m * chord_m * 0.9 < area_m2 < span_m * chord_m * 1.6  # the wing, body and tail besides


def _truth(p_WB: tuple[float, float, float]) -> TruthState:
    return TruthState(0, 0, p_WB, NO_TURN, ZERO, ZERO, ZERO, ZERO, (0.0,), False)
