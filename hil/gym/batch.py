"""A batch of flights with one task: what a single environment (a batch of one) and the vector environment share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym.actions import action_space
from hil.gym.flight import Flight, with_map_seed
from hil.gym.options import read_bench, read_options
from hil.gym.tasks.task import Ends, Rewards, Task
from signals.documents.validate import nearest
from signals.errors import ConfigError, Problem

TASKS = {
    "hover": "hil.gym.tasks.hover:HoverTask",
    "waypoints": "hil.gym.tasks.waypoints:WaypointsTask",
    "explore": "hil.gym.tasks.explore:ExploreTask",
    "bench": "hil.gym.tasks.bench:BenchTask",
}


class Batch:
    """Flights of one bench and their task. Raises ConfigError for a bench or options that are wrong."""

    def __init__(
        self,
        task: str,
        count: int,
        bench: Bench | Path | str | None = None,
        settings: Sequence[str] = (),
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """`bench`: a loaded bench or its file; None: that of the task. `settings`: texts as for --set."""
        self.name = environment_id(task)
        kind = task_class(task)
        bench = read_bench(bench, settings, self.name, None if kind.bench is None else _bench_file(kind.bench))
        if bench.vehicles:
            message = f"has {len(bench.vehicles)} vehicles, and this environment flies one"
            raise ConfigError([Problem(self.name, message, "use hil.gym.parallel_env, or a bench with one vehicle")])
        self.bench = bench
        self.options = read_options(kind.Options, dict(options or {}), self.name)
        self.ticks = self.options.ticks(bench.config.tick_ns, self.name)
        self.most_steps = self.options.steps()
        self.action_space = action_space(self.options, bench.vehicle)
        self._ports = kind.ports(bench, self.options)
        self.flights = [self._flight(bench) for _ in range(count)]
        self._map_seeds: list[int | None] = [bench.config.map_seed] * count
        self.task: Task = kind(self.flights, self.options, self.name)
        self.steps: NDArray[np.int64] = np.zeros(count, np.int64)

    def _flight(self, bench: Bench) -> Flight:
        return Flight(bench, self.options, self._ports)

    def reset(self, row: int, random: np.random.Generator, options: Mapping[str, Any] | None = None) -> None:
        """Begin an episode. Options: `map_seed` makes a new map. Raises ValueError for other options."""
        if options is not None:
            self._change_map(row, options)
        self.task.begin(row, self.flights[row], random)
        self.steps[row] = 0

    def _change_map(self, row: int, options: Mapping[str, Any]) -> None:
        if not isinstance(options, Mapping):
            raise ValueError(f"{self.name}: options of reset must be a dictionary, not {options!r}")
        if wrong := [key for key in options if key != "map_seed"]:
            raise ValueError(f"{self.name}: reset has no option {wrong[0]!r}; the only one is 'map_seed'")
        map_seed = options.get("map_seed")
        if map_seed is None:
            return
        if not isinstance(map_seed, int | np.integer) or isinstance(map_seed, bool) or not 0 <= map_seed < 2**63:
            raise ValueError(f"{self.name}: map_seed must be a whole number from 0 on, not {map_seed!r}")
        if map_seed == self._map_seeds[row]:
            return
        try:
            bench = with_map_seed(self.bench, int(map_seed))
        except ValueError as error:
            raise ValueError(f"{self.name}: map_seed has no meaning: {error}; leave it out") from None
        flight = self._flight(bench)
        self.flights[row].close()
        self.flights[row] = flight
        self._map_seeds[row] = int(map_seed)

    def step(self, actions: Sequence[Sequence[float] | None]) -> tuple[Any, Rewards, Ends, Ends]:
        """Fly an action of every vehicle, None: it does not fly. Return observations, rewards, ends, truncations."""
        ticks = self.ticks
        for flight, action in zip(self.flights, actions, strict=True):
            if action is not None:
                flight.fly(action, ticks)
        observations = self.task.observe()
        rewards, ends = self.task.judge(actions, observations)
        self.steps += 1
        return observations, rewards, ends, self.steps >= self.most_steps

    def close(self) -> None:
        """End autopilots and release renderers."""
        for flight in self.flights:
            flight.close()


def environment_id(task: str) -> str:
    """Return the id of a task's environment in gymnasium's registry."""
    return f"hil/{task.title()}-v0"


def task_class(task: str) -> type[Task]:
    """Return the class of a task. Raises ConfigError for an unknown name."""
    if task not in TASKS:
        raise ConfigError([Problem("hil.gym", f"task {task!r} is unknown", nearest(task, TASKS))])
    module, _, name = TASKS[task].partition(":")
    found: type[Task] = getattr(import_module(module), name)
    return found


def _bench_file(name: str) -> Path:
    import rigs

    return Path(rigs.__file__).resolve().parent / "benches" / f"{name}.yaml"
