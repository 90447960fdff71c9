"""Train `hil/Hover-v0` with the PPO of stable-baselines3, and draw its learning curve.

    pip install 'hil-bench[rl]'
    python docs/examples/gym/train_hover.py --out out/hover       # trains, then flies 100 episodes
    python docs/examples/gym/train_hover.py --out out/hover --fly # flies the policy that was trained
    python docs/examples/gym/train_hover.py --out out/hover --film # films three of its episodes in a park (moviepy)

An action is body rates and thrust at 50 Hz. An episode is a success (`is_success` of the environment) if the vehicle
flies to its end and stays near the target for its last 2 s. The seeds of the episodes flown are not those of the
training, and the policy acts without noise. The program exits with 1 if fewer than 95 % of the episodes are successes.
The same machine and versions give the same policy.

Files in --out: policy.zip, curve.csv (steps, processor and wall time, success rate, error), curve.png; with --film
hover-episode-N.mp4.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import RecordVideo
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

import hil.gym  # noqa: F401 (registers the environments)

TASK = "hil/Hover-v0"
ENVIRONMENTS = 16
STEPS = 250_000
LEAST_SUCCESS = 0.95
FLOWN_SEED = 1_000_000
LOOK_EVERY, LOOK_EPISODES = 25_000, 20


def make_policy(seed: int) -> PPO:
    """Return an untrained policy with the settings of the training."""
    env = make_vec_env(TASK, n_envs=ENVIRONMENTS, seed=seed, env_kwargs={"render_mode": None})
    return PPO(
        "MlpPolicy",
        env,
        learning_rate=lambda left: 1e-3 * left,
        n_steps=256,
        batch_size=512,
        n_epochs=6,
        gamma=0.98,
        gae_lambda=0.95,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0},
        seed=seed,
        device="cpu",
    )


def fly(policy: PPO, episodes: int) -> tuple[float, float]:
    """Fly all episodes at once, without noise; return the share of successes and the median distance at the end [m]."""
    env = gymnasium.make_vec(TASK, num_envs=episodes, vectorization_mode="vector_entry_point")
    observations, _ = env.reset(seed=FLOWN_SEED)
    successes, distances_m = np.full(episodes, np.nan), np.full(episodes, np.nan)
    while np.isnan(successes).any():
        actions, _ = policy.predict(observations, deterministic=True)
        observations, _, ends, late, infos = env.step(actions)
        first = (ends | late) & np.isnan(successes)
        if first.any():
            successes[first] = infos["is_success"][first]
            distances_m[first] = infos["distance_m"][first]
    env.close()
    return float(successes.mean()), float(np.median(distances_m))


def film(policy: PPO, out: Path) -> None:
    """Film three episodes above a park."""
    env: Any = gymnasium.make(TASK, render_mode="rgb_array", settings=["scene=city_park"], render_size=(960, 540))
    env = RecordVideo(env, str(out), episode_trigger=lambda _: True, name_prefix="hover")
    for episode in range(3):
        observation, _ = env.reset(seed=FLOWN_SEED + episode)
        over = False
        while not over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
    env.close()


class Look(BaseCallback):
    """Flies some episodes from time to time and writes the learning curve. Their time is not counted."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.rows: list[dict[str, float]] = []
        self._path = path
        self._next = 0
        self._cpu_s = self._wall_s = 0.0
        self._cpu_began_s = self._wall_began_s = 0.0

    def _on_training_start(self) -> None:
        self._cpu_began_s, self._wall_began_s = time.process_time(), time.perf_counter()

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next += LOOK_EVERY
            self.look()

    def _on_training_end(self) -> None:
        self.look()

    def _on_step(self) -> bool:
        return True

    def look(self) -> None:
        """Fly, and add a row to the curve."""
        self._cpu_s += time.process_time() - self._cpu_began_s
        self._wall_s += time.perf_counter() - self._wall_began_s
        success, distance_m = fly(self.model, LOOK_EPISODES)
        row = {"steps": self.num_timesteps, "cpu_s": self._cpu_s, "wall_s": self._wall_s}
        row |= {"success": success, "distance_m": distance_m}
        self.rows.append(row)
        print(", ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
        with self._path.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
            writer.writerows(self.rows)
        self._on_training_start()


def draw(rows: list[dict[str, float]], path: Path) -> None:
    """Draw success rate and distance against processor time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    ax = figure.subplots()
    cpu_s = [row["cpu_s"] for row in rows]
    ax.plot(cpu_s, [100.0 * row["success"] for row in rows], "o-", color="#1f6fb2", markersize=4)
    ax.set(xlabel="processor time of the training [s]", ylim=(-3, 103))
    ax.set_ylabel("successes [%]", color="#1f6fb2")
    ax.grid(True, color="#e6e9ed")
    right = ax.twinx()
    right.plot(cpu_s, [row["distance_m"] for row in rows], "s--", color="#c8553b", markersize=3)
    right.set_yscale("log")
    right.set_ylabel("median distance at the end [m]", color="#c8553b")
    steps = rows[-1]["steps"]
    ax.set_title(f"{TASK}: PPO, {steps / 1000:.0f} thousand steps", loc="left", fontsize=10)
    figure.savefig(path, dpi=110)


def main() -> int:
    """Train and fly, or only fly. Return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/hover"))
    parser.add_argument("--fly", action="store_true", help="fly the policy in --out, without training")
    parser.add_argument("--film", action="store_true", help="film three episodes of the policy in --out")
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--episodes", type=int, default=100)
    options: Any = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it saves
    if options.film:
        film(PPO.load(options.out / "policy.zip", device="cpu"), options.out)
        return 0
    if options.fly:
        policy = PPO.load(options.out / "policy.zip", device="cpu")
    else:
        policy = make_policy(options.seed)
        look = Look(options.out / "curve.csv")
        policy.learn(options.steps, callback=look)
        policy.save(options.out / "policy.zip")
        draw(look.rows, options.out / "curve.png")
    success, distance_m = fly(policy, options.episodes)
    print(
        f"{options.episodes} episodes: {100 * success:.0f} % successes, median distance at the end {distance_m:.3f} m"
    )
    return 0 if success >= LEAST_SUCCESS else 1


if __name__ == "__main__":
    sys.exit(main())
