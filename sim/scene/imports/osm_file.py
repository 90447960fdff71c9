"""Read an OpenStreetMap extract: XML (.osm) or, with the package osmium, PBF (.osm.pbf).

No external entity is read, and a file with a document type declaration is refused: it could expand to any size.
"""

from __future__ import annotations

import xml.parsers.expat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from signals.documents.document import shown_path
from signals.errors import ConfigError
from sim.scene.budget import Budget
from sim.scene.work_progress import progress

MAX_BYTES = 300_000_000
MAX_OBJECTS = 3_000_000
MAX_WAY_NODES = 2000  # OpenStreetMap's own limit
MAX_TEXT = 10_000  # characters of a tag; OpenStreetMap allows 255
_CHUNK_BYTES = 1 << 16  # of the file at a time: no element is longer
_OBJECT_BYTES, _TAG_BYTES, _REFERENCE_BYTES = 500, 300, 60
Tags = dict[str, str]
Node = tuple[float, float]  # latitude, longitude [deg]


@dataclass(frozen=True)
class Way:
    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True)
class Relation:
    members: tuple[tuple[str, int, str], ...]  # type, id, role
    tags: Tags


@dataclass
class OsmData:
    """Contents of an extract. Deleted objects, and nodes that are not on Earth, are left out."""

    source: str
    nodes: dict[int, Node] = field(default_factory=dict)
    node_tags: dict[int, Tags] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: dict[int, Relation] = field(default_factory=dict)
    bounds: tuple[float, float, float, float] | None = None  # least latitude and longitude, greatest ones

    def middle(self) -> Node:
        """Return the middle of the extract: of its bounds, or of its nodes if it states none."""
        if self.bounds is None or self.bounds[3] - self.bounds[1] > 180.0:
            latitudes, longitudes = zip(*self.nodes.values(), strict=True)
            if max(longitudes) - min(longitudes) > 180.0:  # on both sides of the date line
                longitudes = tuple(longitude % 360.0 for longitude in longitudes)
            self.bounds = (min(latitudes), min(longitudes), max(latitudes), max(longitudes))
        south, west, north, east = self.bounds
        longitude = 0.5 * (west + east)
        return 0.5 * (south + north), longitude - 360.0 if longitude > 180.0 else longitude


def read_osm(path: Path, budget: Budget | None = None) -> OsmData:
    """Read an extract. Raises ConfigError with what is wrong, and the line where there is one."""
    source = shown_path(path)
    budget = budget or Budget(source)
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise ConfigError.at(source, "is not a regular file")
        if size > MAX_BYTES:
            message = f"is longer than the {MAX_BYTES / 1e6:g} MB that are read: {size / 1e6:.4g} MB"
            raise ConfigError.at(source, message, "cut out a district: osmium extract --bbox W,S,E,N")
        if path.suffix.lower() == ".pbf":
            data = _pbf(path, source, budget)
        else:
            with path.open("rb") as file:
                data = _xml(file, source, size, budget)
    except OSError as error:
        raise ConfigError.at(source, f"cannot be read: {error.strerror or error}") from None
    if not data.nodes:
        raise ConfigError.at(source, "is empty: it holds no node")
    return data


class _Refused(Exception):
    """A part of an XML file that is not accepted."""


