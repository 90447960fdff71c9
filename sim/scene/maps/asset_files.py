"""Files of sim/scene/assets, which tools/art makes: models as GLB, textures as PNG.

A file NAME.own.glb or NAME.own.png beside NAME.glb or NAME.png is used instead of it.
"""

from __future__ import annotations

from pathlib import Path

ASSETS = Path(__file__).resolve().parents[1] / "assets"


def shipped_file(name: str) -> Path:
    return ASSETS / name


def asset_file(name: str) -> tuple[Path, bool]:
    """Return the path of an asset, and True if it is the user's own; `name`: relative to ASSETS, with its suffix."""
    shipped = shipped_file(name)
    own = shipped.with_suffix(f".own{shipped.suffix}")
    return (own, True) if own.exists() else (shipped, False)


def own_files() -> list[str]:
    """Return the user's own files, relative to ASSETS, sorted."""
    return sorted(path.relative_to(ASSETS).as_posix() for path in ASSETS.rglob("*.own.*"))
