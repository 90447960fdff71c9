"""Letters of signs and plates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tools.art.textures import dot_font

ROOT = Path(__file__).resolve().parents[4]


def test_dots_lie_where_they_were_asked_for() -> None:
    image = np.zeros((30, 40, 3), np.uint8)
    dot_font.write(image, "L T", (2, 3), (3, 2), 12, (7, 8, 9))
    drawn = image[:, :, 0] == 7
    assert drawn[2:23, 3:5].all()  # the stem of L
    assert drawn[20:23, 3:13].all()  # its foot
    assert drawn[2:5, 21:31].all()  # the bar of T, after half a character's space
    assert drawn.sum() == 6 * (7 + 4 + 5 + 6)


def test_no_picture_of_the_simulation_has_letters_of_opencv() -> None:
    """Their pixels depend on its version."""
    sources = [path for folder in ("sim", "tools") for path in (ROOT / folder).rglob("*.py")]
    assert len(sources) > 100
    assert [path.name for path in sources if "putText" in path.read_text()] == []
