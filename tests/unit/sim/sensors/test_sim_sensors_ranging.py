"""Downward range finder and optical flow: geometry against brute force and closed forms, limits, statistics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.samples import TruthState
from sim._kernels import BoxScene
from sim.scene.scene import Box, Scene, load_scene
from sim.scene.weather import Weather
from tests.worlds.installed_sensor import installed

FIELD = load_scene("airfield")
ZERO = (0.0, 0.0, 0.0)
IDEAL_RANGE: dict[str, Any] = {
    "min_distance_m": 0.1,
    "max_distance_m": 100.0,
    "noise_m": 0.0,
    "resolution_m": 1e-9,
    "max_tilt_deg": 89.0,
}
IDEAL_FLOW: dict[str, Any] = {
    "min_distance_m": 0.1,
    "max_distance_m": 100.0,
    "max_flow_radps": 50.0,
    "flow_noise_radps": 0.0,
    "flow_resolution_rad": 1e-12,
    "gyro_noise_radps_per_rthz": 0.0,
    "gyro_turn_on_bias_radps": 0.0,
    "gyro_resolution_rad": 1e-12,
    "has_range": True,
    "max_tilt_deg": 89.0,
}


def made(kind: str, values: dict[str, Any], *, scene: Scene = FIELD, seed: int = 1, rate_hz: float = 50.0) -> Any:
    return installed("r", scene, kind=kind, overrides=values, rate_hz=rate_hz, seed=seed)


def at(height_m: float, **changes: Any) -> TruthState:
    truth = TruthState(0, 0, (0.0, 0.0, height_m), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return truth._replace(**changes)


def rolled(angle_rad: float) -> tuple[float, float, float, float]:
    return (math.cos(angle_rad / 2), math.sin(angle_rad / 2), 0.0, 0.0)


def marched(origin: np.ndarray, direction: np.ndarray, boxes: list[tuple[float, ...]]) -> float:
    """First of many points along the ray that lies under the ground or in a box; -1 if none does."""
    s = np.arange(0.0, 60.0, 0.002)
    points = origin + s[:, None] * direction
    inside = points[:, 2] <= 0.0
    for box in boxes:
        inside |= np.all(np.abs(points - np.array(box[:3])) <= np.array(box[3:]), axis=1)
    hits = np.flatnonzero(inside)
    return float(s[hits[0]]) if hits.size else -1.0


unit = st.floats(-1.0, 1.0).filter(lambda x: abs(x) > 1e-3)


@settings(max_examples=60)
@given(st.tuples(unit, unit, unit), st.tuples(unit, unit, unit))
def test_ray_against_marching(where: tuple[float, ...], way: tuple[float, ...]) -> None:
    boxes = [(0.0, 0.0, 1.0, 2.0, 1.0, 1.0), (4.0, 1.0, 3.0, 1.0, 2.0, 3.0), (-3.0, -3.0, 0.5, 0.5, 0.5, 0.5)]
    origin = np.array(where) * 8.0 + np.array([0.0, 0.0, 6.0])
    direction = np.array(way) / np.linalg.norm(way)
    found = BoxScene(boxes).ray_distance(tuple(origin), tuple(direction))
    marching = marched(origin, direction, boxes)
    if marching < 0.0:
        assert found < 0.0 or found > 59.0 or grazing(origin, direction, boxes, found)
    else:
        assert 0.0 <= found <= marching + 1e-9
        assert marching - found < 0.0021 or grazing(origin, direction, boxes, found)


def grazing(origin: np.ndarray, direction: np.ndarray, boxes: list[tuple[float, ...]], s: float) -> bool:
    """Return True if the hit cuts a corner so short that the march steps over it."""
    points = origin + (s + np.linspace(0.0, 0.002, 50))[:, None] * direction
    return any(
        0 < np.count_nonzero(np.all(np.abs(points - np.array(b[:3])) <= np.array(b[3:]) + 1e-12, axis=1)) < 50
        for b in boxes
    )


@pytest.mark.parametrize(
    ("origin", "direction", "distance"),
    [
        ((0.0, 0.0, 5.0), (0.0, 0.0, -1.0), 3.0),  # on the box
        ((5.0, 0.0, 5.0), (0.0, 0.0, -1.0), 5.0),  # beside it
        ((5.0, 0.0, 5.0), (0.0, 0.0, 1.0), -1.0),  # up
        ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.0),  # from inside
        ((5.0, 0.0, -1.0), (0.0, 0.0, 1.0), 0.0),  # from under the ground
        ((5.0, 0.0, 1.0), (-1.0, 0.0, 0.0), 4.0),  # level, at the side of the box
        ((5.0, 0.0, 1.0), (1.0, 0.0, 0.0), -1.0),  # level, away
        ((1.0, 0.0, 5.0), (0.0, 0.0, -1.0), 3.0),  # along its edge
    ],
)
def test_ray_special_cases(origin: Any, direction: Any, distance: float) -> None:
    assert BoxScene([(0.0, 0.0, 1.0, 1.0, 1.0, 1.0)]).ray_distance(origin, direction) == distance


@given(st.floats(0.5, 20.0), st.floats(-1.2, 1.2))
def test_range_over_a_plane_is_height_over_cosine(height_m: float, roll_rad: float) -> None:
    sample = made("range_finder", IDEAL_RANGE).sample(at(height_m, q_WB=rolled(roll_rad)), 0)
    assert sample.distance_m == pytest.approx(height_m / math.cos(roll_rad), abs=1e-7)
    assert sample.quality == 100


def test_a_range_finder_looks_where_its_mount_looks() -> None:
    wall = Box(name="wall", center_m=(11.0, 0.0, 5.0), size_m=(2.0, 40.0, 10.0))
    scene = FIELD.model_copy(update={"boxes": (wall,)})

    def distance(*rpy_deg: float, **pose: Any) -> tuple[float, tuple[float, ...]]:
        sample = made("range_finder", IDEAL_RANGE | {"mount_rpy_deg": rpy_deg}, scene=scene).sample(at(5.0, **pose), 0)
        return sample.distance_m, sample.axis_B

    c = math.sqrt(0.5)
    assert distance(0, 90, 0) == (pytest.approx(5.0), (0.0, 0.0, -1.0))  # as without the key
    assert distance(0, 0, 0) == (pytest.approx(10.0), (1.0, 0.0, 0.0))
    assert distance(0, 60, 0)[0] == pytest.approx(5.0 / math.sin(math.radians(60.0)))
    assert distance(0, 0, 45) == (pytest.approx(10.0 / c), pytest.approx((c, c, 0.0)))
    assert distance(0, 45, 180) == (pytest.approx(5.0 / c), pytest.approx((-c, 0.0, -c)))
    # Turned to the left by 90 degrees, a sensor on the right side looks at the wall.
    assert distance(0, 0, -90, q_WB=(c, 0.0, 0.0, c))[0] == pytest.approx(10.0)


def test_range_sees_boxes_and_its_own_place() -> None:
    box = Box(name="roof", center_m=(10.0, 0.0, 1.0), size_m=(4.0, 4.0, 2.0))
    scene = FIELD.model_copy(update={"boxes": (box,)})
    finder = made("range_finder", IDEAL_RANGE | {"mount_m": (0.5, 0.0, -0.1)}, scene=scene)
    assert finder.sample(at(5.0), 0).distance_m == pytest.approx(4.9)
    assert finder.sample(at(5.0, p_WB=(10.0, 0.0, 5.0)), 0).distance_m == pytest.approx(2.9)
    assert finder.sample(at(5.0, p_WB=(7.6, 0.0, 5.0)), 0).distance_m == pytest.approx(2.9)  # the arm reaches over it
    assert finder.sample(at(5.0, p_WB=(7.4, 0.0, 5.0)), 0).distance_m == pytest.approx(4.9)


@pytest.mark.parametrize(
    "truth", [at(0.05), at(101.0), at(5.0, q_WB=rolled(math.radians(89.5))), at(5.0, q_WB=rolled(math.pi))]
)
def test_no_return_is_said(truth: TruthState) -> None:
    sample = made("range_finder", IDEAL_RANGE | {"no_return_m": 99.5}).sample(truth, 0)
    assert (sample.quality, sample.distance_m, sample.sigma_m) == (0, 99.5, 0.0)


def test_fog_takes_range() -> None:
    """Light falls as exp(-2 beta d) / d^2: seen up to d exp(beta d) = max_distance_m."""
    foggy = FIELD.model_copy(update={"weather": Weather(visibility_m=40.0)})
    clear, short = (
        made("range_finder", IDEAL_RANGE | {"max_distance_m": 30.0}, scene=scene) for scene in (FIELD, foggy)
    )
    beta = 3.912 / 40.0
    limit_m = next(d for d in np.arange(1.0, 30.0, 0.01) if d * math.exp(beta * d) > 30.0)
    for height_m, seen in ((limit_m - 0.05, True), (limit_m + 0.05, False)):
        assert (short.sample(at(height_m), 0).quality > 0) == seen
        assert clear.sample(at(height_m), 0).quality > 0


def test_range_noise_and_dropouts_have_the_stated_statistics() -> None:
    values = IDEAL_RANGE | {"noise_m": 0.02, "relative_noise": 0.01, "dropout_probability": 0.1}
    finder = made("range_finder", values)
    samples = [finder.sample(at(8.0), k) for k in range(8000)]
    seen = np.array([s.distance_m for s in samples if s.quality])
    assert 1.0 - seen.size / 8000 == pytest.approx(0.1, abs=0.012)
    assert seen.std() == pytest.approx(0.08, rel=0.04)  # one per cent of 8 m beats 2 cm
    assert seen.mean() == pytest.approx(8.0, abs=0.005)
    assert all(s.sigma_m == pytest.approx(0.08 if s.quality else 0.0) for s in samples)
    near = np.array([s.distance_m for s in (finder.sample(at(1.0), k) for k in range(4000)) if s.quality])
    assert near.std() == pytest.approx(0.02, rel=0.05)


def test_flow_of_a_steady_flight() -> None:
    """v / d in the directions of the sample's definition, whatever the heading."""
    flow = made("optical_flow", IDEAL_FLOW)
    sample = flow.sample(at(4.0, v_WB_W=(2.0, 1.0, 0.0)), 0)
    assert sample.integration_ns == 20_000_000
    assert sample.flow_rad == pytest.approx((1.0 / 4.0 * 0.02, -2.0 / 4.0 * 0.02), abs=1e-11)
    assert sample.gyro_rad == ZERO
    assert sample.distance_m == 4.0
    half = math.sqrt(0.5)
    north = made("optical_flow", IDEAL_FLOW).sample(at(4.0, v_WB_W=(0.0, 2.0, 0.0), q_WB=(half, 0.0, 0.0, half)), 0)
    assert north.flow_rad == pytest.approx((0.0, -2.0 / 4.0 * 0.02), abs=1e-11)


