"""The report of a run with vibration: ArduPilot's level, the spectrum, the counts of clipped readings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.config import load_bench
from hil.run.parts.catalog import parts_of
from hil.run.parts.simulated.vibration import VibrationPart, vibe_mps2
from hil.run.report.vibration_pictures import density
from signals.errors import ConfigError
from signals.samples import ImuSample

RATE_HZ = 250.0


def test_vibe_of_a_sine_is_its_rms() -> None:
    """High above both corners, the floor takes nothing and the level is the mean square."""
    t = np.arange(5000) / 1000.0
    accel = np.column_stack([4.0 * np.sin(2 * math.pi * 200.0 * t), np.zeros_like(t), np.full_like(t, 9.8)])
    level = vibe_mps2(accel, 1000.0)
    assert level[-1] == pytest.approx([4.0 / math.sqrt(2.0), 0.0, 0.0], rel=0.03, abs=1e-9)


def test_vibe_is_that_of_a_loop_over_samples() -> None:
    rng = np.random.default_rng(1)
    accel = rng.normal(size=(400, 3)) + np.array([0.0, 0.0, 9.8])
    shares = [1.0 / (1.0 + RATE_HZ / (2 * math.pi * hz)) for hz in (5.0, 2.0)]
    floor, mean = accel[0].copy(), np.zeros(3)
    for sample in accel:
        floor += shares[0] * (sample - floor)
        mean += shares[1] * ((sample - floor) ** 2 - mean)
    assert vibe_mps2(accel, RATE_HZ)[-1] == pytest.approx(np.sqrt(mean), rel=1e-9)


def test_the_density_holds_the_variance() -> None:
    """Parseval: the integral over the frequencies is the variance, and a tone stands at its own."""
    t = np.arange(51_200) / RATE_HZ
    values = np.column_stack([3.0 * np.cos(2 * math.pi * 40.0 * t), np.random.default_rng(2).normal(size=t.size)])
    hz, power = density(values, RATE_HZ)
    assert power.sum(axis=0) * hz[1] == pytest.approx([4.5, 1.0], rel=0.02)
    assert hz[power[:, 0].argmax()] == pytest.approx(40.0, abs=hz[1])


def test_the_part_adds_keys_and_a_picture(tmp_path: Path) -> None:
    part = VibrationPart({"imu": RATE_HZ})
    part.begin(SimpleNamespace(sensors=SimpleNamespace(imus={"imu": SimpleNamespace(clipped_readings=(1,) * 6)})))  # type: ignore[arg-type]
    for k in range(1000):
        part.tap().sample("imu", ImuSample(k, 0, 0, ((-1.0) ** k, 0.0, 9.8), (0.0, 0.0, 0.1 * (-1.0) ** k), 45.0))
        part.tap().sample("other", ImuSample(k, 0, 0, (99.0, 0.0, 9.8), (0.0, 0.0, 0.0), 45.0))
    keys = part.run_keys()["vibration"]["imu"]
    assert keys["vibe_mps2"]["p50"] == pytest.approx([1.0, 0.0, 0.0], abs=0.1)
    assert keys["vibe_mps2"]["max"][0] >= keys["vibe_mps2"]["p50"][0]
    assert keys["clipped_readings"] == [1] * 6
    assert json.dumps(keys)
    run: Any = SimpleNamespace(out=tmp_path)
    ((caption, path),) = part.report(run).pictures
    assert "imu" in caption
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_run_that_failed_early_has_no_keys_of_sensors() -> None:
    assert VibrationPart({"imu": RATE_HZ}).run_keys() == {"vibration": {}}


def test_only_benches_that_ask_for_it_have_the_part() -> None:
    names = [
        {part.name for part in parts_of(load_bench(settings=settings, flown=False))}
        for settings in ([], ["vibration=off"], ["vibration=estimated"])
    ]
    assert ["vibration" in each for each in names] == [False, False, True]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["vibration=on"], "vibration"),
        (["vibration=estimated", "vehicle_settings.rotors=[]", "mission=null"], "rotors"),
    ],
)
def test_a_wrong_word_and_a_vehicle_without_rotors_are_refused(settings: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_bench(settings=settings)


def test_the_shipped_bench_vibrates() -> None:
    assert load_bench("rigs/benches/vibration.yaml", flown=False).config.vibration == "estimated"
