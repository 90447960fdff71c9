"""A search for what the scene does not have is refused before the flight."""

from __future__ import annotations

import pytest

from hil.config import load_bench
from signals.errors import ConfigError


def test_a_search_for_what_the_scene_does_not_have_is_refused() -> None:
    assert load_bench("rigs/people_search.yaml", settings=["search.label=dog"]).config.search is not None
    with pytest.raises(ConfigError) as refused:
        load_bench("rigs/people_search.yaml", settings=["search.label=persn"])
    (problem,) = refused.value.problems
    assert str(problem) == (
        "--set search.label: is 'persn', of which the scene 'city_park' has no object: nothing could be found "
        "(did you mean 'person'?)"
    )
    with pytest.raises(ConfigError, match=r"search\.label is 'person', of which the scene 'airfield' has no object"):
        load_bench("rigs/people_search.yaml", scene="airfield", settings=["map_seed=null", "mission=null"], flown=False)
