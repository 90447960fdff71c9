"""Registration of the environments with gymnasium."""

from __future__ import annotations

import gymnasium

TASKS = {"hil/Hover-v0": "hover", "hil/Waypoints-v0": "waypoints", "hil/Explore-v0": "explore", "hil/Bench-v0": "bench"}
IDS = tuple(TASKS)


def register_all() -> None:
    """Register every id that is not registered yet. Episodes end by the environments' own option `episode_s`."""
    for name, task in TASKS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="hil.gym.env:FlightEnv",
                vector_entry_point="hil.gym.vector_env:FlightVectorEnv",
                kwargs={"task": task},
            )
