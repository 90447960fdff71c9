"""Read an MJCF file and all files it names into one text that keeps the line of every element.

Each include is replaced by the file's contents. The files of meshes, textures, height fields, skins and sub-models are
read here, so that a missing file is reported with file and line, and a map can be stored with a run. File names follow
MuJoCo's rules: relative to the folder of the main file, below `meshdir`, `texturedir` or `assetdir` of <compiler>. In
the text every element is on its own line, so the line in an error of MuJoCo's compiler leads to the user's line.
"""

from __future__ import annotations

import re
import xml.parsers.expat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

from signals.documents.document import shown_path
from signals.errors import ConfigError, Problem
from sim.scene.budget import Budget
from sim.scene.files_below import file_below

MAX_XML_BYTES = 64_000_000
MAX_DEPTH = 200

_DIRS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}
_TEXTURE_SIDES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_TEXT_KEYS = frozenset(
    ("name", "file", "class", "childclass", "material", "mesh", "texture", "hfield", "model", *_TEXTURE_SIDES)
)
_LENGTH_KEYS = frozenset(("pos", "size", "fromto"))
_NOT_FINITE = re.compile(r"(?<![\w.])[+-]?(?:nan|inf|infinity)(?![\w.])", re.IGNORECASE)
MAX_LENGTH_M = 1.0e5
_ASSET_NAME = re.compile(r'"(\d{4,}_[A-Za-z0-9_.-]*)"')  # as `_asset` makes them
_COPIES_OF_ASSET = 2
_COPIES_OF_TEXT = 8  # of a file, until MuJoCo has read it
_ELEMENT_BYTES = 1000
_COMPILER_PATHS = ("meshdir", "texturedir", "assetdir", "strippath")


@dataclass
class Element:
    """An XML element with its file and line."""

    tag: str
    attributes: dict[str, str]
    source: str
    line: int
    children: list[Element] = field(default_factory=list)

    @property
    def where(self) -> str:
        return f"{self.source}:{self.line}"

    def walk(self) -> Iterator[Element]:
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(frozen=True)
class MapFile:
    """One MJCF text, the files it names, and the source lines of its elements."""

    text: str
    assets: dict[str, bytes]
    root: Element
    elements: tuple[Element, ...]  # element of each line of `text`, line 1 first
    asset_elements: dict[str, Element]

    def where(self, tag: str, name: str) -> str:
        """Return 'file:line' of the element `tag` called `name`, or of the whole file."""
        for element in self.root.walk():
            if element.tag == tag and element.attributes.get("name") == name:
                return element.where
        return self.root.source

    def problem(self, error: str) -> Problem:
        """Return an error of MuJoCo about `text` as a problem at the user's own line."""
        message = " ".join(error.removeprefix("XML Error: ").removeprefix("Error: ").split())
        message = re.sub(r" Element name '', id -?\d+| Element '\w+'", "", message)
        message = re.sub(r" Element name '(.+)', id -?\d+", r" (\1)", message)
        found = re.search(r",? ?\(?line[ =]+(\d+)(?:, column \d+)?\)?", message)
        if found is not None and 0 < int(found[1]) <= len(self.elements):
            element = self.elements[int(found[1]) - 1]
            message = message.replace(found[0], "", 1)
        else:
            element = self.root
            for name, named in self.asset_elements.items():
                if name in message:
                    element = named
        for name, named in self.asset_elements.items():
            message = message.replace(name, named.attributes.get("file", name))
        return Problem(element.where, f"MuJoCo cannot compile this map: {message}")


def read_map_file(
    path: Path, *, root: Path | None = None, budget: Budget | None = None, inside: tuple[Path, ...] = ()
) -> MapFile:
    """Read a map. Raises ConfigError with every problem.

    `root`: the folder that holds all its files, by default that of the map. `budget`: charged with what is read.
    `inside`: the files that contain this one as a sub-model.
    """
    return _MapReader(path, root or path.parent, budget or Budget(shown_path(path)), inside).read()


