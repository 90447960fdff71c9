"""CFAR: thresholds against closed forms, and the false alarms that noise really makes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest

from sim.radar.chirp import Chirp
from sim.radar.processing.cfar import Cfar, cell_averaging_factor, order_statistic_factor
from sim.radar.processing.parameters import CfarParameters, Processing
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.virtual_array import as_array
from tests.worlds.radar_point_targets import CHIRP, counts

ARRAY = as_array([(0.0, 0.0, 0.0)] * 3)


@pytest.mark.parametrize("n", [4, 16, 144])
@pytest.mark.parametrize("false_alarm", [1e-2, 1e-4, 1e-6])
def test_factors_of_one_receiver_are_the_closed_forms(n: int, false_alarm: float) -> None:
    assert cell_averaging_factor(n, 1, false_alarm) == pytest.approx(n * (false_alarm ** (-1.0 / n) - 1.0), rel=1e-9)
    k = 3 * n // 4
    alpha = order_statistic_factor(n, 0.75, 1, false_alarm)
    product = math.prod((n - i) / (n - i + alpha) for i in range(k))
    assert product == pytest.approx(false_alarm, rel=2e-3)


@pytest.mark.parametrize("receivers", [2, 3])
@pytest.mark.parametrize("kind", ["ca", "os"])
def test_factors_of_several_receivers_keep_the_probability(kind: str, receivers: int) -> None:
    n, false_alarm, trials = 24, 1e-2, 200_000
    rng = np.random.default_rng(receivers)
    cells = rng.gamma(receivers, 1.0 / receivers, (trials, n))
    cell = rng.gamma(receivers, 1.0 / receivers, trials)
    if kind == "ca":
        threshold = cell_averaging_factor(n, receivers, false_alarm) * cells.mean(axis=1)
    else:
        threshold = order_statistic_factor(n, 0.75, receivers, false_alarm) * np.sort(cells, axis=1)[:, 17]
    sigma = math.sqrt(false_alarm / trials)
    assert np.mean(cell > threshold) == pytest.approx(false_alarm, abs=4.5 * sigma)


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("ca", {}),
        ("os", {}),
        ("os", {"rank": 0.75}),
        ("ca", {"guard_doppler": 0, "train_doppler": 0, "train_range": 8}),
        ("ca", {"guard_range": 0, "train_range": 0, "train_doppler": 12}),
        ("os", {"guard_range": 0, "train_range": 0, "train_doppler": 12}),
    ],
)
@pytest.mark.parametrize("window", ["none", "hann"])
def test_noise_makes_the_false_alarms_that_were_asked_for(kind: str, changes: dict[str, Any], window: str) -> None:
    false_alarm, frames = 1e-3, 60
    p = Processing.model_validate(
        {
            "clutter": "none",
            "range_window": window,
            "doppler_window": window,
            "cfar": {"kind": kind, "false_alarm": false_alarm} | changes,
        }
    )
    maps = RangeDoppler(CHIRP, ARRAY, p)
    cfar = Cfar(maps, 3, p)
    alarms, power_sum, noise_sum = 0, 0.0, 0.0
    for frame in range(frames):
        power = maps.compute(counts(np.zeros((3, 64, 64)), noise=20.0, seed=frame))
        mask, noise = cfar.detect(power)
        # The first columns hold the mean that was taken away, and the samples' mirror image.
        alarms += int(mask[:, 3:].sum())
        power_sum += float(power[:, 3:].mean())
        noise_sum += float(noise[:, 3:].mean())
    cells = frames * 64 * 29
    # Alarms come in clumps as large as a window's main lobe.
    sigma = math.sqrt((4.0 if window == "hann" else 1.0) / (false_alarm * cells))
    assert alarms / cells == pytest.approx(false_alarm, rel=0.1 + 4.0 * sigma)
    assert noise_sum == pytest.approx(power_sum, rel=0.03)


def test_edges_have_fewer_cells_and_doppler_has_none() -> None:
    p = Processing.model_validate({"clutter": "none", "cfar": {"kind": "ca"}})
    cfar = Cfar(RangeDoppler(CHIRP, ARRAY, p), 3, p)
    power = np.ones((64, 32), np.float32)
    mask, noise = cfar.detect(power)
    assert noise == pytest.approx(1.0)
    assert not mask.any()
    power[0, 2] = power[63, 31] = 1e4  # corners
    mask, noise = cfar.detect(power)
    assert np.argwhere(mask).tolist() == [[0, 2], [63, 31]]
    assert noise[0, 2] == pytest.approx(1.0)  # a cell trains nothing for itself
    assert noise[60, 2] > 10.0  # round the end of the Doppler axis
    assert noise[0, 31 - 9] == pytest.approx(1.0)  # but not of the range axis


def test_quiet_rows_train_nothing() -> None:
    p = Processing.model_validate({"clutter": "mean", "cfar": {"kind": "ca", "guard_doppler": 0, "train_doppler": 2}})
    maps = RangeDoppler(CHIRP, ARRAY, p)
    power = np.ones((64, 32), np.float32)
    power[32] = 0.0  # as if mean removal had taken all
    for kind in ("ca", "os"):
        q = Processing.model_validate(p.model_dump() | {"cfar": p.cfar.model_dump() | {"kind": kind, "rank": 0.99}})
        _, noise = Cfar(maps, 3, q).detect(power)
        assert np.ptp(noise) < 1e-6 * noise.max()


def test_an_order_statistic_is_not_masked_by_a_second_target() -> None:
    power = np.ones((64, 32), np.float32)
    power[20, 10] = power[20, 14] = 2000.0
    found = {}
    for kind in ("ca", "os"):
        one_dimension = {"kind": kind, "train_doppler": 0, "guard_doppler": 0}
        p = Processing.model_validate({"clutter": "none", "cfar": one_dimension})
        mask, _ = Cfar(RangeDoppler(CHIRP, ARRAY, p), 3, p).detect(power)
        found[kind] = int(mask.sum())
    assert found["os"] == 2
    assert found["ca"] < 2


def test_refusals() -> None:
    with pytest.raises(pydantic.ValidationError, match="no cell to estimate the noise from"):
        CfarParameters(train_doppler=0, train_range=0)
    few = Chirp.model_validate(CHIRP.model_dump() | {"chirps": 8})
    with pytest.raises(ValueError, match="more than the 8 Doppler rows"):
        Cfar(RangeDoppler(few, ARRAY, Processing()), 3, Processing())
    maps = RangeDoppler(CHIRP, ARRAY, Processing())
    with pytest.raises(ValueError, match="the map is 32 x 32, not 64 x 32"):
        Cfar(maps, 3, Processing()).detect(np.ones((32, 32), np.float32))
