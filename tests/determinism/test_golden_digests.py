"""Every flight of tests/golden/digests.yaml gives the digest that stands there.

The default flight is compared in tests/e2e/test_rectangle.py, which flies it anyway.
"""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import pytest

from hil.gym import IDS
from tests.golden.digests import EPISODES, FLIGHTS
from tests.worlds.bench_process import hil
from tests.worlds.gym_rollouts import rollout


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FLIGHTS if name != "default"])
def test_digest(name: str, tmp_path: Path) -> None:
    flight = FLIGHTS[name]
    done = hil("run", *flight["arguments"], "--set", "record.report=false", "--out", str(tmp_path / "out"), timeout=600)
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["status"] == flight["verdict"], done.stdout + done.stderr
    assert run["digest"] == flight["digest"]


@pytest.mark.parametrize("name", EPISODES)
def test_digest_of_an_episode(name: str) -> None:
    episode = EPISODES[name]
    assert episode["environment"] in IDS
    env = gymnasium.make(episode["environment"], **episode["options"])
    assert rollout(env, seed=1) == episode["digest"]


def test_a_digest_has_a_reason() -> None:
    assert all(each["changed"] and len(each["digest"]) == 64 for each in (FLIGHTS | EPISODES).values())
