"""The power of a spinning radar against a direct sum over dense points of surfaces, and its noise against its laws.

The sum is the radar equation point by point, with its own pattern, reflection and window, and no rays.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.samples import TruthState, Vec3
from sim.frame.source import SharedFrames
from sim.radar.spinning import SpinningBeam
from sim.scene.scene import load_scene
from sim.scene.world import World
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.sensor import Installation
from sim.sensors.spinning_radar import SpinningRadar, SpinningRadarParameters
from tests.reference.test_radar_bounces import BALL, BOX, CONCRETE, ROUGH, ball, crate, world_of
from tests.worlds.radar_paths import Patch, bistatic, face

WALL = '<geom name="wall" type="box" size=".1 4 2" pos="12.1 3 2" material="concrete"/>'
GROUND = '<geom name="ground" type="box" size="9 9 .1" pos="12 0 -.1" material="rough"/>'
HEIGHT_M = 1.8
AZIMUTHS, BINS, BIN_M = 400, 512, 0.0438
VALUES: dict[str, Any] = {
    "bins": BINS,
    "elevation_deg": [-40.0, 20.0],
    "columns_per_azimuth": 4,
    "elevation_spacing_deg": 0.25,
    "rolling": False,
    "antenna": {"gain_dbi": 32.0, "azimuth_beamwidth_deg": 1.8, "elevation_beamwidth_deg": 20.0},
}


def parameters(**changed: Any) -> SpinningRadarParameters:
    p = PRESETS["navtech_cts350x"].parameters
    assert isinstance(p, SpinningRadarParameters)
    return SpinningRadarParameters.model_validate(p.model_dump() | VALUES | changed)


def radar_in(world: World, **changed: Any) -> SpinningRadar:
    made = Installation(
        name="radar", rate_hz=4.0, seed=1, scene=load_scene("airfield"), step_ns=4_000_000, frames=SharedFrames(world)
    )
    return SpinningRadar(made, parameters(**changed))


def truth_at(p_WB: Vec3) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    return TruthState(0, 10**9, p_WB, (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), False)


def gain(off_deg: NDArray[np.float64], beamwidth_deg: float) -> NDArray[np.float64]:
    """Return the cosine's power that is a half at half the beamwidth."""
    exponent = math.log(0.5) / math.log(math.cos(math.radians(0.5 * beamwidth_deg)))
    return np.maximum(np.cos(np.radians(off_deg)), 0.0) ** exponent


def direct_sum(patches: list[Patch], p: SpinningRadarParameters) -> NDArray[np.float64]:
    """Return the power by azimuth and bin of points that all are in sight."""
    total = np.zeros((AZIMUTHS, BINS))
    wavelength_m = 299_792_458.0 / p.frequency_hz
    scale = 1e-3 * 10 ** (0.1 * p.tx_power_dbm) * 10 ** (0.2 * p.antenna.gain_dbi) * wavelength_m**2
    scale /= (4.0 * math.pi) ** 3
    axis_deg = 360.0 * np.arange(AZIMUTHS) / AZIMUTHS
    for patch in patches:
        beyond = patch.point_W - np.array([0.0, 0.0, HEIGHT_M])
        r = np.sqrt((beyond**2).sum(axis=1))
        d = beyond / r[:, None]
        cosine = -(d * patch.normal_W).sum(axis=1)
        facing = cosine > 0.0
        r, d, normal = r[facing], d[facing], patch.normal_W[facing]
        sigma0 = bistatic(patch.surface, p.frequency_hz, -d, -d, normal)
        elevation_deg = np.degrees(np.arcsin(d[:, 2]))
        sigma = sigma0 * patch.area_m2[facing] / r**4
        power = scale * sigma * gain(elevation_deg, p.antenna.elevation_beamwidth_deg) ** 2
        azimuth_deg = np.degrees(-np.arctan2(d[:, 1], d[:, 0]))
        for k in range(AZIMUTHS):
            off_deg = (azimuth_deg - axis_deg[k] + 180.0) % 360.0 - 180.0
            near = np.abs(off_deg) < 4.0
            if not near.any():
                continue
            two_way = gain(off_deg[near], p.antenna.azimuth_beamwidth_deg) ** 2 * power[near]
            place = r[near] / BIN_M
            below = np.floor(place).astype(int)
            for tap in (-1, 0, 1, 2):
                x = place - below - tap
                response = (np.sinc(x) / (1.0 - x * x + 1e-12)) ** 2
                response[np.abs(np.abs(x) - 1.0) < 1e-6] = 0.25
                kept = (below + tap < BINS) & (place < BINS - 1)
                np.add.at(total[k], (below + tap)[kept], (two_way * response)[kept])
    return total


