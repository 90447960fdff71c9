"""A data set is the same tree on Ray clusters and after kills of the command, of a worker and of a node."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.ray_cluster import WAIT_S, processes, raylet_of, require_ray, two_nodes, until
from tests.worlds.small_dataset import BENCH, stored_batches, tree_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

FRAMES = 83  # 8 whole batches and a part
MOMENTS = (0, 1, 4)  # batches stored when something is killed


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dataset") / "tiny.yaml"
    path.write_text(BENCH)
    return path


@pytest.fixture(scope="module")
def tree(bench: Path) -> dict[str, Any]:
    """The tree of one local worker."""
    end(begin(bench, bench.parent / "one", "--workers", "1"))
    return tree_of(bench.parent / "one")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster of two nodes on this machine."""
    with two_nodes() as made:
        yield made


def begin(bench: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", "hil.cli", "dataset", str(bench), "--frames", str(FRAMES), "--out", str(out), "-q"]
    return subprocess.Popen(
        [*line, *more], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=bench.parent
    )


def end(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, said
    return said


def on(cluster: Any) -> tuple[str, ...]:
    return "--engine", "ray", "--address", cluster.address


def test_two_local_workers(bench: Path, tree: dict[str, Any], tmp_path: Path) -> None:
    end(begin(bench, tmp_path / "set", "--workers", "2"))
    assert tree_of(tmp_path / "set") == tree


def test_ray_on_this_machine(bench: Path, tree: dict[str, Any], tmp_path: Path) -> None:
    require_ray()
    end(begin(bench, tmp_path / "set", "--engine", "ray", "--workers", "2"))
    assert tree_of(tmp_path / "set") == tree


def test_a_cluster_of_two_nodes(bench: Path, tree: dict[str, Any], tmp_path: Path, cluster: Any) -> None:
    process = begin(bench, tmp_path / "set", *on(cluster))
    workers: set[int] = set()
    while process.poll() is None:
        workers |= set(processes("ray::make_batch", os.getpid()))
        time.sleep(0.02)
    end(process)
    assert tree_of(tmp_path / "set") == tree
    assert len(workers) == 2, "a worker on each node"


@pytest.mark.parametrize("moment", MOMENTS)
def test_the_command_is_killed(bench: Path, tree: dict[str, Any], tmp_path: Path, cluster: Any, moment: int) -> None:
    out = tmp_path / "set"
    process = begin(bench, out, *on(cluster))
    until(process, lambda: stored_batches(out) >= moment)
    process.kill()
    process.communicate()
    before = stored_batches(out)
    said = end(begin(bench, out, *on(cluster), "--resume"))
    assert tree_of(out) == tree
    assert (f"{before} batches of an earlier attempt were kept" in said) == (before > 0), said


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_worker_is_killed(bench: Path, tree: dict[str, Any], tmp_path: Path, cluster: Any, moment: int) -> None:
    out = tmp_path / "set"
    process = begin(bench, out, *on(cluster))
    until(process, lambda: stored_batches(out) >= moment)
    os.kill(until(process, lambda: processes("ray::make_batch", os.getpid()))[0], signal.SIGKILL)
    end(process)
    assert tree_of(out) == tree


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_node_is_killed(bench: Path, tree: dict[str, Any], tmp_path: Path, cluster: Any, moment: int) -> None:
    node = cluster.add_node(num_cpus=1)
    out = tmp_path / "set"
    process = begin(bench, out, *on(cluster))
    until(process, lambda: stored_batches(out) >= moment)
    os.kill(raylet_of(node), signal.SIGKILL)
    end(process)
    assert tree_of(out) == tree
    cluster.remove_node(node, allow_graceful=False)


def test_the_head_of_a_cluster_is_killed(bench: Path, tree: dict[str, Any], tmp_path: Path) -> None:
    require_ray()
    from ray.cluster_utils import Cluster

    out = tmp_path / "set"
    lost = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    process = begin(bench, out, *on(lost), "--frames", "2000")
    until(process, lambda: stored_batches(out) >= 1)
    os.kill(lost.head_node.all_processes["gcs_server"][0].process.pid, signal.SIGKILL)
    said, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 3, said
    assert "the Ray cluster is lost (its head at" in said
    lost.shutdown()
    end(begin(bench, out, "--frames", "2010", "--resume"))
