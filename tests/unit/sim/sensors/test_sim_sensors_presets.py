"""Every preset: what it says of itself, and the properties that hold for every sensor."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signals.errors import ConfigError
from signals.samples import SAMPLE_FIELDS, FlowSample, RangeSample, TruthState, arrays_of
from sim.frame.source import SharedFrames
from sim.scene.scene import load_scene
from sim.sensors.catalog import KINDS, PRESETS
from sim.sensors.presets import PRESET_DIR, PresetFolder
from sim.world_loader import load_world
from tests.unit.sim.sensors.test_sim_sensors import RATE_HZ, sensor
from tests.worlds.installed_sensor import installed

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
PLAIN = sorted(name for name, preset in PRESETS.items() if not KINDS[preset.kind].needs_frames)
FRAMED = sorted(set(PRESETS) - set(PLAIN))
WITH_NOISE: dict[str, dict[str, Any]] = {
    "camera": {"noise": {"electrons_at_white": 300.0}, "vignetting": 0.5, "rolling_shutter_s": 0.02},
    "lidar": {"beam_divergence_rad": 0.003},
    "radar": {"mount_m": (0.0, 0.0, 1.0)},
    "spinning_radar": {"mount_m": (0.0, 0.0, 1.0), "bins": 700, "threshold_db": 6.0},
}
# Fields that are settings of the device or of the flight and so may stay the same.
CONSTANT = {
    "horizontal_accuracy_m",
    "vertical_accuracy_m",
    "fix_type",
    "satellites",
    "axis_B",
    "min_distance_m",
    "max_distance_m",
    "integration_ns",
}
MAY_STAY = {
    (FlowSample, "temperature_degc"),  # a setting
    (FlowSample, "distance_m"),  # a device without a range finder says so in every sample
    (RangeSample, "quality"),  # a dropout is rare
    (RangeSample, "sigma_m"),
}
G = 9.80665
TO_SI = {
    "m": 1.0,
    "Hz": 1.0,
    "dps/g": math.radians(1.0) / G,
    # A datasheet's density is one-sided, the parameter is Allan's N.
    "ug/rtHz": 1e-6 * G / math.sqrt(2.0),
    "mdps/rtHz": math.radians(1e-3) / math.sqrt(2.0),
    "dps/rtHz": math.radians(1.0) / math.sqrt(2.0),
    "mg/K": 1e-3 * G,
    "dps/K": math.radians(1.0),
    "deg/h": math.radians(1.0) / 3600.0,
    "ug": 1e-6 * G,
    "mg": 1e-3 * G,
    "g": G,
    "%": 0.01,
    "mbar": 100.0,
    "Pa": 1.0,
    "psi": 6894.757293168,
    "nT": 1e-9,
    "uT": 1e-6,
    "cm": 0.01,
    "mm": 0.001,
}


def moving(k: int) -> TruthState:
    """A gentle made-up motion, 1 to 3 m up, rotors turning: nothing stays the same."""
    s = math.sin(0.05 * k)
    half = 0.05 * s
    q = (math.sqrt(1.0 - half * half), half, 0.0, 0.0)
    return TruthState(
        k,
        k * TICK_NS,
        (0.1 * k, 0.0, 2.0 + s),
        q,
        (0.5 + 0.3 * s, 0.2 * s, 0.1 * s),
        (0.1 * s, 0.2, 0.1),
        (0.5 * s, 0.1, 0.2),
        (0.1, s, 0.2),
        (500.0 + s, 510.0, 505.0, 495.0),
        False,
    )


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_every_figure_agrees_with_what_its_source_states(preset: str) -> None:
    for name, figure in PRESETS[preset].figures.items():
        if not figure.stated:
            continue
        number, unit = re.fullmatch(r"([0-9.]+) (\S+)", figure.stated).groups()  # type: ignore[union-attr]
        assert figure.value == pytest.approx(float(number) * TO_SI[unit], rel=1e-9), name
        assert ("one-sided" in figure.note) == ("rtHz" in unit), name


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_every_parameter_that_must_be_given_has_a_source_or_says_it_is_typical(preset: str) -> None:
    chosen = PRESETS[preset]
    model = KINDS[chosen.kind].parameters
    assert (
        {n for n, f in model.model_fields.items() if f.is_required()} <= set(chosen.figures) <= set(model.model_fields)
    )
    assert chosen.part
    assert chosen.source
    used = {figure.source for figure in chosen.figures.values()} - {""}
    assert used <= set(chosen.sources)


@pytest.mark.parametrize("preset", PLAIN)
def test_same_seed_same_bytes_and_a_neighbour_changes_nothing(preset: str) -> None:
    a, b, other = sensor(preset), sensor(preset), sensor(preset, seed=2)
    neighbour = sensor(preset, name="t")
    samples = []
    for k in range(300):
        samples.append(a.sample(moving(k), k))
        neighbour.sample(moving(7 * k), 7 * k)
        assert type(samples[-1]) is a.sample_type is KINDS[PRESETS[preset].kind].sample_type
        assert samples[-1][:3] == (k, k * TICK_NS, k * TICK_NS + a.latency_ns)
    # A fresh construction is what a reset is.
    assert samples == [b.sample(moving(k), k) for k in range(300)]
    assert samples[5][3:] != other.sample(moving(5), 5)[3:]
    assert samples[5][3:] != neighbour.sample(moving(5), 5)[3:]
    assert all(x[3:] != y[3:] for x, y in itertools.pairwise(samples[::10]))  # never stale
    assert a.period_ns == round(1e9 / RATE_HZ.get(PRESETS[preset].kind, 50.0))


@pytest.fixture(scope="module")
def frames() -> SharedFrames:
    return SharedFrames(load_world(load_scene("radar_range")))


SLOW = {"awr2243cascade", "bgt60tr13c_wideband", "hdl32e", "os1_64"}  # their kinds have other presets


@pytest.mark.parametrize(
    "preset", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else []) for name in FRAMED]
)
def test_what_sees_the_world_gives_the_same_bytes_for_the_same_seed_and_shares_none(
    preset: str, frames: SharedFrames
) -> None:
    def made(name: str = "s", seed: int = 1) -> Any:
        values = WITH_NOISE[PRESETS[preset].kind]
        return installed(name, SCENE, preset=preset, overrides=values, seed=seed, frames=frames)

    with pytest.raises(ValueError, match=r"'s'.*frames"):
        installed("s", SCENE, preset=preset)
    a, b, neighbour = made(), made(), made("t")
    samples = []
    for k in range(3):
        samples.append(a.sample(moving(25 * k), k))
        neighbour.sample(moving(25 * k + 5), 7 * k)
    # A fresh construction is what a reset is.
    assert samples == [b.sample(moving(25 * k), k) for k in range(3)]
    assert all(x != y for x, y in itertools.pairwise(samples))
    for other in (made("t"), made(seed=2)):
        assert other.sample(moving(0), 0) != samples[0]
    # Noise is of the number, not of what was sampled before.
    zero = (0.0, 0.0, 0.0)
    rest = moving(0)._replace(v_WB_W=zero, w_WB_B=zero, a_WB_W=zero, alpha_WB_B=zero)
    late, alone = made(), made()
    late.sample(rest, 0)
    (_, x), (_, y) = (next(iter(arrays_of(s.sample(rest._replace(t_ns=10**8), 5)))) for s in (late, alone))
    assert np.array_equal(x, y)
    arrays = [array for sample in samples for _, array in arrays_of(sample)]
    assert not any(np.shares_memory(x, y) for x, y in itertools.combinations(arrays, 2))
    assert not any(array.flags.writeable for array in arrays)


@pytest.mark.parametrize("preset", PLAIN)
def test_no_channel_is_constant_and_all_are_finite(preset: str) -> None:
    made = sensor(preset)
    ticks = made.period_ns // TICK_NS
    samples = [made.sample(moving(k * ticks), k) for k in range(1000)]
    names = set(SAMPLE_FIELDS[made.sample_type])
    for field in names - CONSTANT - {"seq", "t_capture_ns", "t_available_ns"}:
        values = [getattr(s, field) for s in samples]
        rows = values if isinstance(values[0], tuple) else [(v,) for v in values]
        for axis in zip(*rows, strict=True):
            assert all(math.isfinite(v) for v in axis), field
            if (made.sample_type, field) in MAY_STAY:
                continue
            assert len(set(axis)) > 1, field


@pytest.mark.parametrize("preset", PLAIN)
def test_noise_does_not_depend_on_which_samples_were_taken(preset: str) -> None:
    """Skipping samples of a sensor changes none of its later ones, where the truth is the same throughout."""
    steady, skipping = sensor(preset), sensor(preset)
    still = moving(0)._replace(w_WB_B=(0.0, 0.0, 0.0), alpha_WB_B=(0.0, 0.0, 0.0))  # as the attitude stays the same
    for k in range(600):
        if k % 7 == 0:
            kept = skipping.sample(still._replace(t_ns=k * TICK_NS), k)
        expected = steady.sample(still._replace(t_ns=k * TICK_NS), k)
        if k % 7 == 0 and PRESETS[preset].kind != "optical_flow":  # which integrates from sample to sample
            assert kept == expected


GOOD = (PRESET_DIR / "ms5611.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: barometer", "kind: barometre", "kind 'barometre' is unknown"),
        ("status: verified", "status: certain", "status"),
        ("source: ds", "source: dss", "'dss' is not among the sources"),
        ("  noise_pa: {value: 1.2,", "  noise_pa: {value: -1.2,", "noise_pa must be at least 0 Pa, not -1.2"),
        ("  noise_pa:", "  noise_ppa:", "noise_ppa"),
        ("kind: barometer", "kind: barometer\nrate: 5", "rate"),
        (", source: ds", "", "needs a source"),
        ("sources:", "sourcez:", "sourcez"),
    ],
)
def test_a_bad_preset_file_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "mine.yaml").write_text(GOOD)
    assert PresetFolder(tmp_path)["mine"].parameters == PRESETS["ms5611"].parameters
    (tmp_path / "mine.yaml").write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError, match=re.escape(message)):
        PresetFolder(tmp_path)["mine"]


def test_a_new_file_is_a_new_preset(tmp_path: Path) -> None:
    for name in ("zeta", "alpha"):
        (tmp_path / f"{name}.yaml").write_text(GOOD)
    folder = PresetFolder(tmp_path)
    assert list(folder) == ["alpha", "zeta"]
    assert len(folder) == 2
    assert "alpha" in folder
    assert "beta" not in folder
    with pytest.raises(KeyError):
        folder["beta"]
