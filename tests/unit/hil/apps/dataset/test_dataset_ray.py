"""Batches made on nodes give the tree that workers of this machine make. A stand-in for Ray's tasks serves here;
tests/e2e/test_dataset_ray.py uses real clusters."""

from __future__ import annotations

import errno
import os
import pickle
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hil.apps.dataset.engines import ray_node
from hil.apps.dataset.engines.ray import RayWorkers
from hil.apps.dataset.make import MakeOptions, make_dataset
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage import tree as tree_module
from hil.cli.app import run_command_line
from hil.cluster import trees
from hil.cluster.program import OtherProgram, Program
from hil.cluster.tasks import Ended
from signals.errors import RecordingError
from tests.worlds.small_dataset import inline, tiny_plan, tree_of

FRAMES = 23


class Node:
    """Tasks on one node, made in this process when they are waited for, the last one first."""

    capacity = 3

    def __init__(self, *, lose: Callable[[int], bool] = lambda _: False) -> None:
        """`lose`: by number of the task, which are lost."""
        self._lose, self._waiting = lose, []  # type: ignore[var-annotated]
        self.begun = 0

    @property
    def busy(self) -> int:
        return len(self._waiting)

    def put(self, name: str, content: Callable[[], bytes]) -> bytes:
        return content()

    def submit(self, key: Any, *arguments: Any) -> None:
        self._waiting.append((self.begun, key, pickle.dumps(arguments)))
        self.begun += 1

    def wait(self, timeout_s: float) -> list[Ended]:
        if not self._waiting or (timeout_s == 0.0 and self.busy < self.capacity):
            return []
        number, key, arguments = self._waiting.pop()
        if self._lose(number):
            return [Ended(key, None, "the node died")]
        reply = ray_node.make_batch(*pickle.loads(arguments))
        return [Ended(key, pickle.loads(pickle.dumps(reply)))]

    def close(self) -> None:
        self._waiting = []


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> DatasetPlan:
    return tiny_plan(tmp_path_factory.mktemp("bench"), frames=FRAMES)


@pytest.fixture(scope="module")
def whole(plan: DatasetPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole") / "set"
    make_dataset(plan, root, inline())
    return root


@pytest.fixture(autouse=True)
def _node_without_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(trees, "_content", lambda reference: reference)
    monkeypatch.setattr(ray_node, "this_node", lambda: "node a (here)")
    monkeypatch.setattr(ray_node, "_maker", None)


def on(node: Node, plan: DatasetPlan, **more: Any) -> MakeOptions:
    return MakeOptions(quiet=True, make_workers=lambda _, factory: RayWorkers(node, plan, factory), **more)  # type: ignore[arg-type]


def test_a_node_makes_the_same_tree(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    make_dataset(plan, tmp_path / "set", on(Node(), plan))
    assert tree_of(tmp_path / "set") == tree_of(whole)


def test_lost_batches_are_made_again(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    node = Node(lose=lambda number: number in (0, 2, 3))
    make_dataset(plan, tmp_path / "set", on(node, plan))
    assert node.begun == 3 + 3
    assert tree_of(tmp_path / "set") == tree_of(whole)


@pytest.mark.slow
def test_a_batch_that_is_always_lost_ends_the_data_set_and_can_be_resumed(
    plan: DatasetPlan, whole: Path, tmp_path: Path
) -> None:
    node = Node(lose=lambda number: number > 0)
    with pytest.raises(RecordingError, match=r"batch \d was lost 3 times, at last: the node died.*--resume"):
        make_dataset(plan, tmp_path / "set", on(node, plan))
    node = Node()
    kept = make_dataset(plan, tmp_path / "set", on(node, plan, resume=True)).kept_batches
    assert node.begun == 3 - kept
    assert tree_of(tmp_path / "set") == tree_of(whole)


def test_a_node_continues_what_local_workers_began(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    make_dataset(replace(plan, frames=12), tmp_path / "set", inline())
    node = Node()
    assert make_dataset(plan, tmp_path / "set", on(node, plan, resume=True)).kept_batches == 1
    assert node.begun == 2
    assert tree_of(tmp_path / "set") == tree_of(whole)


def test_a_full_disk_of_a_node_is_reported(plan: DatasetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(archive: bytes, folder: Path) -> None:
        (folder / "half").write_bytes(b"of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(trees, "unpack", full)
    with pytest.raises(RecordingError, match=r"unpacked here \(No space left on device\) \(on node a \(here\)\)"):
        make_dataset(plan, tmp_path / "set", on(Node(), plan))
    assert not list((tmp_path / f"hil-{os.getuid()}" / "trees").iterdir())


@pytest.mark.slow
def test_a_full_disk_of_this_machine_is_reported(
    plan: DatasetPlan, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = 0

    def full(path: str, mode: str, **more: Any) -> Any:
        nonlocal opened
        opened += 1
        if opened < 180:
            return open(path, mode, **more)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(tree_module, "open", full, raising=False)
        with pytest.raises(RecordingError, match=r"No space left on device.*--resume"):
            make_dataset(plan, tmp_path / "set", on(Node(), plan))
    make_dataset(plan, tmp_path / "set", on(Node(), plan, resume=True))
    assert tree_of(tmp_path / "set") == tree_of(whole)


def test_a_node_with_another_program_refuses() -> None:
    with pytest.raises(OtherProgram, match="another version of hil-bench"):
        Program("0" * 32).require()
    here = Program.here(libraries=("isal",))
    here.require()
    with pytest.raises(OtherProgram, match=r"isal [0-9.]+, not 0\.1"):
        replace(here, libraries={"isal": "0.1"}).require()


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--engine", "slurm"], 2, "--engine: is unknown: 'slurm'"),
        (["--address", "127.0.0.1:6379"], 2, "--address: belongs to --engine ray"),
        (["--engine", "ray"], 2, 'needs Ray, which is not installed (pip install "hil-bench[ray]"'),
    ],
)
def test_refusals_are_one_line_before_anything_is_written(
    arguments: list[str],
    status: int,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert run_command_line(["dataset", *arguments, "--out", str(tmp_path / "set")]) == status
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("address", "status", "message"),
    [
        ("head", 2, "--address: is not HOST:PORT: 'head'"),
        ("127.0.0.1:9", 3, "no Ray cluster answers at 127.0.0.1:9"),
    ],
)
def test_addresses_without_a_cluster_are_refused(
    address: str, status: int, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("ray", reason='needs Ray: pip install "hil-bench[ray]"')
    out = tmp_path / "set"
    assert run_command_line(["dataset", "--engine", "ray", "--address", address, "--out", str(out)]) == status
    assert message in capsys.readouterr().err
    assert not out.exists()
