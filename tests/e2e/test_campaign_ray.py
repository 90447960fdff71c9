"""The table of a campaign is the same bytes on Ray clusters and after kills of the campaign, a worker and a node."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.ray_cluster import (
    ON_LOOPBACK,
    WAIT_S,
    head_with_token,
    processes,
    raylet_of,
    require_ray,
    two_nodes,
    until,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

SPEC = """
settings: {mission: rigs/missions/short.waypoints, autopilot: {transport: loopback}, wind: {steady_W_mps: [0, 0, 0]}}
samples: 9
sampled:
  wind.steady_W_mps.0: {uniform: [-6, 6]}
  duration_s: {choice: [60, 8]}
recheck: 0.3
keep_at_most: 1
"""
MOMENTS = (0, 2, 6)  # cases stored when something is killed


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("campaign") / "c.yaml"
    path.write_text(SPEC)
    return path


@pytest.fixture(scope="module")
def table(spec: Path) -> bytes:
    """The table of one local worker."""
    out = spec.parent / "one"
    assert end(begin(spec, out, "--workers", "1")) == 1
    return (out / "results.csv").read_bytes()


def begin(spec: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", "hil.cli", "campaign", str(spec), "--out", str(out), "--quiet", *more]
    return subprocess.Popen(line, stderr=subprocess.PIPE, text=True, cwd=spec.parent)


def end(process: subprocess.Popen[str]) -> int:
    _, said = process.communicate(timeout=WAIT_S)
    assert said == "" or process.returncode not in (0, 1), said
    return process.returncode


def stored(out: Path) -> int:
    try:
        with sqlite3.connect(f"file:{out / 'campaign.sqlite'}?mode=ro", uri=True) as database:
            return int(database.execute("SELECT count(*) FROM flown").fetchone()[0])
    except sqlite3.Error:
        return -1


def test_two_local_workers(spec: Path, table: bytes, tmp_path: Path) -> None:
    assert end(begin(spec, tmp_path / "out", "--workers", "2")) == 1
    assert (tmp_path / "out" / "results.csv").read_bytes() == table
    assert len(list((tmp_path / "out" / "cases").glob("*/run.mcap"))) == 1


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_local_campaign_is_killed(spec: Path, table: bytes, tmp_path: Path, moment: int) -> None:
    out = tmp_path / "out"
    process = begin(spec, out, "--workers", "2")
    until(process, lambda: stored(out) >= moment)
    process.kill()
    process.communicate()
    before = stored(out)
    assert end(begin(spec, out, "--workers", "2", "--resume")) == 1
    assert (out / "results.csv").read_bytes() == table
    again = json.loads((out / "campaign.json").read_text())["flown"]
    fresh = json.loads((spec.parent / "one" / "campaign.json").read_text())["flown"]
    assert again == fresh - before


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_local_worker_is_killed(spec: Path, table: bytes, tmp_path: Path, moment: int) -> None:
    out = tmp_path / "out"
    process = begin(spec, out, "--workers", "2")
    until(process, lambda: stored(out) >= moment)
    os.kill(until(process, lambda: workers(process.pid))[0], signal.SIGKILL)
    assert end(process) == 1
    assert (out / "results.csv").read_bytes() == table


def workers(pid: int) -> list[int]:
    """Return the processes that fly: those that the server of a campaign has forked."""
    return [child for server in processes("forkserver", pid) for child in processes("", server)]


# -- Ray


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster of two nodes on this machine."""
    with two_nodes() as made:
        yield made


def test_ray_on_this_machine(spec: Path, table: bytes, tmp_path: Path) -> None:
    require_ray()
    out = tmp_path / "out"
    process = begin(spec, out, "--engine", "ray", "--workers", "2")
    assert end(process) == 1
    assert (out / "results.csv").read_bytes() == table
    assert len(list((out / "cases").glob("*/run.mcap"))) == 1, "the recording came back"


