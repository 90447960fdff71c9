"""A mission that leads nowhere is refused: armed, the vehicle hopped, and its waypoint on the ground was reached."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from signals.errors import ConfigError

WAYPOINT, TAKE_OFF, LAND = ("3 {} 0 0 0 0 47.397742 8.545594 {} 1".format(n, "{}") for n in (16, 22, 21))


@pytest.mark.parametrize(
    ("items", "is_refused"),
    [
        ((WAYPOINT.format(0),), True),
        ((LAND.format(0),), True),
        ((TAKE_OFF.format(0.1), WAYPOINT.format(0.2), LAND.format(0)), True),
        ((TAKE_OFF.format(1), LAND.format(0)), False),
        ((WAYPOINT.format(1),), False),
        ((WAYPOINT.format(0).replace("8.545594", "8.5457"),), False),
    ],
)
def test_a_mission_that_stays_at_the_start_is_refused(items: tuple[str, ...], is_refused: bool, tmp_path: Path) -> None:
    path = tmp_path / "m.waypoints"
    path.write_text("\n".join(["QGC WPL 110", *(f"{n} 0 {item}" for n, item in enumerate(items))]))
    if not is_refused:
        assert load_bench(mission=str(path)).mission is not None
        return
    with pytest.raises(ConfigError) as caught:
        load_bench(mission=str(path))
    (problem,) = caught.value.problems
    assert "m.waypoints:2: item 0 and what follows lie at the start, on the ground: nothing would" in str(problem)
