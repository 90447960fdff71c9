"""The camera sensor: what a sample holds, its independence, and its options against a renderer made of formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pydantic
import pytest

from signals.channels import CHANNELS
from signals.samples import CHANNEL_UNITS, ImageSample, RadarSample, TruthState
from sim.frame.shading import PLAIN
from sim.scene.scene import load_scene
from sim.sensors.camera import Camera
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.faults import FAULT_LIST, FaultySensor, fault_problems
from sim.sensors.sensor import Installation
from tests.worlds.installed_sensor import installed
from tests.worlds.spheres_world import FormulaFrames

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
ALL = tuple(CHANNEL_UNITS)
ZERO = (0.0, 0.0, 0.0)
NOISE = {"electrons_at_white": 3000.0, "read_noise_electrons": 5.0}
CAMERAS = sorted(name for name, preset in PRESETS.items() if preset.kind == "camera")


def camera(frames: FormulaFrames | None = None, *, seed: int = 1, name: str = "front", **values: Any) -> Camera:
    overrides = {"resolution": (64, 48), "channels": ("rgb", "depth")} | values
    made = installed(
        name, SCENE, preset="camera_320x240", overrides=overrides, seed=seed, frames=frames or FormulaFrames()
    )
    assert isinstance(made, Camera)
    return made


def truth(k: int = 0, **values: Any) -> TruthState:
    state = TruthState(k, k * TICK_NS, (0.0, 0.0, 2.0), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return state._replace(**values)


def test_a_sample_holds_the_channels_asked_for_in_their_format() -> None:
    frames = FormulaFrames()
    sample = camera(frames, channels=ALL, latency_s=0.05).sample(truth(25), 3)
    assert isinstance(sample, ImageSample)
    assert sample[:3] == (3, 100_000_000, 150_000_000)
    assert set(sample.channels) == set(ALL) == set(CHANNELS)
    for name, picture in sample.channels.items():
        assert picture.dtype == CHANNELS[name].dtype
        assert picture.shape == CHANNELS[name].shape(48, 64)
        assert not picture.flags.writeable
    assert frames.expected == [100_000_000]
    assert len(frames.drawn) == 1  # one drawing for all of them
    depth, range_m = sample.channels["depth"], sample.channels["range"]
    seen = np.isfinite(depth)
    assert depth[seen] == pytest.approx((range_m * camera().model.rays()[:, :, 2])[seen], rel=1e-6)


def test_only_wanted_channels_are_drawn() -> None:
    frames = FormulaFrames()
    camera(frames, channels=("depth",), noise=NOISE).sample(truth(), 0)
    assert frames.drawn == [(("depth",), None)]


NOISY: dict[str, Any] = {
    "noise": NOISE,
    "vignetting": 0.5,
    "depth_noise": {"sigma_m": 0.01, "sigma_per_m": 0.001},
}


@pytest.mark.parametrize("channel", ["rgb", "depth"])
def test_noise_is_of_seed_name_and_number_alone(channel: str) -> None:
    options = NOISY
    steady, skipping = camera(**options), camera(**options)
    expected = [steady.sample(truth(), k).channels[channel] for k in range(6)]
    assert np.array_equal(skipping.sample(truth(), 5).channels[channel], expected[5])
    assert np.array_equal(skipping.sample(truth(), 2).channels[channel], expected[2])
    for other in (camera(seed=2, **options), camera(name="rear", **options)):
        assert not np.array_equal(other.sample(truth(), 2).channels[channel], expected[2])
    # One channel's noise does not hang on whether the other is wanted.
    alone = camera(**(options | {"channels": (channel,)}))
    assert np.array_equal(alone.sample(truth(), 5).channels[channel], expected[5])


def test_noise_leaves_the_other_channels_alone() -> None:
    exact = camera(channels=ALL).sample(truth(), 0).channels
    noisy = camera(channels=ALL, **NOISY).sample(truth(), 0).channels
    for name in ALL:
        assert np.array_equal(exact[name], noisy[name], equal_nan=name == "depth") == (name not in ("rgb", "depth"))


def test_a_height_that_is_no_multiple_of_four_is_drawn_to_its_last_row() -> None:
    frames = FormulaFrames()
    camera(frames, resolution=(8, 10), rolling_shutter_s=0.01).sample(truth(), 0)
    assert [rows for _, rows in frames.drawn] == [(0, 4), (4, 8), (8, 10)]


def test_motion_blur_is_the_mean_of_light_over_the_exposure() -> None:
    frames = FormulaFrames()
    blur = {"exposure_s": 0.02, "frames": 8}
    state = truth(w_WB_B=(0.0, 0.0, 2.0))
    sample = camera(frames, motion_blur=blur).sample(state, 0)
    assert [channels for channels, _ in frames.drawn] == [("depth",)] + [("rgb",)] * 8
    assert np.array_equal(sample.channels["depth"], camera().sample(state, 0).channels["depth"])
    sharp = camera().sample(state, 0).channels["rgb"]
    mixed = np.any(sample.channels["rgb"] != sharp, axis=2)
    assert 0 < mixed.sum() < 0.3 * mixed.size  # the edges of the balls, and nothing else
    rest = camera(motion_blur=blur).sample(truth(), 0).channels["rgb"]
    assert np.array_equal(rest, camera().sample(truth(), 0).channels["rgb"])


def test_auto_exposure_finds_its_target_and_says_nothing_of_the_first_picture() -> None:
    made = camera(exposure={"auto": True, "target": 0.18, "gain": 0.2}, channels=("rgb",))
    fixed = camera(exposure={"gain": 0.2}, channels=("rgb",))
    pictures = [made.sample(truth(), k).channels["rgb"] for k in range(20)]
    assert np.array_equal(pictures[0], fixed.sample(truth(), 0).channels["rgb"])
    s = pictures[-1] / 255.0
    light = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)
    assert light.mean() == pytest.approx(0.18, rel=0.02)


def test_moving_things_and_the_camera_itself_are_in_the_radial_velocity() -> None:
    made = camera(channels=("radial_velocity", "geom"))
    at_rest = made.sample(truth(), 0).channels
    assert np.all(at_rest["radial_velocity"][at_rest["geom"] != 2] == 0.0)
    flying = made.sample(truth(v_WB_W=(3.0, 0.0, 0.0)), 1).channels
    middle = flying["radial_velocity"][23:25, 31:33]
    assert middle == pytest.approx(np.full((2, 2), -3.0), abs=0.01)  # straight at the ball


def test_a_camera_freezes_and_drops_out_and_takes_no_other_fault() -> None:
    faults = FAULT_LIST.validate_python(
        [
            {"kind": "freeze", "sensor": "front", "at_s": 0.01, "until_s": 0.02},
            {"kind": "dropout", "sensor": "front", "at_s": 0.02, "until_s": 0.03},
        ]
    )
    broken = FaultySensor(camera(noise=NOISE), faults)
    good = camera(noise=NOISE)
    got = [broken.sample(truth(k), k) for k in range(10)]
    expected = [good.sample(truth(k), k) for k in range(10)]
    assert got[:3] == expected[:3]
    assert got[3] is not None
    assert got[3][:3] == expected[3][:3]
    assert np.array_equal(got[3].channels["rgb"], expected[2].channels["rgb"])
    assert got[5:8] == [None] * 3
    assert got[8:] == expected[8:]
    (offset,) = FAULT_LIST.validate_python([{"kind": "offset", "sensor": "front", "at_s": 0.0, "value": 1.0}])
    for sample_type in (ImageSample, RadarSample):
        ((_, key, text),) = fault_problems([offset], {"front": sample_type})
        assert key == "kind"
        assert "can only freeze or drop out" in text


@pytest.mark.parametrize("preset", CAMERAS)
def test_every_preset_takes_a_picture(preset: str) -> None:
    frames = FormulaFrames()
    values = {"rate_hz": 10.0, "seed": 1, "scene": SCENE, "step_ns": TICK_NS, "frames": frames}
    sample = make_sensor(Installation("c", **values), preset=preset).sample(truth(w_WB_B=(0.0, 0.0, 0.5)), 0)
    assert isinstance(sample, ImageSample)
    width, height = PRESETS[preset].parameters.resolution  # type: ignore[attr-defined]
    assert {picture.shape[:2] for picture in sample.channels.values()} == {(height, width)}
    options = {"shadows": False, "supersample": 1, "near_m": 0.05, "far_m": 10_000.0}
    options |= {"shading": PLAIN, "colour": "native", "samples": None}
    assert frames.options[0] == options


OFF_CENTRE = {"fov_deg": None, "intrinsics": {"fx": 50.0, "fy": 50.0, "cx": 30.0, "cy": 20.0}}
NOT_SQUARE = {"fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5}


@pytest.mark.parametrize(
    "values",
    [
        {"colour": "egl", **OFF_CENTRE},
        {"colour": "filament", "fov_deg": None, "intrinsics": NOT_SQUARE},
        {"colour": "egl", "motion_blur": {"exposure_s": 0.01}},
        {"rolling_shutter_s": 0.01, "supersample": 2},
        {"colour": "path_traced", "samples": 4, "rolling_shutter_s": 0.01, "textures": False},
        {"colour": "path_traced", "distortion": {"model": "kannala_brandt"}},
    ],
)
def test_what_another_renderer_can_draw_is_not_refused(values: dict[str, Any]) -> None:
    assert camera(**values).channels == ("rgb", "depth")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fov_deg": None}, "fov_deg or intrinsics"),
        ({"intrinsics": {"fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}}, "fov_deg or intrinsics"),
        ({"fov_deg": 0.0}, "greater than 0"),
        ({"fov_deg": 180.0}, "between 0 and 180"),
        ({"fov_deg": 221.0}, "less than or equal to 220"),
        ({"resolution": (0, 48)}, "greater than or equal to 1"),
        ({"resolution": (64, 8193)}, "less than or equal to 8192"),
        ({"channels": ()}, "at least one channel"),
        ({"channels": ("rgb", "rgb")}, "named twice"),
        ({"channels": ("colour",)}, "no channel 'colour'; channels: rgb, depth"),
        ({"near_m": 2.0, "far_m": 1.0}, "far_m 1 must be above near_m 2"),
        ({"distortion": {"model": "brown_conrady", "k1": -0.9}}, "two directions share a pixel"),
        ({"distortion": {"k1": 0.1}}, "needs a model: brown_conrady or"),
        ({"distortion": {"model": "pinhole"}}, "kannala_brandt"),
        ({"depth_noise": {"step_m": 0.1, "inverse_step_per_m": 0.1}}, "one of the two"),
        ({"exposure": {"max_gain": 0.1, "min_gain": 0.2}}, "must be above min_gain"),
        ({"motion_blur": {"exposure_s": 0.01, "frames": 1}}, "greater than or equal to 2"),
        ({"resolution": (5000, 8), "supersample": 2}, "at most 4096 pixels across"),
        ({"supersample": 3}, "supersample"),
        ({"colour": True}, "colour"),
        ({"colour": "egl", "rolling_shutter_s": 0.01}, "'egl' draws the whole picture at once: no rolling_shutter_s"),
        ({"colour": "filament", "supersample": 2}, "'filament' draws the whole picture at once: supersample 1"),
        ({"colour": "egl", "distortion": {"model": "kannala_brandt"}}, "'egl' draws pinhole cameras only"),
        ({"colour": "egl", **OFF_CENTRE, "intrinsics": NOT_SQUARE}, "'egl' draws square pixels only"),
        ({"colour": "path_traced", "supersample": 2}, "'path_traced' has `samples` paths per pixel"),
        ({"colour": "path_traced", "resolution": (8192, 8192)}, "'path_traced' draws at most 16777216 pixels"),
        ({"samples": 8}, "samples are the paths of `colour: path_traced`"),
        ({"colour": "filament", **OFF_CENTRE}, "'filament' needs the optical axis in the middle"),
    ],
)
def test_absurd_parameters_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=message):
        camera(**values)