def test_flow_of_a_turn_on_the_spot_is_the_gyros() -> None:
    sample = made("optical_flow", IDEAL_FLOW).sample(at(4.0, w_WB_B=(0.3, -0.2, 0.5)), 0)
    assert sample.flow_rad == pytest.approx((0.3 * 0.02, -0.2 * 0.02), abs=1e-11)
    assert sample.gyro_rad == pytest.approx((0.3 * 0.02, -0.2 * 0.02, 0.5 * 0.02), abs=1e-11)


def test_flow_integrates_back_to_the_distance_flown() -> None:
    """Accelerated flight: flow less gyro, times height, sums to the way (trapezoid: exact for a ramp)."""
    flow = made("optical_flow", IDEAL_FLOW)
    way = 0.0
    for k in range(51):
        t = 0.02 * k
        v = 1.5 * t
        truth = at(3.0, t_ns=k * 20_000_000, v_WB_W=(v, 0.0, 0.0), w_WB_B=(0.0, 0.4 * t, 0.0))
        sample = flow.sample(truth, k)
        if k:
            way += (sample.gyro_rad[1] - sample.flow_rad[1]) * sample.distance_m
    assert way == pytest.approx(0.5 * 1.5 * 1.0, abs=1e-8)


@pytest.mark.parametrize("r_B", [(0.2, 0.0, 0.0), (0.1, -0.3, 0.05)])
def test_flow_of_an_offset_sensor_sees_the_lever_arm_move(r_B: tuple[float, float, float]) -> None:
    """u = v + w x r over the distance from the sensor to the ground."""
    v, w = (0.5, -0.25, 0.0), (0.3, -0.2, 1.0)
    sample = made("optical_flow", IDEAL_FLOW | {"mount_m": r_B}).sample(at(2.0, v_WB_W=v, w_WB_B=w), 0)
    u, d = np.array(v) + np.cross(w, r_B), 2.0 + r_B[2]
    assert sample.flow_rad == pytest.approx(((w[0] + u[1] / d) * 0.02, (w[1] - u[0] / d) * 0.02), abs=1e-11)


