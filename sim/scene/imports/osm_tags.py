"""Meaning of OpenStreetMap tags: heights, roofs, widths, surfaces and classes.

Keys and values are those of the OpenStreetMap wiki ("Simple 3D Buildings", "Key:highway", "Key:barrier"). Widths and
heights of objects that do not state them are usual values of European towns.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from sim.scene.imports.osm_file import Tags

LEVEL_M = 3.0
BRIDGE_M = 4.5  # under a building that bridges a street
_NUMBER = re.compile(r"^\s*(-?\d+(?:[.,]\d+)?)\s*(m|metres?|meters?|ft|')?\s*(?:(\d+(?:\.\d+)?)\s*(?:\"|in|''))?\s*$")
_MAX_HEIGHT_M = 900.0

HOUSES = frozenset(
    [
        "house",
        "detached",
        "semidetached_house",
        "terrace",
        "bungalow",
        "cabin",
        "farm",
        "residential_house",
        "villa",
        "static_caravan",
    ]
)
_LEVELS = {
    "apartments": 4, "residential": 3, "office": 4, "commercial": 3, "hotel": 5, "hospital": 4, "school": 3,
    "university": 4, "public": 3, "civic": 3, "government": 4, "dormitory": 4, "retail": 2, "train_station": 3,
    "house": 2, "detached": 2, "semidetached_house": 2, "terrace": 2, "villa": 2, "farm": 2, "bungalow": 1, "cabin": 1,
}  # fmt: skip
_HEIGHTS_M = {
    "garage": 2.6, "garages": 2.6, "carport": 2.5, "shed": 2.4, "hut": 2.4, "kiosk": 2.8, "toilets": 2.8, "roof": 4.0,
    "greenhouse": 3.0, "barn": 6.0, "stable": 4.0, "sty": 3.0, "farm_auxiliary": 5.0, "industrial": 8.0,
    "warehouse": 8.0, "hangar": 9.0, "supermarket": 6.0, "church": 14.0, "cathedral": 25.0, "chapel": 7.0,
    "mosque": 12.0, "temple": 10.0, "synagogue": 10.0, "service": 3.0, "transformer_tower": 6.0, "bunker": 3.0,
    "construction": 6.0, "ruins": 3.0, "stadium": 15.0, "parking": 9.0, "silo": 12.0, "water_tower": 25.0,
    "tower": 25.0,
}  # fmt: skip
_HOUSE_AREA_M2 = 180.0  # a building of no stated type below this is taken for a house

ROOFS = frozenset(
    [
        "flat",
        "gabled",
        "hipped",
        "pyramidal",
        "skillion",
        "half-hipped",
        "gambrel",
        "mansard",
        "round",
        "dome",
        "onion",
        "cone",
    ]
)
_NEAREST_ROOF = {
    "saltbox": "gabled", "double_saltbox": "gabled", "quadruple_saltbox": "gabled", "cross_gable": "gabled",
    "crosspitched": "gabled", "gabled_row": "gabled", "side_hipped": "half-hipped", "hipped-and-gabled": "half-hipped",
    "square_hipped": "pyramidal", "side_half-hipped": "half-hipped", "lean_to": "skillion", "sawtooth": "flat",
    "many": "flat", "butterfly": "flat", "terrace": "flat", "spire": "pyramidal", "tented": "pyramidal",
}  # fmt: skip

# Width [m], material of the map
ROADS: dict[str, tuple[float, str]] = {
    "motorway": (11.0, "asphalt"), "trunk": (9.0, "asphalt"), "primary": (8.0, "asphalt"),
    "secondary": (7.0, "asphalt"),
    "tertiary": (6.5, "asphalt"), "residential": (5.5, "asphalt"), "unclassified": (5.5, "asphalt"),
    "living_street": (5.0, "paving"), "service": (3.5, "asphalt"), "track": (3.0, "gravel"), "busway": (4.0, "asphalt"),
    "motorway_link": (5.0, "asphalt"), "trunk_link": (5.0, "asphalt"), "primary_link": (5.0, "asphalt"),
    "secondary_link": (5.0, "asphalt"), "tertiary_link": (5.0, "asphalt"), "road": (5.0, "asphalt"),
}  # fmt: skip
PATHS: dict[str, tuple[float, str]] = {
    "footway": (2.0, "paving"), "path": (1.5, "gravel"), "cycleway": (2.2, "asphalt"), "pedestrian": (4.0, "paving"),
    "steps": (2.0, "paving"), "bridleway": (2.0, "soil"), "corridor": (0.0, "")}  # fmt: skip
LANE_M = 3.0
SURFACES = {
    "asphalt": "asphalt", "paved": "asphalt", "concrete": "paving", "concrete:plates": "paving",
    "paving_stones": "paving", "sett": "paving", "cobblestone": "paving", "unhewn_cobblestone": "paving",
    "gravel": "gravel", "fine_gravel": "gravel", "compacted": "gravel", "pebblestone": "gravel", "unpaved": "gravel",
    "ground": "soil", "dirt": "soil", "earth": "soil", "mud": "soil", "sand": "sand", "grass": "grass", "wood": "wood",
    "metal": "paving", "bricks": "paving",
}  # fmt: skip
# Areas: (key, value) -> class, material; later layers lie on earlier ones.
AREAS: tuple[tuple[str, frozenset[str], str, str], ...] = (
    ("landuse", frozenset(["residential", "commercial", "retail", "industrial"]), "", ""),
    ("landuse", frozenset(["farmland", "allotments", "plant_nursery", "orchard", "vineyard"]), "vegetation", "soil"),
    (
        "landuse",
        frozenset(["grass", "meadow", "village_green", "recreation_ground", "cemetery", "greenfield"]),
        "grass",
        "grass",
    ),
    ("leisure", frozenset(["park", "garden", "pitch", "golf_course", "dog_park", "common"]), "grass", "grass"),
    ("natural", frozenset(["grassland", "scrub", "heath", "wood", "wetland"]), "grass", "grass"),
    ("landuse", frozenset(("forest",)), "grass", "grass"),
    ("leisure", frozenset(("playground",)), "playground", "sand"),
    ("natural", frozenset(["sand", "beach"]), "terrain", "sand"),
    ("amenity", frozenset(["parking"]), "pavement", "asphalt"),
    ("landuse", frozenset(["construction", "brownfield", "quarry"]), "terrain", "soil"),
    ("natural", frozenset(("water",)), "water", "water"),
    ("landuse", frozenset(["reservoir", "basin"]), "water", "water"),
    ("waterway", frozenset(["riverbank", "dock"]), "water", "water"),
    ("leisure", frozenset(("swimming_pool",)), "water", "water"),
)
WOODS = (("natural", "wood"), ("landuse", "forest"))
WATERWAYS_M = {"river": 12.0, "canal": 8.0, "stream": 2.0, "ditch": 1.0, "drain": 1.0}
# Height [m], thickness [m], material, class
BARRIERS: dict[str, tuple[float, float, str, str]] = {
    "wall": (2.0, 0.24, "stone_wall", "wall"), "retaining_wall": (1.2, 0.3, "stone_wall", "wall"),
    "city_wall": (6.0, 1.2, "stone_wall", "wall"), "fence": (1.4, 0.06, "fence", "fence"),
    "guard_rail": (0.8, 0.1, "steel", "fence"), "hedge": (1.6, 0.9, "hedge", "hedge"),
    "jersey_barrier": (0.9, 0.5, "concrete", "barrier"), "handrail": (1.0, 0.05, "steel", "fence"),
}  # fmt: skip

_COLOURS = {
    "white": "f2f2ee", "black": "202020", "grey": "8c8c8c", "gray": "8c8c8c", "silver": "b4b8bc", "red": "a03c2c",
    "brown": "7a4f34", "beige": "d8c8a4", "yellow": "dcc470", "green": "5c8050", "blue": "5878a8", "orange": "c87840",
    "pink": "d8a8a8", "darkgrey": "606060", "darkgray": "606060", "lightgrey": "bcbcbc", "lightgray": "bcbcbc",
    "maroon": "6c2c24", "tan": "c8ac80", "cream": "ece0c0", "lightyellow": "ece4b8", "sandybrown": "d0a070",
    "firebrick": "983028", "darkred": "782820", "ivory": "ece8d8", "wheat": "e0cc9c", "salmon": "d88c74",
}  # fmt: skip
_COMPASS = (
    "N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW",
)  # fmt: skip


def length_m(text: str | None) -> float | None:
    """Return a length as OpenStreetMap writes it ("12", "12.5 m", "40 ft", "12'6\""), or None."""
    found = _NUMBER.match(text) if text is not None else None
    if found is None:
        return None
    value = float(found[1].replace(",", "."))
    if found[2] in ("ft", "'"):
        value = value * 0.3048 + float(found[3] or 0.0) * 0.0254
    return value if 0.0 <= value <= _MAX_HEIGHT_M else None


def number(text: str | None, greatest: float = 300.0) -> float | None:
    """Return a plain number from 0 to `greatest`, or None."""
    try:
        value = float(text.split(";")[0]) if text is not None else -1.0
    except ValueError:
        return None
    return value if 0.0 <= value <= greatest else None


def direction_deg(text: str | None) -> float | None:
    """Return a direction clockwise from north, stated in degrees or as a point of the compass, or None."""
    if text is None:
        return None
    point = text.strip().upper()
    return 22.5 * _COMPASS.index(point) if point in _COMPASS else number(text.rstrip("° "), 360.0)


def colour(text: str | None) -> tuple[float, float, float] | None:
    """Return a colour by name or as #rrggbb; sRGB codes / 255."""
    if text is None:
        return None
    code = _COLOURS.get(text.strip().lower().replace(" ", "").replace("_", ""), text.strip().lstrip("#"))
    if re.fullmatch(r"[0-9a-fA-F]{3}", code):
        code = "".join(2 * c for c in code)
    if not re.fullmatch(r"[0-9a-fA-F]{6}", code):
        return None
    r, g, b = (int(code[i : i + 2], 16) / 255.0 for i in (0, 2, 4))
    return r, g, b


