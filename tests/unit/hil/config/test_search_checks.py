"""A search for what the scene does not have is refused before the flight."""

from __future__ import annotations

from typing import Any

import pytest

from hil.config import load_bench
from signals.errors import ConfigError


def test_a_search_for_what_the_scene_does_not_have_is_refused() -> None:
    def searched(label: str, **more: Any) -> Any:
        return load_bench(
            "rigs/people_search.yaml",
            settings=[f"search.label={label}", f"companion.settings.objects=[{label}]", *more.pop("settings", [])],
            **more,
        )

    assert searched("dog").config.search is not None
    with pytest.raises(ConfigError) as refused:
        searched("container")
    (problem,) = refused.value.problems
    assert str(problem).startswith(
        "--set search.label: is 'container', of which the scene 'city_park' has no object: nothing could be found"
    )
    with pytest.raises(ConfigError, match=r"search\.label: is 'person', of which the scene 'airfield' has no object"):
        searched("person", scene="airfield", settings=["map_seed=null"])
    searched("person", scene="airfield", settings=["map_seed=null"], flown=False)  # such as for a data set
    # A seed may add what is searched for.
    added = ["map_seed=null", "randomize.people={count: [0, 1]}"]
    assert searched("person", scene="airfield", settings=added).scene.appearance is not None
