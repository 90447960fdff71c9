"""Timing of benchmarks: on one core, the methods in turn, the best of several turns."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from signals.errors import HilError

_REFERENCES = Path(__file__).resolve().parents[3] / "tests" / "reference"


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and the threads and processes it starts, on one core (Linux only)."""
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
    methods: Mapping[str, Callable[[], object]],
    *,
    turns: int = 1,
    once_s: float = float("inf"),
    before: Callable[[str], None] = lambda _name: None,
) -> dict[str, float]:
    """Return the seconds of each method, the best of `turns`; a method that takes longer than `once_s` runs once.

    Other processes interfere for a while at a time, so the methods take turns. `before` is called with a method's name
    before each of its runs and is not timed.
    """
    best: dict[str, float] = {}
    for _ in range(turns):
        for name, method in methods.items():
            if best.get(name, 0.0) > once_s:
                continue
            before(name)
            began = time.perf_counter()
            method()
            took = time.perf_counter() - began
            best[name] = min(took, best.get(name, took))
    return best


def load_reference(name: str) -> ModuleType:
    """Import a module of tests/reference. Raises HilError if the installation has no tests."""
    path = _REFERENCES / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise HilError(f"{path} is missing: this benchmark runs from a checkout, not from a wheel")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look up their module there
    spec.loader.exec_module(module)
    return module