def _xml(file: BinaryIO, source: str, size: int, budget: Budget) -> OsmData:
    data = OsmData(source)
    parser = xml.parsers.expat.ParserCreate()
    tags: Tags = {}
    refs: list[int] = []
    members: list[tuple[str, int, str]] = []
    count = 0
    root = ""

    def start(tag: str, a: dict[str, str]) -> None:
        nonlocal tags, refs, members, count, root
        if tag == "tag":
            budget.memory(_TAG_BYTES, "its objects")
            if len(a["k"]) + len(a["v"]) > MAX_TEXT:
                raise _Refused(f"a tag of {len(a['k']) + len(a['v'])} characters; {MAX_TEXT} are allowed")
            tags[a["k"]] = a["v"]
        elif tag == "nd":
            budget.memory(_REFERENCE_BYTES, "its objects")
            refs.append(int(a["ref"]))
            if len(refs) > MAX_WAY_NODES:
                raise _Refused(f"a way of more than {MAX_WAY_NODES} nodes, as many as OpenStreetMap allows")
        elif tag == "member":
            budget.memory(_TAG_BYTES, "its objects")
            members.append((a["type"], int(a["ref"]), a.get("role", "")))
        elif tag in ("node", "way", "relation"):
            tags, refs, members = {}, [], []
            budget.memory(_OBJECT_BYTES, "its objects")
            count += 1
            if count > MAX_OBJECTS:
                raise _Refused(f"holds more than {MAX_OBJECTS} objects: cut out a district")
            if tag == "node" and a.get("action") != "delete" and a.get("visible") != "false":
                number = int(a["id"])
                place = (float(a["lat"]), float(a["lon"]))
                if not (-90.0 <= place[0] <= 90.0 and -180.0 <= place[1] <= 180.0):
                    raise _Refused(f"node {number} is not on Earth: lat {a['lat'][:20]}, lon {a['lon'][:20]}")
                data.nodes[number] = place
                data.node_tags[number] = tags
            elif tag == "way" and a.get("action") != "delete" and a.get("visible") != "false":
                open_way.append(int(a["id"]))
            elif tag == "relation" and a.get("action") != "delete" and a.get("visible") != "false":
                open_relation.append(int(a["id"]))
        elif tag == "bounds" and data.bounds is None:
            south, west, north, east = (float(a[key]) for key in ("minlat", "minlon", "maxlat", "maxlon"))
            if not (-90.0 <= south <= north <= 90.0 and -180.0 <= west <= east <= 180.0):
                raise _Refused(f"bounds that are not on Earth: {south:g}, {west:g}, {north:g}, {east:g}")
            data.bounds = (south, west, north, east)
        elif not root:
            root = tag
            if tag != "osm":
                raise _Refused(f"is XML but not OpenStreetMap: it begins with <{tag[:40]}>, not with <osm>")

    open_way: list[int] = []
    open_relation: list[int] = []

    def end(tag: str) -> None:
        if tag == "way" and open_way:
            data.ways[open_way.pop()] = Way(tuple(refs), tags)
        elif tag == "relation" and open_relation:
            data.relations[open_relation.pop()] = Relation(tuple(members), tags)

    def doctype(*_: object) -> None:
        raise _Refused("has a document type declaration, which no OpenStreetMap file needs")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    fed = 0
    try:
        while chunk := file.read(_CHUNK_BYTES):
            if not fed and chunk.startswith((b"\x1f\x8b", b"BZh")):
                raise ConfigError.at(source, "is compressed", "unpack it: gunzip or bunzip2")
            if not fed and not chunk.strip():
                raise ConfigError.at(source, "is empty", "an OpenStreetMap file begins with <osm>")
            parser.Parse(chunk, False)
            fed += len(chunk)
            progress.tell("MB read", fed // 1_000_000, size // 1_000_000)
            if fed - max(parser.CurrentByteIndex, 0) > 2 * _CHUNK_BYTES:
                raise _Refused(f"an element or a text of more than {_CHUNK_BYTES} bytes")
        if not fed:
            raise ConfigError.at(source, "is empty", "an OpenStreetMap file begins with <osm>")
        parser.Parse(b"", True)
    except xml.parsers.expat.ExpatError as error:
        message = xml.parsers.expat.ErrorString(error.code)
        raise ConfigError.at(f"{source}:{error.lineno}", f"is not valid XML: {message}") from None
    except _Refused as error:
        raise ConfigError.at(f"{source}:{parser.CurrentLineNumber}", str(error)) from None
    except KeyError as error:
        message = f"an element has no attribute {error.args[0]!r}"
        raise ConfigError.at(f"{source}:{parser.CurrentLineNumber}", message) from None
    except (ValueError, LookupError) as error:
        raise ConfigError.at(f"{source}:{parser.CurrentLineNumber}", f"holds a wrong value: {error}") from None
    data.node_tags = {number: found for number, found in data.node_tags.items() if found}
    return data


def _pbf(path: Path, source: str, budget: Budget) -> OsmData:
    try:
        import osmium
    except ImportError:
        message = "is a PBF file, and the package osmium, which reads these, is not installed"
        hint = 'pip install "hil-bench[scenes]", or: osmium cat IN.osm.pbf -o OUT.osm'
        raise ConfigError.at(source, message, hint) from None
    data = OsmData(source)
    try:
        objects: Any = osmium.FileProcessor(str(path))
        for count, item in enumerate(objects):
            if count >= MAX_OBJECTS:
                message = f"holds more than {MAX_OBJECTS} objects"
                raise ConfigError.at(source, message, "cut out a district: osmium extract --bbox W,S,E,N")
            tags = {tag.k: tag.v for tag in item.tags}
            budget.memory(_OBJECT_BYTES + _TAG_BYTES * len(tags), "its objects")
            if item.is_node():
                data.nodes[item.id] = (item.lat, item.lon)
                if tags:
                    data.node_tags[item.id] = tags
            elif item.is_way():
                budget.memory(_REFERENCE_BYTES * len(item.nodes), "its ways")
                if len(item.nodes) > MAX_WAY_NODES:
                    message = f"way {item.id} has {len(item.nodes)} nodes; OpenStreetMap allows {MAX_WAY_NODES}"
                    raise ConfigError.at(source, message)
                data.ways[item.id] = Way(tuple(node.ref for node in item.nodes), tags)
            elif item.is_relation():
                budget.memory(_TAG_BYTES * len(item.members), "its relations")
                members = tuple((_KINDS[m.type], m.ref, m.role) for m in item.members)
                data.relations[item.id] = Relation(members, tags)
        reader = osmium.io.Reader(str(path))
        box = reader.header().box()
        if box.valid():
            data.bounds = (box.bottom_left.lat, box.bottom_left.lon, box.top_right.lat, box.top_right.lon)
        reader.close()
    except (RuntimeError, ValueError, OSError) as error:
        raise ConfigError.at(source, f"cannot be read as OpenStreetMap PBF: {error}") from None
    return data


_KINDS = {"n": "node", "w": "way", "r": "relation"}
