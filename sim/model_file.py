"""Reads a YAML file into a strict pydantic model and reports every problem at once, each with its line."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar

import pydantic
import yaml

from hil.signals.errors import ConfigError, Problem

Model = TypeVar("Model", bound=pydantic.BaseModel)


class StrictModel(pydantic.BaseModel):
    """Frozen, no unknown keys, no NaN or infinity, no silent conversion between kinds of value."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_DEEPEST = 10  # mappings and lists within one another whose lines are kept
Lines = dict[tuple[str | int, ...], int]


def load_model(path: Path, model: type[Model]) -> Model:
    """Parse and validate `path`. Raises ConfigError that carries every problem with file and line."""
    return load_located(path, model)[0]


def load_located(path: Path, model: type[Model]) -> tuple[Model, Lines]:
    """As `load_model`, with the 1-based line of every place in the file."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError([Problem(str(path), f"cannot be read: {error}", "check the path")]) from error
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark else str(path)
        raise ConfigError([Problem(where, f"is not valid YAML: {getattr(error, 'problem', error)}")]) from error
    except RecursionError:
        raise ConfigError([Problem(str(path), "is not valid YAML: brackets within brackets without end")]) from None
    try:
        return model.model_validate(data), _lines(root)
    except pydantic.ValidationError as error:
        problems = [
            Problem(
                f"{path}:{_line(root, place)}",
                f"{'.'.join(str(part) for part in place) or 'file'}: {item['msg']}",
                _hint(model, item),
            )
            for item in error.errors()
            for place in [tuple(part for part in item["loc"] if " " not in str(part))]  # the names of union branches
        ]
        raise ConfigError(problems) from error


def _lines(root: yaml.Node | None) -> Lines:
    """Line of every place; that of a mapping's entry is the line of its key."""
    lines: Lines = {}
    todo: list[tuple[tuple[str | int, ...], yaml.Node | None]] = [((), root)]
    while todo:
        place, node = todo.pop()
        if node is None or len(place) > _DEEPEST:
            continue  # an anchor may contain itself
        lines.setdefault(place, node.start_mark.line + 1)
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                lines[(*place, key.value)] = key.start_mark.line + 1
                todo.append(((*place, key.value), value))
        elif isinstance(node, yaml.SequenceNode):
            todo += [((*place, i), value) for i, value in enumerate(node.value)]
    return lines


def _line(node: yaml.Node | None, location: tuple[Any, ...]) -> int:
    """1-based line of the deepest part of `location` that the file has."""
    line = 1
    for part in location:
        found: yaml.Node | None = None
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == part:
                    line, found = key.start_mark.line + 1, value
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            found = node.value[part]
            line = found.start_mark.line + 1
        if found is None:
            break
        node = found
    return line


def _hint(model: type[pydantic.BaseModel], item: Any) -> str:
    """The nearest legal key for an unknown one at the top level, else nothing."""
    if item["type"] != "extra_forbidden":
        return ""
    near = difflib.get_close_matches(str(item["loc"][-1]), list(model.model_fields), n=1)
    return f"did you mean '{near[0]}'?" if near and len(item["loc"]) == 1 else ""
