"""The mock in its world."""

import pytest

from tests.worlds.mock_pixhawk_world import World


@pytest.fixture
def world() -> World:
    world = World()
    world.run(0.2)
    return world
