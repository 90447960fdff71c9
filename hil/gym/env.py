"""The single environment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium

from hil.config import Bench
from hil.gym.actions import checked
from hil.gym.batch import Batch


class FlightEnv(gymnasium.Env[Any, Any]):
    """One vehicle of a bench, with one of the tasks of `hil.gym.tasks`.

    Options of the task are keywords of `gymnasium.make` (docs/gym.md). Raises ConfigError for wrong ones.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (gymnasium's declaration)

    def __init__(
        self,
        task: str,
        bench: Bench | Path | str | None = None,
        settings: Sequence[str] = (),
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """`bench`: a bench file or a loaded bench. `settings`: texts as for --set, such as "tick_hz=500".

        `render_mode` has no effect; make_vec_env of stable-baselines3 gives one.
        """
        self.render_mode = render_mode
        self.batch = Batch(task, 1, bench, settings, options)
        self.action_space = self.batch.action_space
        self.observation_space = self.batch.task.observation_space
        shape = self.action_space.shape
        assert shape is not None
        self._shape: tuple[int, ...] = shape
        self._name = self.batch.name
        self._runs = False
        self._is_array = not isinstance(self.observation_space, gymnasium.spaces.Dict)

    @property
    def bench(self) -> Bench:
        """The bench, in the present map."""
        return self.batch.flights[0].bench

    @property
    def truth(self) -> Any:
        """True state of the vehicle (signals.samples.TruthState)."""
        return self.batch.flights[0].truth

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode. The same seed gives the same bits; without one the random numbers go on."""
        self._runs = False
        super().reset(seed=seed)
        self.batch.reset(0, self.np_random, options)
        self._runs = True
        return self._one(self.batch.task.observe()), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly an action for a step. Raises ValueError for a wrong action, RuntimeError before the first reset."""
        if not self._runs:
            raise RuntimeError(f"{self._name}: call reset() before step(), and after the end of an episode")
        observation, rewards, ends, late = self.batch.step((checked(action, self._shape, self._name),))
        end, truncated = bool(ends[0]), bool(late[0])
        info = self.batch.task.info(0, over=True) if end or truncated else {}
        return self._one(observation), float(rewards[0]), end, truncated, info

    def _one(self, observation: Any) -> Any:
        if self._is_array:
            return observation[0]
        return {name: value[0] for name, value in observation.items()}

    def close(self) -> None:
        """End the autopilot and release renderers."""
        self.batch.close()
