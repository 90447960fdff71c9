"""How benchmarks take times: on one core, the methods in turn, the best of several turns."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from hil.signals.errors import HilError

_REFERENCES = Path(__file__).resolve().parents[2] / "tests" / "reference"


@contextmanager
def one_core() -> Iterator[None]:
    """Within it, this thread and all that it starts stay on one core."""
    if not hasattr(os, "sched_setaffinity"):
        yield  # not Linux
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def best_times(
    works: Mapping[str, Callable[[], object]],
    *,
    turns: int = 1,
    once_s: float = float("inf"),
    before: Callable[[str], None] = lambda _name: None,
) -> dict[str, float]:
    """Seconds of each work, the best of some turns; what took longer than `once_s` has only one.

    Other processes disturb for a while, so the works take turns. `before` prepares each one's turn and is not timed.
    """
    best: dict[str, float] = {}
    for _ in range(turns):
        for name, work in works.items():
            if best.get(name, 0.0) > once_s:
                continue
            before(name)
            began = time.perf_counter()
            work()
            took = time.perf_counter() - began
            best[name] = min(took, best.get(name, took))
    return best


def load_reference(name: str) -> ModuleType:
    """A module of tests/reference. HilError where the installation has no tests."""
    path = _REFERENCES / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise HilError(f"{path} is missing: this benchmark runs from a checkout, not from a wheel")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look their module up
    spec.loader.exec_module(module)
    return module
