"""Settings for every test."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

# Whatever the shell says: compiling each test anew is two thirds of collecting them, and each of the hundreds of
# processes that they start would compile every module that it imports.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# No example fails because the machine is busy.
settings.register_profile("bench", deadline=None)
settings.load_profile("bench")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without the garbage collector, and leave what then stays to the end, modules and tests, out of it."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        atexit.register(gc.unfreeze)  # the interpreter's end collects them
        gc.enable()
