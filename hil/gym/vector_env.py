"""Many vehicles in one process, each alone in its world: no autopilots, no other processes.

The results are those of as many single environments in `gymnasium.vector.SyncVectorEnv`, to the bit. Environment i of
`reset(seed=s)` has the seed s + i. An environment whose episode has ended begins the next one with the next call of
`step`, in which it does not fly (gymnasium's `AutoresetMode.NEXT_STEP`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym.actions import checked
from hil.gym.batch import Batch
from hil.gym.pictures import check_mode, rendering
from signals.errors import ConfigError, Problem


class FlightVectorEnv(VectorEnv[Any, Any, Any]):
    """Batch of environments: `gymnasium.make_vec(id, num_envs, vectorization_mode="vector_entry_point")`."""

    metadata: dict[str, Any] = {  # noqa: RUF012 (gymnasium's)
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        bench: Bench | Path | str | None = None,
        settings: Sequence[str] = (),
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """See `hil.gym.env.FlightEnv`. Raises ConfigError."""
        if not isinstance(num_envs, int) or num_envs < 1:
            problem = Problem("hil.gym", f"num_envs must be a whole number of at least 1, not {num_envs!r}")
            raise ConfigError([problem])
        self.num_envs = num_envs
        self.batch = Batch(task, num_envs, bench, settings, options)
        self.render_mode = check_mode(render_mode, self.batch.name)
        if render_mode == "human":
            problem = Problem(self.batch.name, "a batch has no window", "use render_mode rgb_array, or a single one")
            raise ConfigError([problem])
        self.metadata = rendering(type(self).metadata, self.batch.options.step_s)
        if self.batch.options.controller == "rig":
            self.batch.close()
            hint = 'for controller rig use gymnasium.make_vec(..., vectorization_mode="async")'
            raise ConfigError.at(self.batch.name, "one process flies without autopilots", hint)
        self.single_action_space = self.batch.action_space
        self.single_observation_space = self.batch.task.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        shape = self.single_action_space.shape
        assert shape is not None
        self._shape: tuple[int, ...] = shape
        self._names = [f"{self.batch.name} of environment {row}" for row in range(num_envs)]
        self._random = [np_random()[0] for _ in range(num_envs)]
        self._ended: NDArray[np.bool_] | None = None  # None: never reset

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of all environments, or of those with True in `options["reset_mask"]`."""
        seeds: Sequence[int | None]
        if seed is None:
            seeds = [None] * self.num_envs
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + row for row in range(self.num_envs)]
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise ValueError(f"{self.batch.name}: {len(seeds)} seeds for {self.num_envs} environments")
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(
                f"{self.batch.name}: reset_mask needs true or false for each of {self.num_envs} environments"
            )
        if self._ended is None:
            mask = np.ones(self.num_envs, np.bool_)  # none has begun yet
        begun = np.flatnonzero(mask).tolist()
        for row in begun:
            if seeds[row] is not None:
                self._random[row], _ = np_random(seeds[row])
            self.batch.reset(row, self._random[row], options)
        if self._ended is None:
            self._ended = np.zeros(self.num_envs, np.bool_)
        self._ended[mask] = False
        return self.batch.task.observe(), self._infos(begun)

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Fly an action of each environment. Raises ValueError for a wrong action."""
        if self._ended is None:
            raise RuntimeError(f"{self.batch.name}: call reset() before step()")
        values = self._checked(actions)
        flies = ~self._ended
        begun = np.flatnonzero(self._ended).tolist()
        for row in begun:
            self.batch.reset(row, self._random[row])
        observations, rewards, ends, late = self.batch.step(values, flies)
        rewards[~flies] = 0.0
        ends, late = ends & flies, late & flies
        self._ended = ends | late
        return observations, rewards, ends, late, self._infos(begun)

    def _infos(self, begun: Sequence[int]) -> dict[str, Any]:
        """Return the values of every environment, and what was drawn for those that have begun an episode."""
        infos: dict[str, Any] = {}
        for name, values in self.batch.infos().items():
            infos[name], infos[f"_{name}"] = values, np.ones(self.num_envs, np.bool_)
        if self.batch.options.randomize is not None:
            for row in begun:
                infos = self._add_info(infos, {"randomized": self.batch.flights[row].draw._asdict()}, row)
        return infos

    def _checked(self, actions: Any) -> NDArray[np.float64]:
        """Return the actions in an array of their own, clipped to -1..1."""
        if isinstance(actions, np.ndarray) and actions.shape == self.action_space.shape and actions.dtype.kind == "f":
            values = actions.astype(np.float64)
            if (np.abs(values) <= 1.0).all():
                return values
        count = len(actions) if np.ndim(actions) else 0
        if count != self.num_envs:
            raise ValueError(f"{self.batch.name}: {count} actions for {self.num_envs} environments")
        return np.array([checked(action, self._shape, name) for action, name in zip(actions, self._names, strict=True)])

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each environment in the mode rgb_array. Raises RuntimeError before the first reset."""
        if self.render_mode is None:
            return None
        if self._ended is None:
            raise RuntimeError(f"{self.batch.name}: call reset() before render()")
        return tuple(self.batch.picture(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002 (the interface of VectorEnv)
        """Complete recordings and release renderers."""
        self.batch.close()
