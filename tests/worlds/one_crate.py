"""A glTF file of one crate, and the error of a map that cannot be loaded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from signals.errors import ConfigError
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.worlds.glb_file import GlbFile, box


def crate(**node: Any) -> GlbFile:
    file = GlbFile()
    vertex, triangle, uv = box((-1, 0, -1), (1, 2, 1))
    file.node("crate", file.mesh("crate", (vertex, triangle, file.material("wood"), uv)), **node)
    return file


def error_of(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_world(load_scene(path))
    return str(caught.value)