def test_flow_falls_silent_out_of_its_limits() -> None:
    for truth, changes in (
        (at(0.05), {}),
        (at(200.0), {}),
        (at(4.0, v_WB_W=(20.0, 0.0, 0.0)), {"max_flow_radps": 2.0}),
        (at(4.0, q_WB=rolled(0.5)), {"max_tilt_deg": 20.0}),
    ):
        sample = made("optical_flow", IDEAL_FLOW | changes).sample(truth, 0)
        assert sample.quality == 0
        assert sample.flow_rad == (0.0, 0.0)
    assert made("optical_flow", IDEAL_FLOW | {"has_range": False}).sample(at(4.0), 0).distance_m == -1.0


def test_flow_quality_falls_with_height() -> None:
    """From its best value at the ground to a third of it at the maximum distance, with a deviation of 4."""
    flow = made("optical_flow", IDEAL_FLOW)
    for height_m in (20.0, 50.0, 99.0):
        qualities = [flow.sample(at(height_m), k).quality for k in range(400)]
        assert np.mean(qualities) == pytest.approx(255 * (1.0 - height_m / 100.0 * 2.0 / 3.0), abs=0.8)
        assert np.std(qualities) == pytest.approx(4.0, rel=0.15)
    low = [flow.sample(at(1.0), k).quality for k in range(50)]
    assert max(low) == 255