def parse_xml(path: Path, budget: Budget, where: str = "") -> Element:
    """Parse an XML file. Raises ConfigError, at `where` if the file cannot be read."""
    source = shown_path(path)
    try:
        if not path.exists():
            raise ConfigError.at(where or source, f"no such file: {source}" if where else "no such file")
        if not path.is_file():
            raise ConfigError.at(where or source, f"{source} is not a regular file")
        if path.stat().st_size > MAX_XML_BYTES:
            raise ConfigError.at(source, f"is longer than the {MAX_XML_BYTES / 1e6:g} MB that are read")
        budget.memory(_COPIES_OF_TEXT * path.stat().st_size, source)
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ConfigError.at(where or source, f"{source} cannot be read: {error}") from None
    if not data.strip():
        raise ConfigError.at(source, "is empty", "an MJCF file begins with <mujoco>")
    parser = xml.parsers.expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []

    def entity(name: str, *_: object) -> None:
        message = f"declares the entity {name[:40]!r}, which could expand to any size"
        raise ConfigError.at(f"{source}:{parser.CurrentLineNumber}", message, "write its text where it is used")

    def start(tag: str, attributes: dict[str, str]) -> None:
        place = f"the elements up to {source}:{parser.CurrentLineNumber}"
        budget.objects(1, place)
        budget.memory(_ELEMENT_BYTES, place)
        element = Element(tag, attributes, source, parser.CurrentLineNumber)
        if len(open_elements) > MAX_DEPTH:
            raise ConfigError.at(element.where, f"is nested too deeply: more than {MAX_DEPTH} elements")
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_tag: str) -> None:
        open_elements.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(data, True)
    except xml.parsers.expat.ExpatError as error:
        text = xml.parsers.expat.ErrorString(error.code)
        raise ConfigError.at(f"{source}:{error.lineno}", f"is not valid XML: {text}") from None
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise ConfigError.at(f"{source}:1", f"is not valid XML: {error}") from None
    return roots[0]


def _as_numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []  # MuJoCo reports it