def test_a_cluster_of_two_nodes(spec: Path, table: bytes, tmp_path: Path, cluster: Any) -> None:
    out = tmp_path / "out"
    assert end(begin(spec, out, "--engine", "ray", "--address", cluster.address)) == 1
    assert (out / "results.csv").read_bytes() == table
    with sqlite3.connect(out / "campaign.sqlite") as database:
        places = {json.loads(row[0])["place"] for row in database.execute("SELECT outcome FROM flown")}
    assert len(places) == 2, places


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_campaign_on_a_cluster_is_killed(spec: Path, table: bytes, tmp_path: Path, cluster: Any, moment: int) -> None:
    out, line = tmp_path / "out", ("--engine", "ray", "--address", cluster.address)
    process = begin(spec, out, *line)
    until(process, lambda: stored(out) >= moment)
    process.kill()
    process.communicate()
    assert end(begin(spec, out, *line, "--resume")) == 1
    assert (out / "results.csv").read_bytes() == table


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_worker_of_a_cluster_is_killed(spec: Path, table: bytes, tmp_path: Path, cluster: Any, moment: int) -> None:
    out = tmp_path / "out"
    process = begin(spec, out, "--engine", "ray", "--address", cluster.address)
    until(process, lambda: stored(out) >= moment)
    os.kill(until(process, lambda: processes("ray::fly_task", os.getpid()))[0], signal.SIGKILL)
    assert end(process) == 1
    assert (out / "results.csv").read_bytes() == table


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_node_of_a_cluster_is_killed(spec: Path, table: bytes, tmp_path: Path, cluster: Any, moment: int) -> None:
    node = cluster.add_node(num_cpus=1)
    out = tmp_path / "out"
    process = begin(spec, out, "--engine", "ray", "--address", cluster.address)
    until(process, lambda: stored(out) >= moment)
    os.kill(raylet_of(node), signal.SIGKILL)
    assert end(process) == 1
    assert (out / "results.csv").read_bytes() == table
    cluster.remove_node(node, allow_graceful=False)


def test_a_cluster_that_asks_for_its_token(spec: Path, table: bytes, tmp_path: Path) -> None:
    with head_with_token(tmp_path / "h") as address:
        ended = []
        for name in ("h", "elsewhere"):
            line = [sys.executable, "-m", "hil.cli", "campaign", str(spec), "--engine", "ray", "--address", address]
            (tmp_path / name).mkdir(exist_ok=True)
            environment = {key: value for key, value in os.environ.items() if not key.startswith("RAY_AUTH")}
            ended.append(
                subprocess.run(
                    [*line, "--out", str(tmp_path / name / "out")],
                    env=environment | {"HOME": str(tmp_path / name), **ON_LOOPBACK},
                    capture_output=True,
                    text=True,
                    timeout=WAIT_S,
                    cwd=spec.parent,
                )
            )
    inside, outside = ended
    assert inside.returncode == 1, inside.stderr
    assert (tmp_path / "h" / "out" / "results.csv").read_bytes() == table
    assert f"Ray: waiting for the cluster at {address}" in inside.stdout.replace("\n", " ")
    assert outside.returncode == 3
    assert "it asks for its token, and this machine has none" in outside.stderr.replace("\n", " ")


def test_a_cluster_without_the_resources_that_a_case_declares(spec: Path, tmp_path: Path, cluster: Any) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(SPEC + "resources: {px4_board: 1}\n")
    process = begin(path, tmp_path / "out", "--engine", "ray", "--address", cluster.address)
    _, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 2
    assert "no node of the cluster has CPU: 1, px4_board: 1" in said


def test_an_address_where_another_program_listens(spec: Path, tmp_path: Path) -> None:
    require_ray()
    import socket

    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"127.0.0.1:{other.getsockname()[1]}"
        process = begin(spec, tmp_path / "out", "--engine", "ray", "--address", address)
        _, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 3
    assert "error: --engine ray: " in said
    assert address in said
    assert len(said.splitlines()) == 1
