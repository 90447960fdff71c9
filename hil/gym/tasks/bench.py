"""Any bench: the observation is its ports, reward and end are functions of the user."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from math import isfinite
from typing import Annotated, Any

import numpy as np
from gymnasium.spaces import Dict
from pydantic import Field

from hil.config import Bench
from hil.gym.flight import Flight
from hil.gym.options import FUNCTION, FlightOptions
from hil.gym.task import Ends, Rewards, Step, Task, seed_of
from hil.gym.transition import Transition
from hil.run.sensors.frame_stages import available_ports
from signals.errors import ConfigError

Function = Callable[[Transition], Any]


class BenchOptions(FlightOptions):
    """Ports and functions."""

    ports: Annotated[tuple[str, ...], Field(min_length=1)] | None = None  # None: the true state and every sensor
    reward: Annotated[str | None, FUNCTION] = None  # "module:function"; None: 0
    end: Annotated[str | None, FUNCTION] = (
        None  # "module:function"; None: when the vehicle leaves the range of the model
    )


class BenchTask(Task):
    """Ports, reward and end of a batch of vehicles of one bench."""

    Options = BenchOptions

    @classmethod
    def ports(cls, bench: Bench, options: BenchOptions) -> tuple[str, ...]:
        return tuple(available_ports(bench.config)) if options.ports is None else options.ports

    def __init__(self, flights: Sequence[Flight], options: BenchOptions, name: str) -> None:
        self._name, self._flights = name, list(flights)
        self._reward = function(options.reward, name, "reward")
        self._end = function(options.end, name, "end")
        ports = flights[0].ports
        assert ports is not None
        self.observation_space = Dict(dict(ports.spaces))
        self._before = [flight.truth for flight in flights]

    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        self._flights[row] = flight
        flight.restart(seed_of(random))
        flight.begin(seed_of(random), flight.truth.p_WB)
        self._before[row] = flight.truth

    def observe(self) -> dict[str, Any]:
        read = [flight.ports.read(flight.truth) for flight in self._flights if flight.ports is not None]
        if len(read) == 1:
            return {name: value[None] for name, value in read[0].items()}
        return {name: np.stack([each[name] for each in read]) for name in read[0]}

    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        count = len(self._flights)
        rewards, ends = np.zeros(count), np.zeros(count, np.bool_)
        for row, flight in enumerate(self._flights):
            before, after = self._before[row], flight.truth
            self._before[row] = after
            if not step.flies[row]:
                continue
            departed = flight.departure is not None
            ends[row] = departed
            if self._reward is not None or self._end is not None:
                observation = {name: value[row] for name, value in step.observations.items()}
                action, t_s = tuple(step.actions[row].tolist()), after.t_ns * 1e-9
                seen = Transition(before, after, action, observation, t_s, departed, touched=flight.touched)
                if self._reward is not None:
                    rewards[row] = number(self._reward(seen), self._name)
                if self._end is not None:
                    ends[row] = departed or flag(self._end(seen), self._name)
        return rewards, ends


def number(reward: Any, name: str) -> float:
    """Return a reward of the user's function. Raises ValueError unless it is a finite number."""
    try:
        value = float(reward)
    except (TypeError, ValueError, OverflowError):
        value = float("nan")
    if not isfinite(value):
        raise ValueError(f"{name}: reward returned {reward!r}; it has to return a finite number")
    return value


def flag(end: Any, name: str) -> bool:
    """Return an end of the user's function. Raises ValueError unless it is True or False."""
    if isinstance(end, bool | np.bool_):
        return bool(end)
    raise ValueError(f"{name}: end returned {end!r}; it has to return True or False")


def function(entry: str | Function | None, name: str, option: str) -> Function | None:
    """Return the function that an option names. Raises ConfigError for one that cannot be imported."""
    if entry is None or not isinstance(entry, str):
        return entry
    module, _, attribute = entry.partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        hint = 'write "module:function", with the module on the path of Python'
        raise ConfigError.at(name, f"{option} {entry!r} cannot be imported: {error}", hint) from None
    if not callable(found):
        raise ConfigError.at(name, f"{option} {entry!r} must be a function, not {found!r}")
    result: Function = found
    return result
