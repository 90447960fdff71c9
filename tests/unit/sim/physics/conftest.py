"""The scene of most tests of physics."""

from __future__ import annotations

import pytest

from sim.scene.scene import Scene, load_scene


@pytest.fixture(scope="session")
def airfield() -> Scene:
    return load_scene("airfield")