SCENES: dict[str, tuple[tuple[str, ...], list[Patch]]] = {
    "ball": ((BALL,), ball()),
    "crate": ((BOX,), crate()),
    "wall": ((WALL,), [face((12.0, 3.0, 2.0), (0, 0, 2.0), (0, 4.0, 0), (120, 240), CONCRETE)]),
    "ground": (
        (GROUND,),
        [
            face((12.0, 0.0, 0.0), (9.0, 0, 0), (0, 9.0, 0), (500, 250), ROUGH),
            face((3.0, 0.0, -0.1), (0, 0, 0.1), (0, 9.0, 0), (10, 250), ROUGH),
        ],
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_power_is_that_of_the_direct_sum(tmp_path: Path, name: str) -> None:
    geoms, patches = SCENES[name]
    radar = radar_in(world_of(tmp_path, *geoms))
    radar.sample(truth_at((0.0, 0.0, HEIGHT_M)), 0)
    found, true = radar.power_w, direct_sum(patches, parameters())
    total_db = 10.0 * math.log10(found.sum() / true.sum())
    by_azimuth, true_by_azimuth = found.sum(axis=1), true.sum(axis=1)
    strong = true_by_azimuth > 0.1 * true_by_azimuth.max()
    azimuth_db = 10.0 * np.log10(by_azimuth[strong] / true_by_azimuth[strong])
    bins = np.arange(BINS) * BIN_M
    range_m = float((found * bins).sum() / found.sum() - (true * bins).sum() / true.sum())
    print(f"{name}: total {total_db:.2f} dB, azimuth {np.abs(azimuth_db).max():.2f} dB, range {range_m * 1e3:.1f} mm")
    assert abs(total_db) < 0.3
    assert np.abs(azimuth_db).max() < 1.0
    assert abs(range_m) < 0.01
    if name == "ground":  # no rings of rows of rays
        profile, true_profile = found[:20].sum(axis=0)[90:400], true[:20].sum(axis=0)[90:400]
        ripple_db = 10.0 * np.log10(profile / true_profile)
        print(f"range by range, 4 to 17 m: {np.sqrt(np.mean(ripple_db**2)):.2f} dB rms")
        assert np.sqrt(np.mean(ripple_db**2)) < 0.5


def test_noise_and_codes() -> None:
    """Codes of noise alone have an exponential's mean and deviation, a strong echo those of its sum with noise."""
    bits = np.random.Philox(1).random_raw(AZIMUTHS * BINS).reshape(AZIMUTHS, BINS)

    def received(over_noise: float, p: SpinningRadarParameters) -> NDArray[np.float64]:
        beam = SpinningBeam(p, ())
        codes = beam.codes(np.full((AZIMUTHS, BINS), over_noise * beam.noise_w), bits).astype(np.float64)
        return np.asarray(1e-3 * 10 ** (0.1 * (p.floor_dbm + codes * p.step_db)) / beam.noise_w)

    alone = received(0.0, parameters(floor_dbm=-160.0))
    assert alone.mean() == pytest.approx(1.0, abs=0.01)
    assert alone.std() == pytest.approx(1.0, abs=0.02)
    strong = received(1e4, parameters(floor_dbm=-94.0, step_db=0.05))
    assert strong.mean() == pytest.approx(1e4 + 1.0, rel=0.001)
    assert strong.std() == pytest.approx(math.sqrt(2.0 * 1e4 + 1.0), rel=0.05)


def test_points_are_where_objects_are(tmp_path: Path) -> None:
    world = world_of(tmp_path, BALL, BOX)
    radar = radar_in(world)
    sample = radar.sample(truth_at((0.0, 0.0, HEIGHT_M)), 0)
    instance = radar.instances()
    assert len(instance) == len(sample.range_m) > 0
    for name, place in {"ball": (5.0, -0.6), "crate": (4.5, -0.8)}.items():
        points = sample.points_L[instance == world.instance_names.index(name)]
        assert len(points) > 0
        assert np.abs(points[:, :2].mean(axis=0) - place).max() < 0.6
    assert not sample.points_L[:, 2].any()
    again = radar_in(world).sample(truth_at((0.0, 0.0, HEIGHT_M)), 0)
    other = radar_in(world).sample(truth_at((0.0, 0.0, HEIGHT_M)), 1)
    assert np.array_equal(again.intensity, sample.intensity)
    assert other.intensity.shape != sample.intensity.shape or not np.array_equal(other.intensity, sample.intensity)


def test_a_revolution_of_a_moving_vehicle(tmp_path: Path) -> None:
    """Each azimuth is measured on the way: a wall ahead, first seen, is farther than from where the revolution ends."""
    world = world_of(tmp_path, WALL)
    truth = truth_at((0.0, 2.0, HEIGHT_M))._replace(v_WB_W=(8.0, 0.0, 0.0))
    radar = radar_in(world, rolling=True, antenna=VALUES["antenna"] | {"azimuth_beamwidth_deg": 0.9})
    sample = radar.sample(truth, 0)
    first = sample.time_offset_ns == sample.time_offset_ns.min()
    assert -250_000_000 <= int(sample.time_offset_ns.min()) < -249_000_000
    moved_m = -8.0 * 1e-9 * float(sample.time_offset_ns.min())
    assert float(sample.range_m[first].min()) == pytest.approx(12.0 + moved_m, abs=0.05)


def test_refusals(tmp_path: Path) -> None:
    made = Installation(name="radar", rate_hz=4.0, seed=1, scene=load_scene("airfield"), step_ns=4_000_000)
    with pytest.raises(ValueError, match="needs the world's geometry"):
        make_sensor(made, preset="navtech_cts350x")
    with pytest.raises(ValueError, match="is empty"):
        radar_in(world_of(tmp_path, BALL), elevation_deg=[3.0, 3.0])
