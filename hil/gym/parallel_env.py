"""PettingZoo's parallel interface for a bench with several vehicles: each vehicle is an agent.

All vehicles fly in one world: they see each other, collide, and with `group.downwash` blow on each other. A vehicle
whose episode has ended stays in the world with its rotors stopped.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils.seeding import np_random

from hil.config import Bench
from hil.config.schema import named_seed
from hil.gym.actions import action_space, checked, make_driver
from hil.gym.options import read_bench, read_options
from hil.gym.pictures import RENDER_MODES, Window, check_mode, rendering
from hil.gym.ports import Ports
from hil.gym.recordings import Recordings
from hil.gym.task import seed_of
from hil.gym.tasks.bench import BenchOptions, flag, function, number
from hil.gym.transition import Transition
from hil.run.film.film import Film, Picture, check_view
from hil.run.sensors.frame_stages import available_ports
from hil.run.stepped.world import SteppedWorld
from signals.errors import ConfigError
from signals.samples import TruthState
from sim.frame.source import SharedFrames

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    message = "hil.gym.parallel_env needs pettingzoo, which is missing: pip install 'hil-bench[gym]'"
    raise ImportError(message) from error

_NAME = "hil.gym.parallel_env"


class FlightParallelEnv(ParallelEnv[str, Any, Any]):
    """Vehicles of a bench as agents. Options, ports, reward and end: those of `hil/Bench-v0` (docs/gym.md)."""

    metadata: dict[str, Any] = {  # noqa: RUF012 (PettingZoo's)
        "name": "hil_bench_v0",
        "render_modes": RENDER_MODES,
        "render_fps": 50,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        bench: Bench | Path | str | None = None,
        settings: Sequence[str] = (),
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Raises ConfigError for a wrong bench or options. `render_mode`: rgb_array, human (a window), or None."""
        self.render_mode = check_mode(render_mode, _NAME)
        bench = read_bench(bench, settings, _NAME)
        if not bench.vehicles:
            hint = "use hil/Bench-v0, or a bench with a section `vehicles`"
            raise ConfigError.at(_NAME, "the bench has no section `vehicles`", hint)
        self.bench = bench
        self.options = read_options(BenchOptions, options, _NAME)
        if self.options.randomize is not None:
            raise ConfigError.at(_NAME, "randomize is for one vehicle", "use hil/Bench-v0")
        self._made_of = {"bench": bench, "render_mode": render_mode, **options}
        self.metadata = rendering(type(self).metadata, self.options.step_s)
        self._window = Window(_NAME, self.metadata["render_fps"]) if render_mode == "human" else None
        self._film: Film | None = None
        check_view(bench, self.options.render_view)
        self._reward = function(self.options.reward, _NAME, "reward")
        self._end = function(self.options.end, _NAME, "end")
        config = bench.config
        self._ticks, self._most_steps = self.options.ticks(config.tick_ns, _NAME), self.options.steps()
        self.world = SteppedWorld(
            bench.scene,
            config.tick_ns,
            wind=config.wind,
            seed=config.seed,
            downwash=config.group.downwash,
            integration=self.options.integration(),
        )
        names = {
            name: tuple(available_ports(each.config)) if self.options.ports is None else self.options.ports
            for name, each in bench.vehicles.items()
        }
        needs_frames = any(Ports.need_frames(each, names[name]) for name, each in bench.vehicles.items())
        self._frames = SharedFrames(bench.world) if needs_frames else None
        self._members: dict[str, _Member] = {}
        for name, each in bench.vehicles.items():
            self._members[name] = _Member(name, each, self, names[name], self._frames)
        self.possible_agents: list[str] = list(self._members)
        self.agents: list[str] = []
        self._random: np.random.Generator | None = None
        self._seed = 0
        self._flown: list[dict[str, list[float]]] = []  # actions of the episode
        self._recordings = Recordings(self.options, list(self._members))
        self._steps = 0
        self._spaces = {name: Dict(dict(each.ports.spaces)) for name, each in self._members.items()}

    def observation_space(self, agent: str) -> Dict:
        """Return the space of an agent's observations: its ports."""
        return self._spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Return the space of an agent's actions."""
        return self._members[agent].space

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode at tick 0. The same seed gives the same bits. Raises ValueError for the option `map_seed`.

        Other options are ignored: PettingZoo's checker gives some.
        """
        if "map_seed" in (options or {}):
            raise ValueError(f"{_NAME}: the map stays; for another one give settings=['map_seed=7'] to the environment")
        if seed is not None or self._random is None:
            self._random, _ = np_random(seed)
        self._begin(seed_of(self._random))
        self._show()
        return {name: self._members[name].observe() for name in self.agents}, {name: {} for name in self.agents}

    def _begin(self, seed: int) -> None:
        """Begin the episode of a seed."""
        self._seed = seed
        self._flown.clear()
        for row, member in enumerate(self._members.values()):
            self._recordings.end(row)
            member.driver.close()
        self.world.restart(seed)
        for name, member in self._members.items():
            member.vehicle.restart(named_seed(seed, name))
        self._place(alone=True)
        for row, (name, member) in enumerate(self._members.items()):
            member.begin(named_seed(seed + 1, name))
            self._recordings.begin(row, member)
        self.agents, self._steps = list(self.possible_agents), 0
        if self._film is not None:
            self._film.restart()

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """Fly an action of every agent. Raises ValueError for wrong agents or actions."""
        agents = self.agents
        if not isinstance(actions, Mapping):
            raise ValueError(f"{_NAME}: actions must be a dictionary by agent, not {actions!r}")
        if wrong := [name for name in [*actions, *agents] if name not in agents or name not in actions]:
            known = ", ".join(agents) or "none: call reset()"
            raise ValueError(f"{_NAME}: actions must be given for exactly the agents ({known}); see {wrong[0]!r}")
        values = {}
        for name in agents:
            member = self._members[name]
            values[name] = checked(actions[name], member.shape, f"{_NAME} of {name}")
        result = self._fly(values)
        self._show()
        return result

    def _fly(self, values: Mapping[str, list[float]]) -> tuple[dict[str, Any], ...]:
        """Fly a step with an action of every agent."""
        self._flown.append(dict(values))
        flying = [self._members[name] for name in self.agents]
        for name, member in zip(self.agents, flying, strict=True):
            member.command(values[name])
        for _ in range(self._ticks):
            self.world.step()
            self._place(alone=False)
            for member in flying:
                member.ports.sample(member.vehicle.truth)
                member.touched |= member.vehicle.truth.in_contact
        return self._judge(values)

    def _judge(self, values: Mapping[str, list[float]]) -> tuple[dict[str, Any], ...]:
        self._steps += 1
        met: dict[str, list[str]] = {name: [] for name in self._members}
        for contact in self.world.take_contacts():
            met[contact.a].append(contact.b)
            met[contact.b].append(contact.a)
        departed = {departure.vehicle for departure in self.world.take_departures()}
        truths = {name: member.vehicle.truth for name, member in self._members.items()}
        observations: dict[str, Any] = {}
        rewards: dict[str, float] = {}
        ends: dict[str, bool] = {}
        for name in self.agents:
            member, after = self._members[name], truths[name]
            observations[name] = member.observe()
            step = Transition(
                member.before,
                after,
                tuple(values[name]),
                observations[name],
                after.t_ns * 1e-9,
                name in departed,
                name,
                {other: truth for other, truth in truths.items() if other != name},
                tuple(met[name]),
                member.touched,
            )
            member.before = after
            rewards[name] = 0.0 if self._reward is None else number(self._reward(step), f"{_NAME} of {name}")
            ends[name] = name in departed or (self._end is not None and flag(self._end(step), f"{_NAME} of {name}"))
        late = self._steps >= self._most_steps
        infos: dict[str, Any] = {
            name: {"met": tuple(met[name]), "touched": self._members[name].touched, "crashed": name in departed}
            for name in self.agents
        }
        self._record(values, rewards)
        truncated = dict.fromkeys(self.agents, late)
        for name in self.agents:
            if ends[name] or late:
                self._members[name].stop()
        self.agents = [name for name in self.agents if not ends[name] and not late]
        return observations, rewards, ends, truncated, infos

    def _record(self, values: Mapping[str, list[float]], rewards: Mapping[str, float]) -> None:
        for row, (name, member) in enumerate(self._members.items()):
            if name in rewards:
                self._recordings.add(row, member, values[name], rewards[name])

    def render(self) -> Any:
        """Return a picture, (height, width, 3) RGB, in the mode rgb_array: the first vehicle and those around it.

        Raises RuntimeError before the first reset.
        """
        if self.render_mode != "rgb_array":
            return None
        if self._random is None:
            raise RuntimeError(f"{_NAME}: call reset() before render()")
        return self._picture()

    def _picture(self) -> Picture:
        if self._film is None:
            self._film = Film(self.bench, self.options.render_size, self.options.render_view)
        return self._film.picture({name: member.vehicle.truth for name, member in self._members.items()})

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self._picture())

    def __reduce__(self) -> tuple[Any, ...]:
        random = copy.deepcopy(self._random)
        return _again, (self._made_of, random, None if random is None else self._seed, list(self._flown))

    def __deepcopy__(self, memo: dict[int, Any]) -> FlightParallelEnv:
        make, arguments = self.__reduce__()
        copied: FlightParallelEnv = make(*arguments)
        return copied

    def _place(self, *, alone: bool) -> None:
        """Give the states of all vehicles to the geometry."""
        if self._frames is None:
            return
        for name, member in self._members.items():
            place = self._frames.place_alone if alone else self._frames.place
            place(name, member.vehicle.truth)

    def close(self) -> None:
        """End autopilots, complete recordings, and release renderers."""
        for row, member in enumerate(self._members.values()):
            self._recordings.end(row)
            member.driver.close()
            member.ports.close()
        if self._window is not None:
            self._window.close()
        if self._film is not None:
            self._film.close()
            self._film = None


def _again(
    made_of: Mapping[str, Any], random: np.random.Generator | None, seed: int | None, flown: Sequence[Mapping[str, Any]]
) -> FlightParallelEnv:
    """Make an environment, and fly an episode again up to where it was."""
    env = FlightParallelEnv(**made_of)
    env._random = random
    if seed is not None:
        env._begin(seed)
        for values in flown:
            env._fly(values)
    return env


class _Member:
    """One vehicle."""

    def __init__(
        self, name: str, bench: Bench, env: FlightParallelEnv, ports: Sequence[str], frames: SharedFrames | None
    ) -> None:
        config = bench.config
        self.bench, self.seed, self.touched = bench, 0, False
        self.vehicle = env.world.add(
            name,
            bench.vehicle,
            config.start.flight_start(),
            effects=config.physics.effects,
            faults=config.faults.of_vehicle,
        )
        self.driver = make_driver(bench, self.vehicle, env.world, env.options)
        physics = self.vehicle.physics
        self.ports = Ports(
            bench, ports, None if frames is None else frames.seen_by(name), wind_at=lambda: physics.wind_W_mps
        )
        self.space = action_space(env.options, bench.vehicle, _NAME)
        self.shape: tuple[int, ...] = self.space.shape
        self.before: TruthState = self.vehicle.truth

    def begin(self, seed: int) -> None:
        """Begin an episode at the start."""
        self.seed, self.touched = seed, False
        self.driver.begin(self.vehicle.truth.p_WB)
        self.vehicle.pilot = self.driver.pilot
        self.ports.begin(seed, self.vehicle.truth)
        self.before = self.vehicle.truth

    def command(self, values: Sequence[float]) -> None:
        """Take an action for the coming step."""
        self.touched = False
        self.driver.command(values)

    @property
    def truth(self) -> TruthState:
        """True state now."""
        return self.vehicle.truth

    def observe(self) -> dict[str, Any]:
        """Return the present values of the ports."""
        return self.ports.read(self.vehicle.truth)

    def stop(self) -> None:
        """Stop the rotors."""
        self.vehicle.pilot = None
