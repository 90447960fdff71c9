"""Points of a campaign: axes, distributions, sampling, settings, filters and their errors."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.apps.campaign.cases.campaign_file import load_campaign
from hil.apps.campaign.cases.distributions import Distribution
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.cases.sampling import UnitSamples
from hil.apps.campaign.cases.settings import texts_of, with_values
from hil.config.layers import parse_setting
from signals.errors import ConfigError

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


def plan_of(tmp_path: Path, text: str) -> Plan:
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return Plan(load_campaign(path))


@pytest.mark.parametrize("text", ["", "# axes: {seed: [1]}\n"])
def test_an_empty_file_is_no_campaign(text: str, tmp_path: Path) -> None:
    """It flew one bench of defaults, without a mission, and passed."""
    with pytest.raises(ConfigError, match=r"study.yaml:1: is empty \(write at least `bench: FILE`\)"):
        plan_of(tmp_path, text)


def test_every_combination_is_a_point_and_samples_are_shared_by_all(tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path,
        """
        axes: {scene: [airfield, city_park], seed: {first: 5, count: 3}}
        samples: 4
        sampled: {vehicle_settings.mass_kg: {uniform: [2, 3]}}
        """,
    )
    points = list(plan)
    assert len(plan) == len(points) == 24
    assert [p.number for p in points] == list(range(24))
    first = [(p.values["scene"], p.values["seed"]) for p in points[:6]]
    assert first == [(scene, seed) for scene in ("airfield", "city_park") for seed in (5, 6, 7)]
    masses = [[p.values["vehicle_settings.mass_kg"] for p in points[i : i + 6]] for i in range(0, 24, 6)]
    assert all(len(set(block)) == 1 for block in masses)
    assert len({block[0] for block in masses}) == 4


@pytest.mark.parametrize("method", ["random", "sobol"])
def test_more_samples_keep_the_earlier_ones(method: Any) -> None:
    few, many = UnitSamples(method, ["a", "b"], 10, 7), UnitSamples(method, ["a", "b"], 700, 7)
    np.testing.assert_array_equal([few[i] for i in range(10)], [many[i] for i in range(10)])
    backwards = [many[i] for i in (699, 300, 3)]
    np.testing.assert_array_equal(backwards, [UnitSamples(method, ["a", "b"], 700, 7)[i] for i in (699, 300, 3)])


def test_another_axis_changes_no_random_value_of_the_others() -> None:
    one, two = UnitSamples("random", ["b"], 1, 7), UnitSamples("random", ["a", "b"], 1, 7)
    assert [one[i][0] for i in range(300)] == [two[i][1] for i in range(300)]


def test_latin_hypercube_has_one_sample_in_each_stratum() -> None:
    u = np.array([UnitSamples("latin_hypercube", ["a", "b"], 20, 3)[i] for i in range(20)])
    for column in u.T:
        assert sorted(np.floor(column * 20)) == list(range(20))


def test_sobol_fills_the_square_more_evenly_than_chance() -> None:
    """Discrepancy of 256 points: about log(n)^2/n for Sobol, about n^-1/2 for independent points."""
    from scipy.stats import qmc

    sobol, random = (np.array([UnitSamples(m, ["a", "b"], 256, 1)[i] for i in range(256)]) for m in ("sobol", "random"))
    assert qmc.discrepancy(sobol) < 0.1 * qmc.discrepancy(random)


@given(u=st.floats(2**-53, 1 - 2**-53), ends=st.tuples(NUMBERS, NUMBERS).map(sorted))
def test_uniform_values_lie_within_their_ends(u: float, ends: list[float]) -> None:
    x = Distribution(uniform=tuple(ends)).value(u)
    slack = 1e-5 * max(abs(ends[0]), abs(ends[1]))  # six digits
    assert ends[0] - slack <= x <= ends[1] + slack


def test_distributions_have_their_quantiles() -> None:
    assert Distribution(uniform=(-2, 4)).value(0.25) == -0.5
    assert Distribution(normal=(10, 2)).value(0.975) == pytest.approx(10 + 2 * 1.959964, abs=1e-4)
    assert Distribution(normal=(10, 2), within=(9, 11)).value(0.999) == 11
    assert Distribution(log_uniform=(1, 100)).value(0.5) == pytest.approx(10)
    integers = Distribution(integers=(3, 5))
    assert [integers.value(u) for u in (1e-9, 0.34, 0.67, 1 - 1e-12)] == [3, 4, 5, 5]
    choice = Distribution(choice=["a", "b"], weights=[3, 1])
    assert [choice.value(u) for u in (0.0001, 0.74, 0.76, 0.9999)] == ["a", "a", "b", "b"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sampled: {seed: {uniform: [0, 1], normal: [0, 1]}}", "needs exactly one of"),
        ("sampled: {seed: {uniform: [2, 1]}}", "must not be above"),
        ("sampled: {seed: {choice: [1, 2], weights: [1]}}", "one number for each value"),
        ("sampled: {seed: {choice: []}}", "choice"),
        ("axes: {seed: [1]}\nsampled: {seed: {integers: [1, 2]}}", "in axes and in sampled"),
        ("samples: 5", "has no effect without"),
        ("axes: {seed: [1, 2]}\nrepeats: 3", "seed is an axis"),
        ("axes: {seed: []}", "seed"),
        ("axes: {seed: [1]}\nskip: [{sead: 1}]", "is not an axis of this campaign"),
        ("axes: {seed: [1]}\nskip: [{seed: {over: 1}}]", "above and below"),
        ("axis: {seed: [1]}", "did you mean 'axes'"),
        ("recheck: 1.5", "recheck"),
    ],
)
def test_a_wrong_file_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        plan_of(tmp_path, text)
    assert "study.yaml:" in str(caught.value)


def test_values_find_their_places_in_lists_and_mappings() -> None:
    settings = {"wind": {"steady_W_mps": [0, 0, 0]}, "faults": {"sensors": [{"sensor": "gps", "at_s": 1}]}}
    changed = with_values(settings, {"wind.steady_W_mps.1": 4, "faults.sensors.0.at_s": 9, "limits.final_error_m": 2})
    assert changed["wind"]["steady_W_mps"] == [0, 4, 0]
    assert changed["faults"]["sensors"][0]["at_s"] == 9
    assert changed["limits"] == {"final_error_m": 2}
    assert settings["wind"]["steady_W_mps"] == [0, 0, 0], "the settings of the file are shared by all points"


@pytest.mark.parametrize(
    "axis", ["wind.gusts.0.at_s", "wind.steady_W_mps.3", "wind.steady_W_mps.x", "seed.first", "wind.steady_W_mps.0.x"]
)
def test_a_place_that_is_not_there_is_an_error(axis: str) -> None:
    with pytest.raises(ConfigError, match=r"axis "):
        with_values({"wind": {"steady_W_mps": [0, 0, 0]}, "seed": 1}, {axis: 1})


def test_a_bundle_sets_several_keys_and_is_shown_by_its_label(tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path,
        """
        settings: {wind: {steady_W_mps: [1, 0, 0]}}
        axes:
          conditions:
            - {label: calm, settings: {wind: {steady_W_mps: [0, 0, 0]}}}
            - {label: night, settings: {limits: {final_error_m: 2.0}, seed: 9}}
        """,
    )
    calm, night = plan
    assert [p.values for p in (calm, night)] == [{"conditions": "calm"}, {"conditions": "night"}]
    assert calm.texts == ("wind.steady_W_mps=[0, 0, 0]",)
    assert set(night.texts) == {"wind.steady_W_mps=[1, 0, 0]", "limits.final_error_m=2.0", "seed=9"}


def test_skipped_points_are_left_out(tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path,
        """
        axes: {scene: [airfield, city_park], seed: [1, 2, 3]}
        skip: [{scene: city_park, seed: {above: 2}}, {seed: 1}]
        """,
    )
    left = [(p.values["scene"], p.values["seed"]) for p in plan]
    assert left == [("airfield", 2), ("airfield", 3)]


def test_repeats_have_consecutive_seeds(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "settings: {seed: 40}\nrepeats: 3\naxes: {scene: [airfield]}")
    assert [p.values["seed"] for p in plan] == [40, 41, 42]


JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**40), 2**40)
    | NUMBERS
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    lambda children: st.lists(children, max_size=3),
    max_leaves=5,
)


@given(value=JSON_VALUES)
def test_a_text_of_set_reads_back_as_its_value(value: Any) -> None:
    (text,) = texts_of({"parts": value})
    place, read, _ = parse_setting(text)
    assert place == ("parts",)
    assert json.dumps(read) == json.dumps(value)
    assert not isinstance(value, float) or math.isclose(read, value, rel_tol=0)
