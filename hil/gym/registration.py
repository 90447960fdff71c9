"""Registration of the environments with gymnasium."""

from __future__ import annotations

import gymnasium

from hil.gym.batch import TASKS, environment_id

IDS = tuple(environment_id(task) for task in TASKS)


def register_all() -> None:
    """Register every id that is not registered yet. Episodes end by the environments' own option `episode_s`."""
    for name, task in zip(IDS, TASKS, strict=True):
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="hil.gym.env:FlightEnv",
                vector_entry_point="hil.gym.vector_env:FlightVectorEnv",
                kwargs={"task": task},
            )
