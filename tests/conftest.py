"""Settings for every test."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest
from hypothesis import settings

# No example fails because the machine is busy.
settings.register_profile("bench", deadline=None)
settings.load_profile("bench")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without the garbage collector: searching thousands of new tests takes longer than finding them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
