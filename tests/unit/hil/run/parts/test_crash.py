"""Crashes: impact, lying on its side, resting armed away from the plan; and flights that have none of them."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil.config import load_bench
from hil.config.missions.path import planned_path
from hil.config.schema import Crash
from hil.run.bench_run import run_bench
from hil.run.parts.judges.crash import CrashPart
from signals.samples import TruthState

TICK_NS = 4_000_000
UPRIGHT, ON_ITS_SIDE = (1.0, 0.0, 0.0, 0.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
PLAN = load_bench()


class Judged:
    """A crash part with a vehicle that is put where the test wants it."""

    def __init__(self, limits: Crash | None = None, *, plan: bool = True, launching: bool = False) -> None:
        self.events: list[str] = []
        self.scheduler = SimpleNamespace(truth=None, actuators=SimpleNamespace(armed=True))
        self.now_ns_value = 0
        self.part = CrashPart(limits or Crash())
        legs = planned_path(PLAN.mission, PLAN.scene, home_W=(0.0, 0.0, 0.2)) if plan and PLAN.mission else ()
        run: Any = SimpleNamespace(
            scheduler=self.scheduler,
            legs=legs,
            now_ns=lambda: self.now_ns_value,
            event=lambda _kind, text: self.events.append(text),
            physics=SimpleNamespace(state=_Start(), launching=launching),
        )
        self.run, self.physics = run, run.physics
        self.tick = 0
        self.part.begin(run)

    def stay(
        self,
        seconds: float,
        p: tuple[float, float, float],
        *,
        v: tuple[float, float, float] = (0.0, 0.0, 0.0),
        q: tuple[float, float, float, float] = UPRIGHT,
        contact: bool = False,
        armed: bool = True,
    ) -> bool:
        """Keep a state for some time and return True if the flight has ended by then."""
        zero = (0.0, 0.0, 0.0)
        self.scheduler.actuators.armed = armed
        for _ in range(round(seconds * 250)):
            t_ns = self.tick * TICK_NS
            self.scheduler.truth = TruthState(self.tick, t_ns, p, q, v, zero, zero, zero, (0.0,) * 4, contact)
            self.part.after_tick(self.tick)
            self.tick += 1
            self.now_ns_value = self.tick * TICK_NS
            if self.part.ended():
                return True
        return False

    @property
    def reasons(self) -> tuple[str, ...]:
        return tuple(self.part.verdict().reasons)


class _Start:
    def __getitem__(self, _: slice) -> Any:
        return SimpleNamespace(tolist=lambda: [0.0, 0.0, 0.2])


def test_impact_ends_the_flight_a_second_later() -> None:
    judged = Judged()
    assert not judged.stay(2.0, (5.0, 0.0, 3.0), v=(0.0, 0.0, -7.0))
    assert judged.stay(1.2, (5.0, 0.0, 0.2), v=(0.0, 0.0, -1.0), contact=True)
    (reason,) = judged.reasons
    assert reason.startswith("crashed: impact at 7.0 m/s, 2.00 s after the start at (5.0, 0.0, 0.2) m")
    assert judged.events == [reason]


@pytest.mark.parametrize("limits", [Crash(impact_mps=None), Crash(impact_mps=8.0)])
def test_impact_below_its_limit_or_without_one(limits: Crash) -> None:
    judged = Judged(limits)
    judged.stay(1.0, (5.0, 0.0, 3.0), v=(0.0, 0.0, -7.0))
    assert not judged.stay(1.0, (5.0, 0.0, 0.2), v=(0.0, 0.0, -1.0), contact=True)
    assert judged.reasons == ()


def test_a_landing_is_no_crash() -> None:
    judged = Judged()
    judged.stay(1.0, (0.0, 0.0, 3.0), v=(0.0, 0.0, -1.5))
    assert not judged.stay(30.0, (0.0, 0.0, 0.2), contact=True)
    assert judged.reasons == ()


def test_lying_on_its_side_before_take_off_and_after() -> None:
    judged = Judged()
    assert judged.stay(3.0, (0.0, 0.0, 0.1), q=ON_ITS_SIDE, contact=True)
    assert "it lies on its side or back" in judged.reasons[0]
    assert "tilt 90 deg" in judged.reasons[0]


def test_a_second_on_its_side_is_a_crash_and_less_is_not() -> None:
    judged = Judged()
    judged.stay(0.98, (0.0, 0.0, 0.1), q=ON_ITS_SIDE, contact=True)
    assert judged.reasons == ()
    judged.stay(0.04, (0.0, 0.0, 0.1), q=ON_ITS_SIDE, contact=True)
    assert judged.reasons


@pytest.mark.parametrize(("apart_s", "crashed"), [(0.45, True), (0.55, False)])
def test_a_bounce_of_up_to_half_a_second_is_still_contact(apart_s: float, crashed: bool) -> None:
    judged = Judged()
    for seconds, contact in ((0.4, True), (apart_s, False), (0.2, True)):
        judged.stay(seconds, (0.0, 0.0, 0.1), q=ON_ITS_SIDE, contact=contact)
    assert bool(judged.reasons) is crashed


@pytest.mark.parametrize(("away_m", "crashed"), [(4.9, False), (5.1, True)])
def test_rest_within_five_metres_of_the_start_is_no_crash(away_m: float, crashed: bool) -> None:
    judged = Judged()
    judged.stay(1.0, (0.0, -away_m, 3.0))
    judged.stay(11.0, (0.0, -away_m, 0.2), contact=True)
    assert bool(judged.reasons) is crashed


def test_rest_counts_from_its_limit_on_and_the_flight_ends_a_second_later() -> None:
    judged = Judged(Crash(rest_s=4.0))
    judged.stay(1.0, (40.0, 60.0, 3.0))
    judged.stay(3.98, (40.0, 60.0, 0.2), contact=True)
    assert judged.reasons == ()
    judged.stay(0.04, (40.0, 60.0, 0.2), contact=True)
    assert judged.reasons
    assert not judged.stay(0.94, (40.0, 60.0, 0.2), contact=True)
    assert judged.stay(0.08, (40.0, 60.0, 0.2), contact=True)


def test_a_flip_in_the_air_is_no_crash() -> None:
    judged = Judged()
    assert not judged.stay(5.0, (0.0, 0.0, 30.0), q=ON_ITS_SIDE, v=(0.0, 0.0, 3.0))
    assert judged.reasons == ()


@pytest.mark.parametrize(("armed", "plan", "crashed"), [(True, True, True), (False, True, False), (True, False, False)])
def test_resting_away_from_the_plan(armed: bool, plan: bool, crashed: bool) -> None:
    judged = Judged(plan=plan)
    judged.stay(1.0, (40.0, 60.0, 3.0))
    assert judged.stay(13.0, (40.0, 60.0, 0.2), contact=True, armed=armed) is crashed
    assert bool(judged.reasons) is crashed


def test_a_stopped_rotor_ends_the_run_with_its_cause_first(tmp_path: Path) -> None:
    stopped = "faults.rotors=[{kind: stuck, rotor: 0, at_s: 20.0, speed_radps: 0}]"
    result = run_bench(load_bench(settings=[stopped, "record.report=false"]), tmp_path, quiet=True)
    assert result.status == "FAIL"
    assert result.run["verdict"]["reasons"][0].startswith("crashed: impact at ")
    assert result.run["sim_s"] < 30.0


def test_what_a_launcher_holds_has_not_crashed() -> None:
    judged = Judged(launching=True)
    assert not judged.stay(3.0, (0.0, 0.0, 1.2), q=ON_ITS_SIDE, contact=True)
    judged.physics.launching = False
    assert judged.stay(3.0, (0.0, 0.0, 0.1), q=ON_ITS_SIDE, contact=True)
    assert "it lies on its side or back" in judged.reasons[0]


@pytest.mark.parametrize(("contact", "crashed"), [(True, True), (False, False)])
def test_a_flight_that_ends_on_its_side_has_crashed_however_short_it_lay(contact: bool, crashed: bool) -> None:
    judged = Judged()
    judged.stay(1.0, (0.0, 0.0, 3.0), v=(0.0, 0.0, -5.0))
    judged.stay(0.1, (0.0, 0.0, 0.2), q=ON_ITS_SIDE, contact=True)
    judged.stay(0.1, (0.0, 0.0, 0.3), q=ON_ITS_SIDE, contact=contact)
    assert judged.reasons == ()
    judged.part.conclude(judged.run)
    assert bool(judged.reasons) is crashed


@pytest.mark.parametrize("outcome", ["any", "aborted"])
@pytest.mark.parametrize(("delay_s", "how"), [(4, "impact at "), (1.5, "it lies on its side or back")])
def test_a_vehicle_that_is_disarmed_in_the_air_falls_until_it_crashes(
    outcome: str, delay_s: float, how: str, tmp_path: Path
) -> None:
    """The mock, like other firmware, says that it is on the ground as soon as it is disarmed."""
    disarm = f"{{after: takeoff, delay_s: {delay_s}, command: {{id: 400, params: [0, 21196]}}}}"  # by force
    plan = "square.waypoints" if delay_s > 2 else "short.waypoints"
    (tmp_path / "script.yaml").write_text(
        f"plan: {Path('rigs/missions', plan).resolve()}\noutcome: {outcome}\nactions: [{disarm}]\n"
        "limits: {max_cross_track_m: null, altitude_error_m: null, final_error_m: null, landing_speed_mps: null, "
        "landed_tilt_deg: null}\n"
    )
    settings = ("autopilot.transport=loopback", "record={mcap: false, tlog: false, report: false}")
    bench = load_bench(mission=str(tmp_path / "script.yaml"), settings=settings)
    run = run_bench(bench, tmp_path / "run", quiet=True).run
    assert run["status"] == "FAIL", run["sim_s"]
    assert f"crashed: {how}" in run["verdict"]["reasons"][0]
