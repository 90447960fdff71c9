"""Another vehicle in the radar: label, cross-section, and the speeds of its rotor blades."""

from __future__ import annotations

import numpy as np
import pytest

from hil.apps.bench_suite.sensors.radar_cases import RadarView, radar_parameters, radar_view, synthesizer
from hil.apps.bench_suite.sensors.radar_checks import cross_section_dbsm
from hil.apps.bench_suite.sensors.raster_cases import View, camera_pose, looking
from sim.frame.mount import quaternion_of_rpy
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_bodies import VehicleBodies, with_vehicles
from sim.radar.object_echoes import ObjectEchoes
from sim.radar.processing.processor import Processor
from sim.radar.rotor_blades import RotorBlades
from sim.scene.scene import load_scene
from sim.world_loader import load_world

P = radar_parameters()
POSE = camera_pose(np.array([0.0, 0.0, 30.0]), looking(0.0, 0.0))
PERIOD_NS = 50_000_000
PLACE = np.array([3.5, 0.6, 30.3])
V_MPS = (1.5, 0.2, 0.0)


@pytest.fixture(scope="module")
def view() -> RadarView:
    world = with_vehicles(load_world(load_scene("airfield")), {"wing": load_vehicle("x500")})
    return radar_view(world, P, "instance")


def draw(view: RadarView, k: int, rotors_radps: float) -> View:
    """Draw frame `k` >= 1; each begins the vehicle's states anew if it is earlier than the last."""
    actor = view.world.map.actors[-1]
    assert isinstance(actor, VehicleBodies)
    q = quaternion_of_rpy((4.0, 6.0, 20.0))
    p = (float(PLACE[0]), float(PLACE[1]), float(PLACE[2]))
    actor.place_at(k * PERIOD_NS, p, q, V_MPS, (0.1, -0.2, 0.3), (rotors_radps,) * 4)
    drawn = View(k * PERIOD_NS, POSE)
    view.draw(drawn)
    return drawn


def test_seen_speeds_differ_by_whole_spans_and_at_blades_only(view: RadarView) -> None:
    draw(view, 1, 530.0)
    blades = view.blades.mask(view.picture)
    assert blades is not None
    assert blades.sum() > 5
    seen, true = view.blades.with_seen_speeds(view.picture, P.chirp)["radial_velocity"], view.picture["radial_velocity"]
    np.testing.assert_array_equal(seen[~blades], true[~blades])
    v_max = P.chirp.max_speed_mps
    assert np.abs(true[blades]).max() > 2.0 * v_max
    assert np.abs(seen[blades]).max() <= v_max * (1.0 + 1e-6)
    spans = (true[blades] - seen[blades]) / (2.0 * v_max)
    np.testing.assert_allclose(spans, np.rint(spans), atol=1e-4)


def test_a_world_without_vehicles_has_no_blades() -> None:
    picture = {"material": np.ones((2, 2), np.uint8), "radial_velocity": np.full((2, 2), 50.0, np.float32)}
    blades = RotorBlades(load_world(load_scene("airfield")))
    assert blades.mask(picture) is None
    assert blades.with_seen_speeds(picture, P.chirp) is picture


@pytest.mark.parametrize("rotors_radps", [0.0, 530.0])
def test_the_label_of_a_vehicle_has_its_place_and_the_speed_of_its_body(view: RadarView, rotors_radps: float) -> None:
    drawn = draw(view, 5 if rotors_radps else 3, rotors_radps)
    finder = ObjectEchoes(view.scatterers.camera, view.world, P.chirp, P.antenna, P.receiver, P.mask)
    (label,) = [
        o for o in finder.find(view.picture, drawn.pose) if view.world.instance_names[o.instance] == "drone:wing"
    ]
    d = PLACE - [0.0, 0.0, 30.0]
    assert label.range_m == pytest.approx(np.linalg.norm(d), abs=0.25)
    assert label.speed_mps == pytest.approx(np.dot(V_MPS, d) / np.linalg.norm(d), abs=0.05)
    assert label.azimuth_rad == pytest.approx(np.arctan2(d[1], d[0]), abs=0.05)
    assert label.elevation_rad == pytest.approx(np.arcsin(d[2] / np.linalg.norm(d)), abs=0.05)


def test_turning_rotors_spread_the_speeds_at_the_range_of_the_vehicle(view: RadarView) -> None:
    """Power at the vehicle's range and more than 0.5 m/s from its body, without noise: 20 frames each."""
    transform, n_rx = synthesizer(P, "nufft", 1e-4), len(P.antenna.rx_positions_m)
    signal = np.empty((n_rx, P.chirp.chirps, P.chirp.samples))
    processor = Processor(P.chirp, P.antenna.rx_positions_m, P.processing)
    column = round(float(np.linalg.norm(PLACE - [0.0, 0.0, 30.0])) / P.chirp.range_resolution_m)

    def spread(rotors_radps: float, first: int) -> float:
        total = 0.0
        for k in range(first, first + 20):
            transform.synthesize(view.echoes(draw(view, k, rotors_radps)), signal)
            scale = 30_000.0 / float(np.abs(signal).max())  # so that rounding does not matter
            raw = np.rint(scale * signal + 32_768.0).astype(np.uint16)
            power = processor.process(raw, k * PERIOD_NS, until="range_doppler").range_doppler
            speeds = (np.arange(len(power)) - len(power) // 2) * 2.0 * P.chirp.max_speed_mps / len(power)
            padding = power.shape[1] // (P.chirp.samples // 2)
            near = power[:, padding * (column - 1) : padding * (column + 2)].sum(axis=1)
            total += float(near[np.abs(speeds - 1.5) > 0.5].sum()) / scale**2
        return total

    assert spread(530.0, 100) > 5.0 * spread(0.0, 200)


def test_the_cross_section_is_that_of_measured_drones() -> None:
    """Five drones from Phantom 3 to Matrice 600, at 24 GHz (IEICE Communications Express 9, 2020, no. 7, p. 262)."""
    assert -19.1 < cross_section_dbsm("x500", views=24) < -8.1
