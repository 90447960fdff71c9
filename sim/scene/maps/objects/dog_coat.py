"""Coats of dogs, and where the parts of the mesh lie in their texture."""

from __future__ import annotations

COATS = ("golden", "black", "brown")
EARS_UP = frozenset({"brown"})  # coats of dogs whose ears stand up
# Range of v, the share of the texture's height from below, that each part takes from its first ring to its last.
RANGES: dict[str, tuple[float, float]] = {
    "trunk": (0.02, 0.38), "neck": (0.40, 0.48), "head": (0.50, 0.66), "ear": (0.68, 0.74), "leg": (0.76, 0.88),
    "paw": (0.88, 0.90), "tail": (0.92, 0.99),
}  # fmt: skip
