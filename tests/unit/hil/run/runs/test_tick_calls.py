"""Cost of a tick of the default flight, counted in calls: load on the machine cannot change this number."""

from __future__ import annotations

from cProfile import Profile
from pathlib import Path

from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.part import Part

# Calls of Python's functions and of built-in ones in a tick, those of the mock in this process among them. A feature
# that this flight does not use must add none; docs/tick.md says what they are.
MOST_CALLS = 169.0
_FROM_TICK, _TICKS = 2000, 1000  # in the air; whole periods of all sensors, and of the recorder's flushes


class CountedCalls(Part):
    """Counts the calls in some ticks of a flight, without one of its own between them."""

    name = "counted_calls"
    every_ticks = _TICKS

    def __init__(self) -> None:
        self._profile = Profile()
        self.per_tick: dict[str, float] = {}

    def after_tick(self, tick: int) -> None:
        if tick == _FROM_TICK:
            self._profile.enable()
        elif tick == _FROM_TICK + _TICKS:
            self._profile.disable()
            for entry in self._profile.getstats():
                code = entry.code
                name = code if isinstance(code, str) else f"{Path(code.co_filename).name}:{code.co_name}"
                self.per_tick[name] = self.per_tick.get(name, 0.0) + entry.callcount / _TICKS

    def ended(self) -> bool:
        return bool(self.per_tick)


def test_a_tick_of_the_default_flight_makes_few_calls(tmp_path: Path) -> None:
    counted = CountedCalls()
    bench = load_bench(settings=["autopilot.transport=loopback", "record.report=false"])
    run_bench(bench, tmp_path, quiet=True, more=[counted])
    calls = sum(counted.per_tick.values())
    most = sorted(counted.per_tick.items(), key=lambda item: -item[1])
    assert 100.0 < calls <= MOST_CALLS, "\n".join(f"{n:8.2f} {name}" for name, n in most)


def test_parts_are_called_at_their_period(tmp_path: Path) -> None:
    class Slow(Part):
        name = "slow"
        every_ticks = 40

        def __init__(self) -> None:
            self.ticks: list[int] = []

        def after_tick(self, tick: int) -> None:
            self.ticks.append(tick)

        def ended(self) -> bool:
            return len(self.ticks) == 3

    slow = Slow()
    bench = load_bench(settings=["autopilot.transport=loopback", "record.report=false", "record.tlog=false"])
    result = run_bench(bench, tmp_path, quiet=True, more=[slow])
    assert slow.ticks == [40, 80, 120]
    assert result.run["sim_s"] == 120 * 0.004
