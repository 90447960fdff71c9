"""What the class ids of a scene mean: their names, and colours to show them in."""

from __future__ import annotations

from typing import NamedTuple


class Classes(NamedTuple):
    """By class id; id 0 is nothing. Colours may be missing: then whoever draws chooses."""

    names: tuple[str, ...] = ()
    colours: tuple[tuple[int, int, int], ...] = ()  # sRGB, 0 to 255

    def name(self, index: int) -> str:
        """Of a class, also of one that nobody named."""
        return self.names[index] if index < len(self.names) else f"class {index}"
