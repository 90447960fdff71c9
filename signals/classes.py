"""Names and display colours of a scene's object classes."""

from __future__ import annotations

from typing import NamedTuple


class Classes(NamedTuple):
    """Names and colours by class id; id 0 is nothing. If there are no colours, the viewer chooses them."""

    names: tuple[str, ...] = ()
    colours: tuple[tuple[int, int, int], ...] = ()  # sRGB, 0 to 255

    def name(self, index: int) -> str:
        """Return the name of a class; `class N` if it has none."""
        return self.names[index] if index < len(self.names) else f"class {index}"
