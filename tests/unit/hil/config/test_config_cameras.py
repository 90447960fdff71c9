"""Cameras in a bench file: valid ones are resolved, wrong values are named with their line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import Bench, load_bench, resolved_yaml
from tests.worlds import bench_files
from tests.worlds.bench_files import FLIGHT_SENSORS, elsewhere  # noqa: F401 (the fixture is for every test)


def load(camera: str, more: str = "") -> Bench:
    return bench_files.load(f"{FLIGHT_SENSORS}  front: {camera}\n{more}")


def refused(camera: str, more: str = "") -> str:
    (problem,) = bench_files.refused(f"{FLIGHT_SENSORS}  front: {camera}\n{more}")
    return problem


def test_a_camera_needs_no_preset() -> None:
    text = "{kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 10, channels: [rgb, depth, segmentation]}"
    bench = load(text)
    front = bench.config.sensors["front"]
    assert (front.kind, front.preset, front.autopilot) == ("camera", None, False)
    assert front.parameters.channels == ("rgb", "depth", "segmentation")
    assert front.parameters.model().fx == pytest.approx(160.0, abs=1e-12)


def test_a_preset_with_everything_over_it_survives_being_saved() -> None:
    text = """
    preset: raspberry_pi_camera_v2
    rate_hz: 20
    fov_deg: null
    intrinsics: {fx: 500.25, fy: 501.5, cx: 400.125, cy: 300.0625}
    distortion: {model: brown_conrady, k1: -0.1, p1: 0.001}
    mount_m: [0.1, 0, -0.02]
    mount_rpy_deg: [0, 20, 0]
    motion_blur: {exposure_s: 0.008}
    depth_noise: {sigma_m: 0.01}
    exposure: {auto: true}
    channels: [rgb, depth]
"""
    bench = load(text)
    Path("again.yaml").write_text(resolved_yaml(bench.config))
    again = load_bench("again.yaml")
    assert again.config.sensors == bench.config.sensors
    assert again.config.sensors["front"].parameters.noise.electrons_at_white == 4300.0


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("{kind: camera, rate_hz: 10, fov_deg: 90}", "resolution"),
        ("{kind: camera, rate_hz: 10, resolution: [320, 240]}", "needs fov_deg or intrinsics"),
        ("{preset: camera_320x240, rate_hz: 10, fov_deg: 180}", "between 0 and 180 degrees, not 180"),
        ("{preset: camera_320x240, rate_hz: 10, resolution: [0, 240]}", "resolution"),
        ("{preset: camera_320x240, rate_hz: 10, channels: [rbg]}", "channels"),
        ("{preset: camera_320x240, rate_hz: 10, distortion: {model: brown_conrady, k1: -0.9}}", "share a pixel"),
        ("{preset: camera_320x240, rate_hz: 10, mount_m: [1, 2]}", "mount_m"),
        ("{preset: camera_320x240, rate_hz: 10, autopilot: true}", "no flight controller takes a camera"),
        ("{preset: camera_320x24, rate_hz: 10}", "did you mean 'camera_320x240'?"),
        ("{preset: camera_320x240, rate_hz: 10, colour: egl, rolling_shutter_s: 0.01}", "whole picture at once"),
    ],
)
def test_wrong_values_are_named_with_their_line(camera: str, message: str) -> None:
    text = refused(camera)
    assert text.startswith("b.yaml:6: sensors.front")
    assert message in text


def test_only_freezing_and_dropping_out_are_faults_of_a_camera() -> None:
    camera = "{preset: camera_320x240, rate_hz: 10}"
    load(camera, "faults: {sensors: [{kind: dropout, sensor: front, at_s: 1}]}\n")
    text = refused(camera, "faults: {sensors: [{kind: offset, sensor: front, at_s: 1, value: 2}]}\n")
    assert text.startswith("b.yaml:7: faults.sensors[0].kind")
    assert "can only freeze or drop out" in text
