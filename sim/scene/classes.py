"""Object classes of segmentation, with the colour in which each is shown.

The class id is the position in the table. Labels of recorded data sets hold these ids, so new entries go to the end of
the table only. Classes that a scene declares itself follow after the table.
"""

from __future__ import annotations

MAX_CLASSES = 256  # a class id is one byte

CLASS_COLOURS: dict[str, tuple[int, int, int]] = {
    "none": (0, 0, 0),  # nothing: the sky
    "ground": (129, 118, 96),
    "path": (214, 196, 148),
    "road": (96, 96, 104),
    "grass": (124, 186, 80),
    "water": (64, 124, 214),
    "building": (180, 86, 70),
    "wall": (150, 120, 120),
    "tree": (36, 120, 52),
    "vegetation": (96, 156, 40),
    "person": (230, 40, 80),
    "vehicle": (30, 60, 190),
    "drone": (250, 240, 40),
    "furniture": (172, 110, 40),
    "fence": (190, 150, 160),
    "pole": (160, 164, 170),
    "sign": (246, 196, 0),
    "reflector": (0, 230, 230),
    "drop_zone": (255, 128, 0),
    "object": (140, 80, 200),
    "roof": (120, 50, 40),
    "window": (130, 190, 220),
    "door": (110, 70, 30),
    "sidewalk": (190, 190, 182),
    "terrain": (150, 140, 80),
    "obstacle": (220, 90, 30),
    "pavement": (176, 168, 156),
    "hedge": (60, 140, 70),
    "bush": (84, 150, 84),
    "playground": (240, 150, 90),
    "hill": (140, 170, 80),
    "bin": (70, 90, 80),
    "lamp": (250, 220, 140),
    "crossing": (230, 230, 230),
    "marking": (255, 255, 200),
    "lawn": (150, 200, 100),
    "pad": (200, 120, 60),
    "house": (200, 110, 90),
    "tower": (130, 90, 110),
    "hall": (160, 100, 140),
    "container": (40, 130, 160),
    "barrel": (90, 60, 160),
    "crate": (180, 140, 80),
    "sandbags": (196, 180, 120),
    "barrier": (220, 120, 140),
    "stand": (110, 110, 140),
    "bench": (150, 90, 50),
    "gate": (120, 120, 90),
    "bicycle": (20, 170, 200),
    "motorcycle": (20, 120, 120),
    "traffic_light": (255, 200, 60),
    "stop_sign": (200, 20, 20),
    "bird": (200, 230, 255),
    "dog": (150, 100, 20),
    "backpack": (90, 20, 140),
    "umbrella": (255, 110, 180),
    "potted_plant": (40, 200, 100),
    "windsock": (255, 96, 0),
    "runway": (70, 70, 84),
}

# On which people stand and walk.
GROUND_CLASSES = frozenset(
    {
        "ground", "path", "road", "grass", "terrain", "sidewalk", "pavement", "crossing", "marking", "lawn", "pad",
        "hill",
    }
)  # fmt: skip

# Colours for a scene's own classes, in turn; easy to tell from each other.
_EXTRA_COLOURS = (
    (255, 0, 255),
    (0, 255, 128),
    (128, 0, 255),
    (255, 160, 200),
    (0, 128, 128),
    (200, 255, 0),
    (90, 90, 255),
)


def class_table(new_classes: tuple[str, ...] = ()) -> dict[str, tuple[int, int, int]]:
    """Return the colour of every class by name, in the order of class ids."""
    further = {name: _EXTRA_COLOURS[i % len(_EXTRA_COLOURS)] for i, name in enumerate(new_classes)}
    return CLASS_COLOURS | further
