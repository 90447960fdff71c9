"""The single environment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium

from hil.config import Bench
from hil.gym.actions import checked
from hil.gym.batch import Batch
from hil.gym.pictures import RENDER_MODES, Window, check_mode, rendering


class FlightEnv(gymnasium.Env[Any, Any]):
    """One vehicle of a bench, with one of the tasks of `hil.gym.tasks`.

    Options of the task are keywords of `gymnasium.make` (docs/gym.md). Raises ConfigError for wrong ones.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 50}  # noqa: RUF012 (gymnasium's)

    def __init__(
        self,
        task: str,
        bench: Bench | Path | str | None = None,
        settings: Sequence[str] = (),
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """`bench`: a bench file or a loaded bench. `settings`: texts as for --set, such as "tick_hz=500".

        `render_mode`: rgb_array, human (a window), or None. The first picture compiles the scene for it.
        """
        self.batch = Batch(task, 1, bench, settings, options)
        self.render_mode = check_mode(render_mode, self.batch.name)
        self.metadata = rendering(type(self).metadata, self.batch.options.step_s)
        self._window = Window(self.batch.name, self.metadata["render_fps"]) if render_mode == "human" else None
        self.action_space = self.batch.action_space
        self.observation_space = self.batch.task.observation_space
        shape = self.action_space.shape
        assert shape is not None
        self._shape: tuple[int, ...] = shape
        self._name = self.batch.name
        self._runs = self._over = False
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
        self._runs, self._over = True, False
        observation = self._one(self.batch.task.observe())
        self._show()
        return observation, self.batch.first_info(0)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly an action for a step.

        Raises ValueError for a wrong action, RuntimeError before the first reset and after the end of an episode.
        """
        if not self._runs:
            raise RuntimeError(f"{self._name}: call reset() before step(), and after the end of an episode")
        if self._over:
            raise RuntimeError(f"{self._name}: the episode has ended (terminated or truncated): call reset()")
        observation, reward, ends, late = self.batch.step_alone(checked(action, self._shape, self._name))
        self._over = ends or late
        self._show()
        return self._one(observation), reward, ends, late, self.batch.info(0)

    def _one(self, observation: Any) -> Any:
        if self._is_array:
            return observation[0]
        return {name: value[0] for name, value in observation.items()}

    def render(self) -> Any:
        """Return a picture, (height, width, 3) RGB, in the mode rgb_array. Raises RuntimeError before a reset."""
        if self.render_mode != "rgb_array":
            return None
        if not self._runs:
            raise RuntimeError(f"{self._name}: call reset() before render()")
        return self.batch.picture(0)

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self.batch.picture(0))

    def close(self) -> None:
        """End the autopilot, complete recordings, and release renderers."""
        if self._window is not None:
            self._window.close()
        self.batch.close()