def building_kind(tags: Tags) -> str:
    kind = tags.get("building:part", "yes")
    return tags.get("building", kind) if kind in ("yes", "no") else kind


def is_house(tags: Tags, area_m2: float) -> bool:
    kind = building_kind(tags)
    return kind in HOUSES or (kind in ("yes", "residential") and area_m2 < _HOUSE_AREA_M2)


def roof_shape(tags: Tags, area_m2: float, levels: float) -> tuple[str, bool]:
    """Return the shape of a roof, and False if a stated one was replaced by the nearest that is built."""
    stated = tags.get("roof:shape") or tags.get("building:roof:shape")
    if stated is None:
        return ("gabled" if is_house(tags, area_m2) and levels <= 3.0 else "flat"), True
    stated = stated.strip().lower()
    if stated in ROOFS:
        return stated, True
    return _NEAREST_ROOF.get(stated, "flat"), False


class Heights(NamedTuple):
    """Heights of a building over its ground [m]."""

    base_m: float
    top_m: float
    roof_m: float | None  # None: not stated
    stated: bool  # the top is not that of the type
    contradictory: bool  # the base is stated to be at or above the top, which counts: the part below it is left thin


def heights(tags: Tags, area_m2: float) -> Heights:
    """Return the heights that the tags state or the type has.

    Of a base above the top, OSM2World keeps the top as well (LevelAndHeightData), with a warning.
    """
    total = length_m(tags.get("height") or tags.get("building:height"))
    levels = number(tags.get("building:levels"))
    roof = length_m(tags.get("roof:height"))
    roof_levels = number(tags.get("roof:levels")) or 0.0
    if roof is None and roof_levels > 0.0:
        roof = LEVEL_M * roof_levels
    stated = total is not None or levels is not None
    if total is None and levels is not None:
        total = LEVEL_M * max(levels, 1.0) + (roof or 0.0)
    if total is None:
        kind = building_kind(tags)
        default = _HEIGHTS_M.get(kind)
        if default is None:
            levels = _LEVELS.get(kind) or (2 if area_m2 < _HOUSE_AREA_M2 else 3)
            default = LEVEL_M * levels
        total = default + (roof or 0.0)
    base = length_m(tags.get("min_height"))
    if base is None:
        base = LEVEL_M * (number(tags.get("building:min_level")) or 0.0)
        if base == 0.0 and building_kind(tags) == "bridge":  # over a street
            base = BRIDGE_M
    least = LEVEL_M if building_kind(tags) == "bridge" else 0.5
    contradictory = stated and base >= total and _states_base(tags)
    if contradictory:
        base = max(total - least, 0.0)
    return Heights(base, max(total, base + least, 1.0), roof, stated, contradictory)


def _states_base(tags: Tags) -> bool:
    return length_m(tags.get("min_height")) is not None or bool(number(tags.get("building:min_level")))


def width_m(tags: Tags, default: float) -> float:
    """Return the width of a road or path."""
    stated = length_m(tags.get("width")) or length_m(tags.get("est_width"))
    if stated is not None and 0.3 <= stated <= 60.0:
        return stated
    lanes = number(tags.get("lanes"))
    return min(max(LANE_M * lanes, 2.5), 40.0) if lanes else default


def is_underground(tags: Tags) -> bool:
    """Return True for what is not seen from above: tunnels, and things of a layer below 0."""
    level = tags.get("layer", "0")
    return tags.get("tunnel", "no") not in ("no",) or tags.get("location") == "underground" or (
        level.startswith("-") and "waterway" not in tags and tags.get("natural") != "water"
    )  # fmt: skip
