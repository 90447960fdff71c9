"""Flights of Gymnasium environments with fixed actions: all that they return, as bytes."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np


def flat(observation: Any) -> bytes:
    if isinstance(observation, dict):
        return b"".join(observation[name].tobytes() for name in sorted(observation))
    return bytes(observation.tobytes())


def rollout(env: Any, seed: int, steps: int = 60) -> str:
    """Return a hash of everything that an environment returns for a seed and random actions."""
    digest = hashlib.sha256()
    random = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    digest.update(flat(observation))
    for _ in range(steps):
        action = random.uniform(-0.3, 0.3, env.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        digest.update(flat(observation) + np.float64(reward).tobytes() + bytes([terminated, truncated]))
        if terminated or truncated:
            observation, _ = env.reset()
            digest.update(flat(observation))
    return digest.hexdigest()


def go_on(env: Any, steps: int) -> bytes:
    """Return what an environment returns for fixed actions, and for a reset after them."""
    random, out = np.random.default_rng(5), b""
    for _ in range(steps):
        action = random.uniform(-0.3, 0.3, env.action_space.shape).astype(np.float32)
        observation, reward, *_ = env.step(action)
        out += flat(observation) + np.float64(reward).tobytes()
    return out + flat(env.reset()[0])