class _MapReader:
    """State while one file is read."""

    def __init__(self, path: Path, root: Path, budget: Budget, inside: tuple[Path, ...]) -> None:
        self._path, self._root, self._budget = path, root, budget
        self._inside = (*inside, path.resolve())
        self._problems: list[Problem] = []
        self._assets: dict[str, bytes] = {}
        self._asset_names: dict[Path, str] = {}
        self._asset_elements: dict[str, Element] = {}

    def read(self) -> MapFile:
        root = parse_xml(self._path, self._budget)
        if root.tag == "robot":
            raise ConfigError.at(root.where, "is URDF, not MJCF", "MuJoCo's own `compile` turns it into MJCF")
        if root.tag != "mujoco":
            raise ConfigError.at(root.where, f"is not MJCF: it begins with <{root.tag}>, not with <mujoco>")
        self._include(root, self._path, [self._path.resolve()], set())
        paths: dict[str, str] = {}
        for element in root.walk():
            if element.tag == "compiler":
                for key in _COMPILER_PATHS:
                    if key in element.attributes:
                        paths[key] = element.attributes.pop(key)
        for element in root.walk():
            self._check_numbers(element)
            self._read_files(element, paths)
        if self._problems:
            raise ConfigError(self._problems)
        lines: list[str] = []
        elements: list[Element] = []
        _write(root, lines, elements)
        text = "\n".join(lines)
        return MapFile(text, self._assets, root, tuple(elements), self._asset_elements)

    def _include(self, parent: Element, path: Path, inside: list[Path], seen: set[Path]) -> None:
        """Replace each <include> below `parent` by the elements of its file. `seen` collects the included files."""
        children: list[Element] = []
        for child in parent.children:
            if child.tag != "include":
                self._include(child, path, inside, seen)
                children.append(child)
                continue
            name = child.attributes.get("file", "")
            if not name:
                self._problems.append(Problem(child.where, "<include> names no file"))
                continue
            found = self._named(child, [self._path.parent, path.parent], name)
            if found is None:
                continue
            file, resolved = found
            if resolved in inside:
                self._problems.append(Problem(child.where, f"<include> of {name}, which includes this file itself"))
                continue
            if resolved in seen:
                self._problems.append(Problem(child.where, f"<include> of {name} a second time: MJCF allows one"))
                continue
            seen.add(resolved)
            try:
                included = parse_xml(file, self._budget, child.where)
            except ConfigError as error:
                self._problems += error.problems
                continue
            self._include(included, file, [*inside, resolved], seen)
            children += included.children
        parent.children = children

    def _check_numbers(self, element: Element) -> None:
        """Report numbers that are not finite or too large, which MuJoCo accepts although all results become wrong."""
        for key, value in element.attributes.items():
            if key in _TEXT_KEYS:
                continue
            if _NOT_FINITE.search(value):
                message = f"<{element.tag}> {key} must hold finite numbers, not {value[:60]!r}"
                self._problems.append(Problem(element.where, message))
            elif key in _LENGTH_KEYS and any(abs(number) > MAX_LENGTH_M for number in _as_numbers(value)):
                message = f"<{element.tag}> {key} goes beyond {MAX_LENGTH_M:g} m: {value[:60]!r}"
                self._problems.append(Problem(element.where, message))

    def _read_files(self, element: Element, paths: dict[str, str]) -> None:
        tag = element.tag
        if tag in _DIRS:
            folder = paths.get(_DIRS[tag], paths.get("assetdir", ""))
            for key in ("file", *(_TEXTURE_SIDES if tag == "texture" else ())):
                name = element.attributes.get(key)
                if not name:
                    continue
                if paths.get("strippath") == "true":
                    name = re.split(r"[/\\]", name)[-1]
                if key == "file" and tag != "skin":
                    element.attributes.setdefault("name", Path(name).stem)
                element.attributes[key] = self._asset(element, folder, name)
        elif tag == "model" and "file" in element.attributes:
            self._sub_model(element, element.attributes["file"])
        elif tag in ("flexcomp", "flex"):
            message = f"<{tag}> bends by itself, which the bench does not simulate"
            self._problems.append(Problem(element.where, message, "leave it out"))

    def _named(self, element: Element, folders: list[Path], name: str) -> tuple[Path, Path] | None:
        """Return a file of the map, as it is named and its real path; None after a problem."""
        message, hint = "", ""
        for folder in folders:
            try:
                real = file_below(self._root, folder, name)
                if real.is_file():
                    return folder / name, real
                message, hint = f"does not exist: {name[:200]}", f"looked for {shown_path(folder / name)}"
            except (ValueError, OSError) as error:
                if not message:
                    hint = f"copy it below {shown_path(self._root)}, or write a scene file in a folder above both"
                    message = str(error)
        self._problems.append(Problem(element.where, f"<{element.tag}> names a file that {message}", hint))
        return None

    def _asset(self, element: Element, folder: str, name: str) -> str:
        """Return the name of a file in `assets`; each file is read once."""
        # As MuJoCo joins them: an absolute name stands alone.
        found = self._named(element, [self._path.parent], str(Path(folder, name)))
        if found is None:
            return name
        path, real = found
        cached_name = self._asset_names.get(real)
        if cached_name is not None:
            return cached_name
        tag = f"<{element.tag}>"
        try:
            self._budget.memory(_COPIES_OF_ASSET * real.stat().st_size, f"{tag} {name}")
            data = real.read_bytes()
        except (OSError, ValueError) as error:
            self._problems.append(Problem(element.where, f"{tag}: {name!r} cannot be read: {error}"))
            return name
        if not data:
            self._problems.append(Problem(element.where, f"{tag} names a file that is empty: {name}"))
        asset_name = f"{len(self._assets):04d}_{re.sub(r'[^A-Za-z0-9_.-]', '_', path.name)}"
        self._asset_names[real] = asset_name
        self._assets[asset_name] = data
        self._asset_elements[asset_name] = Element(element.tag, {"file": name}, element.source, element.line)
        return asset_name

    def _sub_model(self, element: Element, name: str) -> None:
        found = self._named(element, [self._path.parent], name)
        if found is None:
            return
        path, real = found
        if real in self._inside:
            self._problems.append(Problem(element.where, f"<model> of {name}, which contains this file"))
            return
        try:
            sub = read_map_file(path, root=self._root, budget=self._budget, inside=self._inside)
        except ConfigError as error:
            self._problems += error.problems
            return
        number = len(self._assets)
        for asset_name, data in sub.assets.items():
            renamed = f"{number:04d}_{asset_name}"
            self._assets[renamed] = data
            self._asset_elements[renamed] = sub.asset_elements[asset_name]
        text = _ASSET_NAME.sub(lambda m: f'"{number:04d}_{m[1]}"' if m[1] in sub.assets else m[0], sub.text)
        element.attributes.setdefault("name", sub.root.attributes.get("model", path.stem))
        asset_name = f"{number:04d}_{re.sub(r'[^A-Za-z0-9_.-]', '_', path.stem)}.xml"
        self._assets[asset_name] = text.encode()
        self._asset_elements[asset_name] = Element(element.tag, {"file": name}, element.source, element.line)
        element.attributes["file"] = asset_name


def _write(element: Element, lines: list[str], elements: list[Element]) -> None:
    """Append every start and end tag as a line of its own; `elements` gets the element of each line."""
    attributes = "".join(f" {key}={quoteattr(value)}" for key, value in element.attributes.items())
    elements.append(element)
    if not element.children:
        lines.append(f"<{element.tag}{attributes}/>")
        return
    lines.append(f"<{element.tag}{attributes}>")
    for child in element.children:
        _write(child, lines, elements)
    lines.append(f"</{element.tag}>")
    elements.append(element)
