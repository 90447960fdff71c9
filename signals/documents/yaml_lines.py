"""Strict YAML with line numbers.

Scalars follow the YAML 1.2 core schema, not YAML 1.1: `on`, `yes` and `no` are text, `1:30` is text and not 90, `010`
is ten, `1e3` is a number, dates are text. Duplicate keys and keys that are not text are errors. Anchors, aliases and
`<<` merges work.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from signals.documents.document import Document, Place, read_text, shown_path
from signals.errors import ConfigError, Problem

_LIMIT_BYTES = 4_000_000
_CACHED_CHARS = 65_536
_LIMIT_VALUES = 200_000  # nested aliases grow exponentially; real files stay far below

_NULL, _BOOL, _INT, _FLOAT, _STR, _MERGE = (
    f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str", "merge")
)


MAX_DEPTH = 50  # nested mappings and lists; real files have five
_MAX_NUMBER_CHARS = 400  # the greatest double has 309 digits
_SURROGATE = re.compile("[\ud800-\udfff]")  # half a character: such text cannot be encoded

# Plain scalars: tag, pattern, first characters.
_CORE_SCHEMA: tuple[tuple[str, str, list[str]], ...] = (
    (_NULL, r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    (_BOOL, r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    (_INT, r"^(?:[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+)$", list("-+0123456789")),
    (
        _FLOAT,
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        list("-+.0123456789"),
    ),
    (_MERGE, r"^<<$", ["<"]),
)


class _CoreSchemaLoader(yaml.SafeLoader):
    """PyYAML's parser with the plain scalars of YAML 1.2 instead of those of 1.1."""

    yaml_implicit_resolvers = {}  # noqa: RUF012  (PyYAML's own name; filled below)
    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose one node, of a limited number: a node takes some 2 kB."""
        self.nodes += 1
        if self.nodes > _LIMIT_VALUES:
            raise _TooManyNodes
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


class _TooManyNodes(Exception):
    """The text holds more keys and values than are read."""


class _Dumper(yaml.SafeDumper):
    """Dumper that writes floats exactly, and quotes text that YAML 1.1 or 1.2 would read as another type."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    text = repr(value)  # shortest text that reads back to the same float
    if "e" in text and "." not in text:  # YAML 1.1 reads 1e-06 as text
        text = text.replace("e", ".0e")
    return dumper.represent_scalar(_FLOAT, text)


def _text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    # Only the style '"' escapes the line breaks of Unicode; readers change them if they are not escaped.
    style = '"' if any(char in value for char in "\x85\u2028\u2029") else None
    return dumper.represent_scalar(_STR, value, style=style)


def _sequence(dumper: yaml.SafeDumper, value: Sequence[Any]) -> yaml.SequenceNode:
    flat = not any(isinstance(item, list | tuple | dict) for item in value)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=flat)


_Dumper.add_representer(float, _float)
_Dumper.add_representer(str, _text)
for _kind in (list, tuple):
    _Dumper.add_representer(_kind, _sequence)
for _class in (_CoreSchemaLoader, _Dumper):
    for _tag, _pattern, _first in _CORE_SCHEMA:
        _class.add_implicit_resolver(_tag, re.compile(_pattern), _first)


