"""Files of sim/scene/assets, which tools/art makes: models as GLB, textures as PNG.

A file NAME.own.glb or NAME.own.png beside NAME.glb or NAME.png is used instead of it.
"""

from __future__ import annotations

from pathlib import Path

ASSETS = Path(__file__).resolve().parents[1] / "assets"


def asset_file(name: str) -> tuple[Path, bool]:
    """Return the path of an asset, and True if it is the user's own; `name`: relative to ASSETS, with its suffix."""
    shipped = ASSETS / name
    own = shipped.with_suffix(f".own{shipped.suffix}")
    return (own, True) if own.exists() else (shipped, False)