def test_flow_in_fog_loses_quality_by_the_contrast_and_gains_noise_by_its_inverse() -> None:
    clear, foggy = (
        made(
            "optical_flow", IDEAL_FLOW | {"flow_noise_radps": 0.05}, scene=FIELD.model_copy(update={"weather": weather})
        )
        for weather in (Weather(), Weather(visibility_m=20.0))
    )
    contrast = math.exp(-3.912 / 20.0 * 4.0)
    samples = [[sensor.sample(at(4.0, t_ns=k * 20_000_000), k) for k in range(4000)] for sensor in (clear, foggy)]
    noise = [np.std([s.flow_rad for s in each]) for each in samples]
    quality = [np.mean([s.quality for s in each[:400]]) for each in samples]
    assert noise[1] / noise[0] == pytest.approx(1.0 / contrast, rel=0.01)
    assert quality[1] / quality[0] == pytest.approx(contrast, rel=0.02)
    lost = foggy.sample(at(12.0), 0)  # contrast 0.096
    assert (lost.quality, lost.flow_rad) == (0, (0.0, 0.0))
    assert foggy.sample(at(11.5), 0).quality > 0


def test_flow_noise_has_the_stated_statistics() -> None:
    flow = made("optical_flow", IDEAL_FLOW | {"flow_noise_radps": 0.05, "gyro_noise_radps_per_rthz": 0.001})
    samples = [flow.sample(at(4.0, t_ns=k * 20_000_000), k) for k in range(5000)]
    assert np.std([s.flow_rad for s in samples], axis=0) == pytest.approx([0.05 * 0.02] * 2, rel=0.05)
    assert np.std([s.gyro_rad for s in samples], axis=0) == pytest.approx([0.001 * math.sqrt(0.02)] * 3, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("range_finder", {"max_distance_m": 0.05}, "must be above min_distance_m"),
        ("range_finder", {"dropout_probability": 1.0}, "dropout_probability"),
        ("range_finder", {"resolution_m": 0.0}, "resolution_m"),
        ("optical_flow", {"min_distance_m": 200.0}, "min_distance_m"),
        ("optical_flow", {"quality": 0}, "quality"),
        ("optical_flow", {"fov_deg": 42.0}, "fov_deg"),
    ],
)
def test_parameters_out_of_range_are_refused(kind: str, changes: dict[str, Any], message: str) -> None:
    values = IDEAL_RANGE if kind == "range_finder" else IDEAL_FLOW
    with pytest.raises(pydantic.ValidationError, match=message):
        made(kind, values | changes)
