"""A batch of flights with one task: what a single environment (a batch of one) and the vector environment share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym import tasks
from hil.gym.actions import action_space, cruise_commands
from hil.gym.flight import Flight, with_map_seed
from hil.gym.history import History
from hil.gym.options import read_bench, read_options
from hil.gym.pictures import Picture, Pictures
from hil.gym.recordings import Recordings
from hil.gym.task import Ends, Rewards, Step, Task
from hil.run.stepped.ideal_controller import MOST_SPEED_MPS
from signals.documents.validate import nearest
from signals.errors import ConfigError
from sim._kernels import cruise_flights

# Each file is a task: the class MyNameTask in my_name.py.
TASKS = [module.name for module in iter_modules(tasks.__path__)]

_FLIES: Ends = np.ones(1, np.bool_)  # of a batch of one


class Batch:
    """Flights of one bench and their task. Raises ConfigError for a bench or options that are wrong.

    Pickled or copied, it is made again, and flies the present episodes of all flights again (history.py).
    """

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
            raise ConfigError.at(self.name, message, "use hil.gym.parallel_env, or a bench with one vehicle")
        self.bench = bench
        self._made_of = (task, count, bench, (), dict(options or {}))
        self.options = read_options(kind.Options, dict(options or {}), self.name)
        self.ticks = self.options.ticks(bench.config.tick_ns, self.name)
        self.most_steps, self._step_s = self.options.steps(), self.options.step_s
        self.action_space = action_space(self.options, bench.vehicle, self.name)
        self._ports = kind.ports(bench, self.options)
        self.flights = [self._flight(bench) for _ in range(count)]
        self._map_seeds: list[int | None] = [bench.config.map_seed] * count
        self.task: Task = kind(self.flights, self.options, self.name)
        self.steps: NDArray[np.int64] = np.zeros(count, np.int64)
        self._history = History(count)
        # For `cruise_flights`: which flights it may fly, their bodies and controllers, and what it returns.
        self._cruises: Ends = np.zeros(count, np.bool_)
        self._bodies: list[Any] = [None] * count
        self._controllers: list[Any] = [None] * count
        self._flown: NDArray[np.float64] = np.zeros((count, 4))
        self._ahead: NDArray[np.int64] = np.zeros(count, np.int64)  # see Flight
        self._touched: Ends = np.zeros(count, np.bool_)
        self._crashed: Ends = np.zeros(count, np.bool_)
        self._pictures = Pictures(bench, self.options, self.name)
        self._recordings = Recordings(self.options, [""] if count == 1 else [f"environment-{k}" for k in range(count)])

    def _flight(self, bench: Bench) -> Flight:
        return Flight(bench, self.options, self._ports)

    def reset(self, row: int, random: np.random.Generator, options: Mapping[str, Any] | None = None) -> None:
        """Begin an episode. Options: `map_seed` makes a new map. Raises ValueError for other options."""
        self._recordings.end(row)
        if options is not None:
            self._change_map(row, options)
        self._history.begin(row, random)
        self._begin(row, random)
        self._recordings.begin(row, self.flights[row])

    def _begin(self, row: int, random: np.random.Generator) -> None:
        flight = self.flights[row]
        self.task.begin(row, flight, random)
        self.steps[row] = 0
        self._touched[row] = self._crashed[row] = False
        self._cruises[row] = flight.cruises
        flight.ahead = self._ahead[row : row + 1]
        self._bodies[row], self._controllers[row] = flight.physics.body, flight.driver.held
        self._pictures.restart(row)

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
        self._enter_map(row, int(map_seed))

    def _enter_map(self, row: int, map_seed: int) -> None:
        if map_seed == self._map_seeds[row]:
            return
        try:
            bench = with_map_seed(self.bench, map_seed)
        except ValueError as error:
            raise ValueError(f"{self.name}: map_seed has no meaning: {error}; leave it out") from None
        flight = self._flight(bench)
        self.flights[row].close()
        self.flights[row] = flight
        self._map_seeds[row] = map_seed

    def step(self, actions: NDArray[np.float64], flies: Ends) -> tuple[Any, Rewards, Ends, Ends]:
        """Fly an action of every vehicle, within -1..1; one that does not fly has begun an episode.

        Return observations, rewards, ends, truncations.
        """
        self._history.add(actions, flies)
        self._fly(actions, flies)
        observations = self.task.observe()
        rewards, ends = self.task.judge(Step(actions, flies, observations, self._crashed))
        self.steps += flies.view(np.int8)
        if self._recordings.any:
            for row in np.flatnonzero(flies).tolist():
                self._recordings.add(row, self.flights[row], actions[row].tolist(), float(rewards[row]))
        return observations, rewards, ends, self.steps >= self.most_steps

    def step_alone(self, values: list[float]) -> tuple[Any, float, bool, bool]:
        """`step` of a batch of one, with numbers: arrays of one element would take a sixth of its time."""
        actions = np.array([values])
        self._history.add(actions, _FLIES)
        self._fly_alone(values)
        observations = self.task.observe()
        reward, ends = self.task.judge_alone(Step(actions, _FLIES, observations, self._crashed))
        steps = int(self.steps[0]) + 1
        self.steps[0] = steps
        if self._recordings.any:
            self._recordings.add(0, self.flights[0], values, reward)
        return observations, reward, ends, steps >= self.most_steps

    def _fly_alone(self, values: list[float]) -> None:
        flight = self.flights[0]
        flight.fly(values, self.ticks)
        self._touched[0], self._crashed[0] = flight.touched, flight.crashed

    def _fly(self, actions: NDArray[np.float64], flies: Ends) -> None:
        ticks, flights = self.ticks, self.flights
        if len(flights) == 1:
            if flies[0]:
                self._fly_alone(actions[0].tolist())
            return
        together = self._cruises & flies
        if together.any():
            self._fly_together(actions, together)
        for row in np.flatnonzero(flies & ~together).tolist():
            flights[row].fly(actions[row].tolist(), ticks)
            self._note(row)

    def _fly_together(self, actions: NDArray[np.float64], together: Ends) -> None:
        """Fly in one native call; a flight that comes near something goes on by itself."""
        ticks, flights, flown = self.ticks, self.flights, self._flown
        commands = cruise_commands(actions, self.options)
        controllers = [] if self.options.action == "motors" else self._controllers
        cruise_flights(self._bodies, controllers, commands, together, ticks, MOST_SPEED_MPS, flown)
        self._touched[together] = self._crashed[together] = False
        whole = together & (flown[:, 0] == ticks) & (flown[:, 2] == 0.0)
        self._ahead[whole] += ticks
        for row in np.flatnonzero(together & ~whole).tolist():
            done, travelled_m, violation, bad = flown[row].tolist()
            flights[row].resume(actions[row].tolist(), ticks, (int(done), travelled_m, int(violation), int(bad)))
            self._note(row)

    def _note(self, row: int) -> None:
        """Take notice of how an action ended, and of a flight that is no longer free to cruise."""
        flight = self.flights[row]
        self._touched[row], self._crashed[row] = flight.touched, flight.crashed
        self._cruises[row] = flight.cruises

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return what `info` has at every step: a value for each vehicle, in arrays that are not changed later."""
        values: dict[str, NDArray[Any]] = {
            "t_s": self.steps * self._step_s,
            "touched": self._touched,
            "crashed": self._crashed,
        }
        values |= self.task.info()
        if "is_success" in values:  # what it hit at its goal is no success
            values["is_success"] = values["is_success"] & ~self._crashed
        return {name: value.copy() for name, value in values.items()}

    def info(self, row: int) -> dict[str, Any]:
        """Return the `info` of one vehicle."""
        own: dict[str, Any] = self.task.info_of(row)
        own["t_s"] = int(self.steps[row]) * self._step_s
        own["touched"], own["crashed"] = bool(self._touched[row]), bool(self._crashed[row])
        if "is_success" in own:
            own["is_success"] = own["is_success"] and not own["crashed"]
        return own

    def first_info(self, row: int) -> dict[str, Any]:
        """Return the `info` at the start of an episode: also what `randomize` has drawn."""
        drawn = {} if self.options.randomize is None else {"randomized": self.flights[row].draw._asdict()}
        return self.info(row) | drawn

    def picture(self, row: int) -> Picture:
        """Return a picture of a flight, (height, width, 3) RGB."""
        return self._pictures.draw(row, self.flights[row], self.task.marks(row))

    def close(self) -> None:
        """End autopilots, recordings and renderers."""
        for row, flight in enumerate(self.flights):
            self._recordings.end(row)
            flight.close()
        self._pictures.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self._made_of, self._map_seeds, self._history)

    def __deepcopy__(self, memo: dict[int, Any]) -> Batch:
        return _again(self._made_of, self._map_seeds, self._history)

    def fly_again(self, map_seeds: Sequence[int | None], history: History) -> None:
        """Fly the present episodes of another batch of the same options."""
        for row, seed in enumerate(map_seeds):
            if seed is not None:
                self._enter_map(row, seed)
        self._history = history.copy()
        for row, random in enumerate(history.starts()):
            if random is not None:
                self._begin(row, random)
        for actions, flies in history.steps():
            self._fly(actions, flies)
            self.task.judge(Step(actions, flies, self.task.observe(), self._crashed))
            self.steps += flies


def _again(made_of: tuple[Any, ...], map_seeds: Sequence[int | None], history: History) -> Batch:
    batch = Batch(*made_of)
    batch.fly_again(map_seeds, history)
    return batch


def environment_id(task: str) -> str:
    """Return the id of a task's environment in gymnasium's registry."""
    return f"hil/{_camel_case(task)}-v0"


def _camel_case(task: str) -> str:
    """Return FigureEight of figure_eight."""
    return task.title().replace("_", "")


def task_class(task: str) -> type[Task]:
    """Return the class of a task. Raises ConfigError for an unknown name."""
    if task not in TASKS:
        raise ConfigError.at("hil.gym", f"task {task!r} is unknown", nearest(task, TASKS))
    found: type[Task] = getattr(import_module(f"hil.gym.tasks.{task}"), f"{_camel_case(task)}Task")
    return found


def _bench_file(name: str) -> Path:
    import rigs

    return Path(rigs.__file__).resolve().parent / "benches" / f"{name}.yaml"
