"""The LiDAR's receiver against its formulas by numpy, bit for bit; the order of casting; the box of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.noise import NoiseStream, noise_key
from sim._kernels import LidarReceiver, lambert_strength, sweep_rays
from sim.sensors.lidar_pattern import casting_order
from tests.unit.sim.frame.test_frame_raster import ISAS

KEYS = {"noise_key": noise_key(3, "a.range"), "loss_key": noise_key(3, "a.dropout")}
MODELS: dict[str, dict[str, Any]] = {
    "exact": {"noise_m": 0.0, "range_at_10_percent_m": None, "dropout": 0.0, "intensity_falloff_m": None},
    "dropout": {"noise_m": 0.0, "range_at_10_percent_m": None, "dropout": 0.3, "intensity_falloff_m": None},
    "all": {"noise_m": 0.4, "range_at_10_percent_m": 20.0, "dropout": 0.05, "intensity_falloff_m": 5.0},
}


def sweep_of(n: int) -> dict[str, NDArray[Any]]:
    rng = np.random.default_rng(n)
    range_m = np.where(rng.random(n) < 0.3, np.inf, rng.uniform(0.0, 70.0, n))
    range_m[range_m < 1.0] = 0.0
    strength = np.where(rng.random(n) < 0.1, 0.0, rng.random(n) * 1.5)
    return {
        "place": rng.permutation(n).astype(np.int32),
        "range_m": range_m,
        "strength": strength,
        "geom": np.where(np.isinf(range_m), -1, rng.integers(0, 5, n)).astype(np.int32),
        "directions_L": rng.normal(size=(n, 3)),
        "origin_z_m": rng.normal(size=n),
        "ring": rng.integers(0, 16, n).astype(np.uint16),
        "time_offset_ns": np.arange(-n, 0, dtype=np.int32),
        "geom_class": np.array([7, 5, 3, 9, 200], np.uint8),
    }


def room(n: int) -> list[NDArray[Any]]:
    kinds = (np.float32, np.float32, np.uint16, np.int32, np.uint8)
    return [np.zeros((n, 3), np.float32), *(np.zeros(n, kind) for kind in kinds)]


def received(model: dict[str, Any], n: int, first: int, isa: str = "") -> list[bytes]:
    receiver = LidarReceiver(**KEYS, resolution_m=0.002, min_range_m=0.5, max_range_m=60.0, **model)
    out, ray = room(n), np.full(n, -1, np.int32)
    count = receiver.receive(first, *sweep_of(n).values(), *out, ray=ray, isa=isa)
    # Each ray fires at a time of its own.
    assert np.array_equal(sweep_of(n)["time_offset_ns"][ray[:count]], out[4][:count])
    assert (ray[count:] == -1).all()
    return [values[:count].tobytes() for values in out]


def drawn(block: Any, n: int, first: int) -> Any:
    """Draws first .. first + n - 1 of a stream of one lane."""
    blocks = [block(b)[:, 0] for b in range(first // 256, (first + n - 1) // 256 + 1)]
    return np.concatenate([*blocks, np.empty(0)])[first % 256 :][:n]


def by_formula(model: dict[str, Any], n: int, first: int) -> list[bytes]:
    s = sweep_of(n)
    place = s["place"]
    range_m, e, geom = s["range_m"][place], s["strength"][place], s["geom"][place]
    normal = drawn(NoiseStream(3, "a.range").normal_block, n, first)
    uniform = drawn(NoiseStream(3, "a.dropout").uniform_block, n, first)
    hit = np.isfinite(range_m)
    true_m = np.where(hit, range_m, 0.0)
    measured = np.floor((true_m + model["noise_m"] * normal) / 0.002 + 0.5) * 0.002
    loss: Any = model["dropout"]
    if model["range_at_10_percent_m"] is not None:
        limit = model["range_at_10_percent_m"] * np.sqrt(e / 0.1)
        lost = np.clip((true_m / np.maximum(limit, 1e-9) - 0.9) / (1.1 - 0.9), 0.0, 1.0)
        loss = lost + (1.0 - lost) * model["dropout"]
    kept = hit & (measured >= 0.5) & (measured <= 60.0) & (uniform >= loss)
    falloff = model["intensity_falloff_m"]
    ratio = 1.0 if falloff is None else falloff / np.maximum(true_m, falloff)
    intensity = np.minimum(e * (ratio * ratio), 1.0)
    points = measured[:, None] * s["directions_L"]
    points[:, 2] += s["origin_z_m"]
    columns = (
        points.astype(np.float32),
        measured.astype(np.float32),
        intensity.astype(np.float32),
        s["ring"],
        s["time_offset_ns"],
        s["geom_class"][geom],
    )
    return [np.ascontiguousarray(values[kept]).tobytes() for values in columns]


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(("n", "first"), [(1000, 0), (1001, 254), (7, 3), (64, 2**40 + 1)])
def test_every_bit_is_that_of_the_formulas(name: str, n: int, first: int) -> None:
    expected = by_formula(MODELS[name], n, first)
    assert n < 100 or len(expected[1]) > 4 * 200
    for isa in ISAS:
        assert received(MODELS[name], n, first, isa) == expected


def test_lamberts_law() -> None:
    geom = np.array([1, -1, 0, 1], np.int32)
    normal = np.array([[0, 0, 1.0], [0, 0, 0], [0, 1, 0], [0.6, 0, -0.8]])
    direction = np.array([[0.6, 0, -0.8], [1, 0, 0], [1, 0, 0], [0, 0, 1]])
    strength = np.empty(4)
    lambert_strength(geom, normal, direction, np.array([0.9, 0.5]), strength)
    assert strength.tolist() == [0.4, 0.0, 0.0, 0.4]


def test_what_does_not_fit_is_refused() -> None:
    receiver = LidarReceiver(**KEYS, resolution_m=0.002, min_range_m=0.5, max_range_m=60.0, **MODELS["all"])
    good = sweep_of(40)
    spoilt: dict[str, tuple[NDArray[Any], str]] = {
        "place": (good["place"] + np.int32(1), "place"),
        "ring": (good["ring"][:-1], "ring has 39 rows for 40"),
        "geom": (np.full(40, 5, np.int32), "class"),
    }
    for name, (values, message) in spoilt.items():
        with pytest.raises(ValueError, match=message):
            receiver.receive(0, *(good | {name: values}).values(), *room(40))
    with pytest.raises(ValueError, match="ray has 39 rows for 40"):
        receiver.receive(0, *good.values(), *room(40), ray=np.zeros(39, np.int32))
    with pytest.raises(TypeError):
        receiver.receive(0, *good.values(), *room(40), ray=np.zeros(40, np.int64))
    with pytest.raises(ValueError, match="resolution_m"):
        LidarReceiver(**KEYS, resolution_m=0.0, min_range_m=0.5, max_range_m=60.0, **MODELS["all"])
    with pytest.raises(ValueError, match="reflectivity"):
        lambert_strength(np.array([2], np.int32), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(2), np.zeros(1))


def test_neighbours_of_a_turning_head_are_cast_together() -> None:
    columns, rings = 50, 6
    azimuth = np.repeat(np.arange(columns) * 0.01, rings)
    ring = np.tile(np.array([0, 3, 1, 4, 2, 5], np.uint16), columns)  # as they fire
    elevation = ring * 0.035
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    order = casting_order(direction, ring)
    assert sorted(order.tolist()) == list(range(columns * rings))
    packets = direction[order[: 48 * rings]].reshape(-1, 8, 3)
    assert np.abs(packets - packets[:, :1]).max() < 0.08  # eight columns of one ring
    assert np.abs(np.diff(packets[:, 0], axis=0)).max() < 0.09  # and no leap from one packet to the next
    assert casting_order(direction[:0], ring[:0]).shape == (0,)


def test_a_sweep_of_no_rays_has_no_box() -> None:
    none, zero = np.empty((0, 3)), (0.0, 0.0, 0.0)
    motion = (zero, zero, zero, zero, (1.0, 0.0, 0.0, 0.0), zero, zero, zero)
    low, high = sweep_rays(motion, np.empty(0, np.int32), none, none, none, none)
    assert low > high