def dump_yaml(data: Any) -> str:
    """Return plain data as text that reads back to the same data: keys in order, short lists on one line."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


def _scalar(tag: str, text: str) -> Any:
    if tag == _NULL:
        return None
    if tag == _BOOL:
        return text.lower() == "true"
    if tag == _INT:
        return int(text, 0) if text[:2] in ("0x", "0o") else int(text)
    if tag == _FLOAT:
        return float(text.replace(".", "") if text[-1] in "fFnN" else text)  # ".inf" -> "inf"
    return text


class _Builder:
    """Builder of plain data from a tree of YAML nodes; it collects lines and problems."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.lines: dict[Place, int] = {}
        self.problems: list[Problem] = []
        self._open: list[yaml.Node] = []
        self._values = 0

    def problem(self, node: yaml.Node, message: str, hint: str = "") -> None:
        self.problems.append(Problem(f"{self.source}:{node.start_mark.line + 1}", message, hint))

    def build(self, node: yaml.Node, place: Place) -> Any:
        self._values += 1
        if self._values > _LIMIT_VALUES:
            raise ConfigError.at(self.source, f"holds more than {_LIMIT_VALUES} values once unfolded")
        if any(node is other for other in self._open):
            self.problem(node, "this anchor contains itself")
            return None
        if len(self._open) > MAX_DEPTH:
            raise ConfigError([_too_deep(self.source, node.start_mark.line + 1)])
        self.lines.setdefault(place, node.start_mark.line + 1)
        if isinstance(node, yaml.ScalarNode):
            if node.tag not in (_NULL, _BOOL, _INT, _FLOAT, _STR, _MERGE):
                self.problem(node, f"the tag {_short(node.tag)} is not understood")
                return None
            if _SURROGATE.search(node.value):
                self.problem(
                    node, "holds half a surrogate pair, which is not a character", "write the character itself"
                )
                return None
            if node.tag in (_INT, _FLOAT) and len(node.value) > _MAX_NUMBER_CHARS:
                self.problem(node, f"is a number of {len(node.value)} characters", f"{_MAX_NUMBER_CHARS} at most")
                return None
            try:
                return _scalar(node.tag, node.value)
            except ValueError:
                self.problem(node, f"{node.value[:60]!r} is not a value of type {_short(node.tag)}")
                return None
        self._open.append(node)
        try:
            if isinstance(node, yaml.SequenceNode):
                if node.tag != "tag:yaml.org,2002:seq":
                    self.problem(node, f"the tag {_short(node.tag)} is not understood")
                return [self.build(child, (*place, i)) for i, child in enumerate(node.value)]
            assert isinstance(node, yaml.MappingNode)
            return self._mapping(node, place)
        finally:
            self._open.pop()

    def _mapping(self, node: yaml.MappingNode, place: Place) -> dict[str, Any]:
        if node.tag != "tag:yaml.org,2002:map":
            self.problem(node, f"the tag {_short(node.tag)} is not understood")
        first_line: dict[str, int] = {}
        merged: list[yaml.Node] = []
        own_entries: list[tuple[str, yaml.Node, yaml.Node]] = []
        for key_node, value_node in node.value:
            if key_node.tag == _MERGE:
                merged += value_node.value if isinstance(value_node, yaml.SequenceNode) else [value_node]
                continue
            if not isinstance(key_node, yaml.ScalarNode) or key_node.tag != _STR:
                shown = key_node.value if isinstance(key_node, yaml.ScalarNode) else "a list or mapping"
                self.problem(key_node, f"a key must be text, not {shown}", "put it in quotes")
                continue
            key = key_node.value
            if _SURROGATE.search(key):
                self.problem(key_node, "a key holds half a surrogate pair, which is not a character")
                continue
            if key in first_line:
                self.problem(
                    key_node,
                    f"{dotted((*place, key))} is given twice",
                    f"the first one is on line {first_line[key]}",
                )
                continue
            first_line[key] = key_node.start_mark.line + 1
            own_entries.append((key, key_node, value_node))
        result: dict[str, Any] = {}
        # Own keys first, then merges from left to right: the first one wins, by the definition of YAML's merge type.
        for key, key_node, value_node in own_entries:
            self.lines[(*place, key)] = key_node.start_mark.line + 1
            result[key] = self.build(value_node, (*place, key))
        for other in merged:
            if not isinstance(other, yaml.MappingNode):
                self.problem(other, "<< takes a mapping or a list of mappings")
                continue
            extra = _Builder(self.source)
            extra._open, extra._values = self._open, self._values
            for key, value in (extra.build(other, place) or {}).items():
                if key not in result:
                    result[key] = value
                    merged_place = (*place, key)
                    lines = {p: n for p, n in extra.lines.items() if p[: len(merged_place)] == merged_place}
                    self.lines.update(lines)
            self._values = extra._values
            self.problems += extra.problems
        return result


def _short(tag: str) -> str:
    return "!!" + tag.removeprefix("tag:yaml.org,2002:") if tag.startswith("tag:yaml") else tag


def dotted(place: Place) -> str:
    """Return a place as text: ('sensors', 'gps', 'rate_hz') -> 'sensors.gps.rate_hz', indices in brackets."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else (f".{part}" if text else part)
    return text


def parse_yaml(text: str, source: str) -> Document:
    """Parse one YAML document; an empty one is {}. Raises ConfigError with every problem found."""
    try:
        node = yaml.compose(text, Loader=_CoreSchemaLoader)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"the character U+{ord(text[error.position]):04X} has no place in a YAML file"
        raise ConfigError.at(f"{source}:{line}", message) from None
    except yaml.MarkedYAMLError as error:
        raise ConfigError([_syntax_problem(error, text, source)]) from None
    except _TooManyNodes:
        message = f"holds more than {_LIMIT_VALUES} keys and values"
        raise ConfigError.at(source, message, "is it the file you meant?") from None
    except RecursionError:
        raise ConfigError([_find_too_deep(text, source)]) from None
    if node is None:
        return Document(source, {}, {(): 1})
    builder = _Builder(source)
    data = builder.build(node, ())
    if builder.problems:
        raise ConfigError(builder.problems)
    return Document(source, data, builder.lines)


def _too_deep(source: str, line: int) -> Problem:
    return Problem(f"{source}:{line}", f"is nested too deeply: more than {MAX_DEPTH} levels")


def _find_too_deep(text: str, source: str) -> Problem:
    """Return the problem at the line where the nesting becomes too deep; the parser's events need no recursion."""
    depth = 0
    for event in yaml.parse(text, Loader=_CoreSchemaLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH + 1 and event.start_mark is not None:
            return _too_deep(source, event.start_mark.line + 1)
    return Problem(source, "is nested too deeply")


def _syntax_problem(error: yaml.MarkedYAMLError, text: str, source: str) -> Problem:
    mark = error.problem_mark or error.context_mark
    line = mark.line if mark else 0
    lines = text.splitlines()
    # The parser often complains about the line after the tab that caused it.
    for candidate in (line, line - 1):
        if 0 <= candidate < len(lines) and re.match(r"^ *\t", lines[candidate]):
            return Problem(f"{source}:{candidate + 1}", "is indented with a tab", "use spaces")
    what = (error.problem or "cannot be parsed").replace("could not find", "there is no")
    context = f" {error.context}" if error.context else ""
    return Problem(f"{source}:{line + 1}", f"is not valid YAML: {what}{context}")


def read_yaml(path: Path) -> Document:
    """Read and parse a file. Raises ConfigError."""
    text, source = read_text(path, limit_bytes=_LIMIT_BYTES), shown_path(path)
    if len(text) > _CACHED_CHARS:
        return parse_yaml(text, source)
    document = _parsed(text, source)
    return Document(source, copy.deepcopy(document.data), document.lines)


@lru_cache(maxsize=64)  # many benches are loaded from the same few files
def _parsed(text: str, source: str) -> Document:
    return parse_yaml(text, source)
