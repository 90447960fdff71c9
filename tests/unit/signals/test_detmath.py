"""detmath against 80-bit references: worst error in units of the last place, per function."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals import _kernel as k

Float64 = NDArray[np.float64]
pytestmark = pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="needs an 80-bit long double as reference")


def worst_ulp(values: list[float], exact: NDArray[np.longdouble]) -> float:
    got = np.array(values)
    assert np.isfinite(got).all()
    return float(np.max(np.abs(got.astype(np.longdouble) - exact) / np.spacing(np.abs(exact.astype(np.float64)))))


def samples(low: float, high: float, count: int = 20_000) -> Float64:
    return np.random.default_rng(7).uniform(low, high, count)


def near_quarter_turns() -> Float64:
    """Arguments where sin or cos nearly vanishes: cancellation in the range reduction is worst there."""
    n = np.arange(-2000, 2001)
    base = n * (np.pi / 2)
    return np.concatenate([base, np.nextafter(base, np.inf), base + 1e-9, base - 1e-5])


SWEEPS: list[Any] = [
    ("sin", k.det_sin, np.sin, samples(-10, 10), 1.0),
    ("sin", k.det_sin, np.sin, samples(-1e5, 1e5), 1.0),
    ("sin", k.det_sin, np.sin, samples(-1e6, 1e6), 1.0),
    ("cos", k.det_cos, np.cos, samples(-10, 10), 1.0),
    ("cos", k.det_cos, np.cos, samples(-1e5, 1e5), 1.0),
    ("cos", k.det_cos, np.cos, samples(-1e6, 1e6), 1.0),
    ("exp", k.det_exp, np.exp, samples(-1, 1), 1.0),
    ("exp", k.det_exp, np.exp, samples(-700, 700), 1.0),
    ("log", k.det_log, np.log, samples(0.5, 2.0), 1.0),
    ("log", k.det_log, np.log, 10.0 ** samples(-300, 300), 1.0),
    ("asin", k.det_asin, np.arcsin, samples(-1, 1), 3.0),
]


@pytest.mark.parametrize(("name", "function", "reference", "x", "limit"), SWEEPS)
def test_error_is_within_the_stated_bound(name, function, reference, x, limit) -> None:
    assert worst_ulp([function(v) for v in x.tolist()], reference(x.astype(np.longdouble))) <= limit


@pytest.mark.parametrize(("function", "reference"), [(k.det_sin, np.sin), (k.det_cos, np.cos)])
def test_zeros_of_sin_and_cos_keep_relative_accuracy(function, reference) -> None:
    x = near_quarter_turns()
    assert worst_ulp([function(v) for v in x.tolist()], reference(x.astype(np.longdouble))) <= 1.0


def test_atan2_on_all_quadrants() -> None:
    y, x = samples(-5, 5), samples(-3, 3)[::-1].copy()
    exact = np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))
    got = [k.det_atan2(a, b) for a, b in zip(y.tolist(), x.tolist(), strict=True)]
    assert worst_ulp(got, exact) <= 2.0


def test_pow_where_the_barometric_formula_uses_it() -> None:
    x = samples(0.2, 1.1)
    for exponent in (5.255876, 1.0 / 5.255876):
        exact = x.astype(np.longdouble) ** np.longdouble(exponent)
        got = np.array([k.det_pow(v, exponent) for v in x.tolist()])
        allowed = (1.0 + np.abs(exponent * np.log(x))) * 2.2e-16
        assert np.all(np.abs((got - exact) / exact) <= allowed)


def test_special_values() -> None:
    nan, inf = math.nan, math.inf
    for function in (k.det_sin, k.det_cos, k.det_exp, k.det_log, k.det_asin):
        assert math.isnan(function(nan))
    assert math.isnan(k.det_sin(inf))
    assert math.isnan(k.det_cos(-inf))
    assert k.det_exp(inf) == inf
    assert k.det_exp(-inf) == 0.0
    assert k.det_exp(0.0) == 1.0
    assert k.det_log(0.0) == -inf
    assert k.det_log(1.0) == 0.0
    assert math.isnan(k.det_log(-1.0))
    assert math.isnan(k.det_asin(1.0000001))
    assert k.det_sin(0.0) == 0.0
    assert k.det_cos(0.0) == 1.0


@pytest.mark.parametrize(
    ("y", "x"),
    [(0.0, 1.0), (0.0, -1.0), (-0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (-1.0, -1.0), (0.0, 0.0)],
)
def test_atan2_on_the_axes_agrees_with_ieee(y: float, x: float) -> None:
    assert k.det_atan2(y, x) == math.atan2(y, x)
    assert math.copysign(1.0, k.det_atan2(y, x)) == math.copysign(1.0, math.atan2(y, x))


def test_far_arguments_stay_on_the_unit_circle() -> None:
    for x in (1e7, -3e9, 1e12):
        s, c = k.det_sin(x), k.det_cos(x)
        assert abs(s * s + c * c - 1.0) < 1e-15
        assert abs(s - math.sin(x)) < 2e-16 * abs(x)
