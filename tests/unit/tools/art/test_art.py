"""Files of sim/scene/assets: made again byte for byte, nothing more and nothing less, small, and not slow to read."""

from __future__ import annotations

import pytest

from sim.scene.maps.asset_files import ASSETS
from tools.art.catalog import FILES
from tools.art.png import contents

SAMPLE = (
    "textures/manhole.png", "textures/plate_1.png", "textures/leaves_birch_autumn.png", "textures/cloth_denim.png",
    "textures/facade_brick_shops.png", "models/vehicles/suv_b_driver.glb", "models/vehicles/hatchback_driven.glb",
    "models/vehicles/bicycle_ridden.glb", "models/people/child.glb", "models/people/wheelchair.glb",
    "models/plants/tall_0_drooping_1.glb", "models/plants/pine_2.glb", "models/objects/bird_crow.glb",
)  # fmt: skip


def is_same(name: str) -> bool:
    made, shipped = FILES[name](), (ASSETS / name).read_bytes()
    # Versions of zlib compress the same rows to other bytes.
    return made == shipped or (name.endswith(".png") and contents(made) == contents(shipped))


@pytest.mark.parametrize("name", SAMPLE)
def test_files_are_made_again_as_they_are_shipped(name: str) -> None:
    assert is_same(name)


@pytest.mark.slow
def test_all_files_are_made_again_as_they_are_shipped() -> None:
    assert [name for name in FILES if not is_same(name)] == []


def test_the_folder_holds_what_is_made_and_nothing_else() -> None:
    files = {path.relative_to(ASSETS).as_posix(): path for path in ASSETS.rglob("*") if path.is_file()}
    shipped = {name: path for name, path in files.items() if ".own." not in name}
    assert shipped.keys() == FILES.keys()
    assert sum(path.stat().st_size for path in shipped.values()) < 40e6
