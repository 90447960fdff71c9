"""A camera's light and depth errors have the statistics they state, and are functions of key and number alone."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import pytest

from signals.noise import noise_key, normal_from_uniform
from sim._kernels import accumulate_linear, blur_depth, expose, image_normals

KEY = noise_key(1, "front.light")
QUIET = {"gain": 1.0, "electrons_at_white": 1.0, "read_noise_electrons": 0.0, "noisy": False, "key": KEY, "index": 0}


def normals(n: int, *, key: tuple[int, int] = KEY, index: int = 0) -> np.ndarray:
    out = np.empty(n, np.float32)
    image_normals(key, index, out)
    return out


def test_normals_are_normal() -> None:
    n = 400_000
    x = np.sort(normals(n).astype(np.float64))
    # Largest distance to the normal distribution (Kolmogorov-Smirnov), 1 in 1000 by chance.
    uniform = (np.arange(n) + 0.5) / n
    quantiles = normal_from_uniform(uniform)
    spacing = np.interp(x, quantiles, uniform)
    assert np.abs(spacing - uniform).max() < 1.95 / math.sqrt(n)
    assert x.var() == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / n))
    assert (x**4).mean() == pytest.approx(3.0, abs=4.0 * math.sqrt(96.0 / n))
    assert x[-1] > 4.2  # the tails are there
    assert x[0] < -4.2


def test_normals_depend_on_key_and_picture_and_place_only() -> None:
    whole = normals(5000)
    assert np.array_equal(whole[:777], normals(777))
    for other in (normals(5000, index=1), normals(5000, key=noise_key(2, "front.light"))):
        assert abs(np.corrcoef(whole, other)[0, 1]) < 0.06
    assert abs(np.corrcoef(whole[:-1], whole[1:])[0, 1]) < 0.06


def test_the_same_bits_on_every_machine() -> None:
    state = hashlib.blake2b(normals(10_000).tobytes(), digest_size=8).hexdigest()
    assert state == "c4a64d5f1515df75"


def light_of(rgb: np.ndarray) -> np.ndarray:
    out = np.zeros(rgb.shape, np.float32)
    accumulate_linear(rgb, 1.0, out)
    return out


def picture(linear: np.ndarray, **values: Any) -> np.ndarray:
    out = np.empty(linear.shape, np.uint8)
    expose(linear, values.pop("vignette", None), **(QUIET | values), rgb=out)
    return out


def test_light_is_srgbs_and_comes_back() -> None:
    shades = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(1, 256, 3)
    light = light_of(shades)[0, :, 0].astype(np.float64)
    s = np.arange(256) / 255.0
    expected = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
    assert np.abs(light - expected).max() < 1e-7
    assert np.array_equal(picture(light_of(shades)), shades)


def test_a_blurred_edge_is_averaged_in_light_not_in_numbers() -> None:
    total = np.zeros((1, 1, 3), np.float32)
    for value in (0, 255):
        accumulate_linear(np.full((1, 1, 3), value, np.uint8), 0.5, total)
    assert picture(total)[0, 0, 0] == 188  # half the light; the mean of the numbers would be 128


@pytest.mark.parametrize("level", [0.02, 0.2, 0.7])
def test_shot_and_read_noise_have_the_stated_deviation(level: float) -> None:
    electrons, read, gain = 2000.0, 12.0, 1.25
    linear = np.full((400, 400, 3), level, np.float32)
    options = {"gain": gain, "electrons_at_white": electrons, "read_noise_electrons": read, "noisy": True}
    out = light_of(picture(linear, **options)).astype(np.float64)
    sigma = gain * math.sqrt(level * electrons + read * read) / electrons
    assert out.mean() == pytest.approx(gain * level, abs=max(0.002 * gain * level, 5e-5))
    step = 1.0 / (255.0 * 12.92) if level < 0.003 else 2.4 * (gain * level) ** (1.4 / 2.4) / (255.0 * 1.055)
    assert out.std() == pytest.approx(math.hypot(sigma, step / math.sqrt(12.0)), rel=0.02)
    assert not np.array_equal(picture(linear, **options), picture(linear, **options, index=1))
    assert np.array_equal(picture(linear, **options), picture(linear, **options))


def test_gain_clips_and_vignetting_darkens() -> None:
    linear = np.full((2, 3, 3), 0.5, np.float32)
    assert np.all(picture(linear, gain=3.0) == 255)
    vignette = np.array([[1.0, 0.5, 0.0]] * 2, np.float32)
    out = light_of(picture(linear, vignette=vignette))
    assert out[0, :, 1] == pytest.approx([0.5, 0.25, 0.0], abs=0.004)
    assert np.all(picture(np.full((1, 1, 3), np.nan, np.float32)) == 0)


def depth(z: np.ndarray | float, **values: float) -> np.ndarray:
    out = np.ascontiguousarray(np.broadcast_to(np.float32(z), (300, 300)) if np.isscalar(z) else z, np.float32).copy()
    errors = {"sigma_m": 0.0, "sigma_per_m": 0.0, "step_m": 0.0, "disparity_scale_m": 0.0, "min_m": 0.0, "max_m": 1e6}
    index = int(values.pop("index", 0))
    blur_depth(out, **(errors | values), key=KEY, index=index)
    return out


def test_depth_noise_grows_with_the_square_of_the_distance() -> None:
    for z in (1.0, 4.0):
        out = depth(z, sigma_m=0.01, sigma_per_m=0.002)
        assert out.std() == pytest.approx(0.01 + 0.002 * z * z, rel=0.02)
        assert out.mean() == pytest.approx(z, abs=0.001)


def test_stereo_rounds_the_inverse_and_time_of_flight_the_distance() -> None:
    z = np.linspace(0.5, 9.0, 900, dtype=np.float32).reshape(30, 30)
    steps = 700.0 / depth(z, disparity_scale_m=700.0).astype(np.float64)
    assert np.abs(steps - np.round(steps)).max() < 1e-3
    assert np.abs(depth(z, disparity_scale_m=700.0) - z).max() < 0.5 * 9.0**2 / 700.0 * 1.01
    tof = depth(z, step_m=0.25)
    assert np.array_equal(tof, np.floor(z / np.float32(0.25) + np.float32(0.5)) * np.float32(0.25))


def test_depth_out_of_limits_is_nothing() -> None:
    z = np.array([[0.1, 0.5, 9.0, np.inf, np.nan]], np.float32)
    assert depth(z, min_m=0.3, max_m=8.0).tolist() == [[math.inf, 0.5, math.inf, math.inf, math.inf]]
    # However large its errors would be there, what is far out of reach is not seen.
    assert np.all(np.isinf(depth(60.0, sigma_per_m=0.01, max_m=10.0)))
    assert np.all(np.isinf(depth(np.full((3, 3), -1.0, np.float32), disparity_scale_m=5.0)))


def test_wrong_buffers_are_refused() -> None:
    linear, rgb = np.zeros((4, 5, 3), np.float32), np.zeros((4, 5, 3), np.uint8)
    for bad in (linear.astype(np.float64), np.zeros((4, 5), np.float32), linear[:, ::2]):
        with pytest.raises(TypeError):
            expose(bad, None, **QUIET, rgb=rgb)
    with pytest.raises(ValueError, match="differ in size"):
        expose(linear, None, **QUIET, rgb=np.zeros((5, 4, 3), np.uint8))
    with pytest.raises(ValueError, match="differ in size"):
        expose(linear, np.ones((5, 4), np.float32), **QUIET, rgb=rgb)
    with pytest.raises(ValueError, match="must be positive"):
        expose(linear, None, **(QUIET | {"gain": 0.0}), rgb=rgb)
    with pytest.raises(ValueError, match="differ in size"):
        accumulate_linear(rgb, 1.0, np.zeros((5, 4, 3), np.float32))
    rgb.flags.writeable = False
    with pytest.raises(TypeError):
        expose(linear, None, **QUIET, rgb=rgb)
