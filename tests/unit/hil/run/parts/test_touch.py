"""Touches in flight: what is hit and left again fails, landings and bounces do not."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.parts.catalog import parts_of
from hil.run.parts.judges.touch import TouchPart
from signals.samples import TruthState, Vec3

TICK_NS = 4_000_000
STILL: Vec3 = (0.0, 0.0, 0.0)
TREE = SimpleNamespace(name="tree_002", normal_W=(0.0, 0.0, 1.0))
WALL = SimpleNamespace(name="wall", normal_W=(1.0, 0.0, 0.0))


class Judged:
    """A touch part with a vehicle that is put where the test wants it."""

    def __init__(self, contact: Any = TREE) -> None:
        self.events: list[str] = []
        self.scheduler = SimpleNamespace(truth=None)
        self.part = TouchPart(2.0)
        self.tick = 0
        run: Any = SimpleNamespace(
            scheduler=self.scheduler,
            event=lambda _kind, text: self.events.append(text),
            physics=SimpleNamespace(state=[0.0, 0.0, 0.2], contact=lambda: contact),
        )
        self.part.begin(run)

    def stay(self, seconds: float, p: Vec3, *, v: Vec3 = (0.5, 0.0, 0.0), contact: bool = False) -> None:
        """Keep a state for some time."""
        for _ in range(round(seconds * 250)):
            t_ns = self.tick * TICK_NS
            self.scheduler.truth = TruthState(
                self.tick, t_ns, p, (1.0, 0.0, 0.0, 0.0), v, STILL, STILL, STILL, (0.0,) * 4, contact
            )
            self.part.after_tick(self.tick)
            self.tick += 1

    @property
    def reasons(self) -> list[str]:
        return list(self.part.verdict().reasons)


def test_what_is_touched_in_flight_and_left_behind_is_a_fail() -> None:
    judged = Judged()
    judged.stay(2.0, (0.0, 0.0, 6.5))
    judged.stay(3.0, (0.5, 0.0, 5.5), contact=True)  # slides down the crown
    judged.stay(0.1, (0.5, 0.0, 4.5), contact=True)
    judged.stay(0.1, (0.5, 0.0, 3.6))
    assert judged.reasons == []
    judged.stay(0.1, (0.5, 0.0, 3.4))
    assert judged.reasons == [
        "touched 'tree_002' in flight, 2.00 s after the start at (0.5, 0.0, 5.5) m, and went on; "
        "crash.touch_m allows 2 m"
    ]
    judged.stay(1.0, (0.5, 0.0, 0.2), v=STILL, contact=True)
    assert len(judged.events) == 1


def test_a_touch_of_what_has_no_name_is_told() -> None:
    judged = Judged(contact=None)
    judged.stay(1.0, (0.0, 0.0, 3.0))
    judged.stay(0.004, (0.0, 0.0, 3.0), contact=True)
    judged.stay(0.1, (4.0, 0.0, 3.0))
    assert "touched something in flight, 1.00 s" in judged.reasons[0]


def test_a_bounce_and_a_landing_on_a_roof_with_another_flight_pass() -> None:
    judged = Judged()
    judged.stay(1.0, (0.0, 0.0, 0.2), v=STILL, contact=True)
    judged.stay(0.1, (0.0, 0.0, 0.3))
    judged.stay(0.1, (0.0, 0.0, 0.25), contact=True)  # scrapes along before it is in the air
    judged.stay(2.0, (0.0, 0.0, 9.0))
    judged.stay(0.1, (20.0, 0.0, 5.2), contact=True)
    judged.stay(0.3, (20.5, 0.0, 5.9))  # bounces
    judged.stay(1.5, (20.5, 0.0, 5.2), v=STILL, contact=True)  # and has landed
    judged.stay(2.0, (40.0, 0.0, 9.0))
    judged.stay(2.0, (60.0, 0.0, 0.2), v=STILL, contact=True)
    assert judged.reasons == []


def test_a_landing_that_slides_or_trembles_passes() -> None:
    judged = Judged()
    judged.stay(2.0, (0.0, 0.0, 3.0))
    for i in range(12):
        judged.stay(0.2, (0.3 * i, 0.0, 0.3), v=(0.9, 0.0, 0.0), contact=True)
        judged.stay(0.004, (0.3 * i, 0.0, 0.31), v=(0.9, 0.0, 0.0))
    for _ in range(4):
        judged.stay(0.4, (3.3, 0.0, 0.3), v=STILL, contact=True)
        judged.stay(0.004, (3.3, 0.0, 0.301), v=STILL)
    judged.stay(1.0, (20.0, 0.0, 9.0))
    assert judged.reasons == []


def test_a_vehicle_that_is_held_by_a_wall_has_not_landed() -> None:
    judged = Judged(contact=WALL)
    judged.stay(2.0, (0.0, 0.0, 3.0))
    judged.stay(3.0, (0.0, 0.0, 3.0), v=STILL, contact=True)
    judged.stay(0.1, (2.5, 0.0, 3.0))
    assert "touched 'wall' in flight" in judged.reasons[0]


@pytest.mark.parametrize(
    ("settings", "judged"),
    [
        (("scene=city_park",), True),
        ((), False),  # nothing but flat ground
        (("scene=city_park", "crash.touch_m=null"), False),
        (("scene=city_park", "crash=null"), False),
    ],
)
def test_the_part_is_there_where_something_can_be_hit(settings: tuple[str, ...], judged: bool) -> None:
    names = [part.name for part in parts_of(load_bench(settings=settings))]
    assert ("touch" in names) == judged


def test_a_flight_through_a_tree_fails(tmp_path: Path) -> None:
    plan = tmp_path / "down.waypoints"
    rows = ["QGC WPL 110"]
    home = "47.397742\t8.545594\t488"
    rows += [f"0\t1\t0\t16\t0\t0\t0\t0\t{home}\t1", "1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t10\t1"]
    rows += [f"{n}\t0\t3\t{c}\t0\t0\t0\t0\t47.397688\t8.5455145\t{h}\t1" for n, c, h in ((2, 16, 10), (3, 21, 0))]
    plan.write_text("\n".join([*rows, ""]))
    settings = ("autopilot.transport=loopback", "limits.final_error_m=null", "limits.max_cross_track_m=null")
    bench = load_bench(scene="city_park", mission=str(plan), settings=settings)
    run = run_bench(bench, tmp_path / "run", quiet=True).run
    assert run["status"] == "FAIL"
    assert any("touched 'tree_" in reason and "in flight" in reason for reason in run["verdict"]["reasons"])
