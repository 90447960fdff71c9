"""Validation of a file's data by a pydantic model, with messages in plain words for all problems.

The data are read in pydantic's strict JSON mode: "1" is not a number, 1 is not true, a whole number is taken as a real
number, a list as a tuple. NaN and infinity are always refused.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import types
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import core_schema

from signals.documents.document import Document, Place
from signals.documents.yaml_lines import dotted, read_yaml
from signals.errors import ConfigError, Problem

MAX_HINTS = 50  # problems of one validation that get the nearest legal word as a hint
MAX_WORD = 100  # characters of a word that are compared with legal words
MAX_KNOWN = 2000  # legal words that a word is compared with

Model = TypeVar("Model", bound=BaseModel)

COMMAND_LINE = "--"  # prefix of an origin that is a command-line option, not a file

# Longest suffix first: "_mps2" before "_s".
_UNITS = {
    "_radps": "rad/s", "_mps2": "m/s2", "_degc": "degC", "_tesla": "T", "_mps": "m/s", "_deg": "deg", "_rad": "rad",
    "_n_per_radps2": "N/(rad/s)2", "_n_per_m2ps2": "N/(m/s)2", "_n_per_mps": "N/(m/s)", "_kg_per_rad": "kg/rad",
    "_kgm2": "kg m2", "_m3": "m3", "_px": "px", "_s_per_m": "S/m", "_per_m": "per m",
    "_pa": "Pa", "_ns": "ns", "_us": "us", "_ms": "ms", "_hz": "Hz", "_kg": "kg", "_nm": "N m",
    "_m": "m", "_s": "s", "_n": "N",
}  # fmt: skip


class StrictModel(BaseModel):
    """Base of settings: frozen, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True, allow_inf_nan=False)


class ChosenByFunction:
    """Annotation of a tagged union whose discriminator is a function, for `Annotated[A | B, Discriminator(f), this]`.

    To serialise such a union, pydantic calls the function too, and drops whatever it raises: also the KeyboardInterrupt
    of a signal that comes within it, and the program goes on as if nothing had stopped it. With this annotation the
    function chooses only where data are read. Values are serialised by their type.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        union: Any = handler(source)
        return read_by(union, core_schema.union_schema(list(union["choices"].values())))


def read_by(reader: core_schema.CoreSchema, values: core_schema.CoreSchema) -> core_schema.CoreSchema:
    """Return the schema that reads data by `reader`, and serialises the values as `values` does."""
    return core_schema.chain_schema([reader, values])  # serialised as its last step


class Section(StrictModel):
    """One mapping of a bench file: a StrictModel that converts no types, even if it is not built by `validate`."""

    model_config = ConfigDict(strict=True)


class Located(Protocol):
    """Source of data that knows the file and line of each place."""

    def where(self, place: Place) -> str: ...


def unit_of(name: str) -> str:
    """Return the unit that a key's suffix names, with a leading space: 'rate_hz' -> ' Hz'; '' if there is none."""
    for suffix, unit in _UNITS.items():
        if name.endswith(suffix):
            return f" {unit}"
    return ""


def nearest(word: str, known: Iterable[str], *, listed: bool = True) -> str:
    """Return 'did you mean ...?' if one of `known` is close to `word`; else, if `listed`, the list of `known`."""
    names = list(known)[:MAX_KNOWN]
    lowered = {name.lower(): name for name in names}
    close = difflib.get_close_matches(word[:MAX_WORD].lower(), lowered, n=1, cutoff=0.6)
    if close:
        return f"did you mean {lowered[close[0]]!r}?"
    if not names or not listed:
        return ""
    return "known: " + ", ".join(names) if len(names) > 1 else f"the only one there is: {names[0]}"


def load_model(path: Path, model: type[Model]) -> tuple[Model, Document]:
    """Read a YAML file as a `model`. Raises ConfigError with every problem found, each with its file and line."""
    document = read_yaml(path)
    built, problems = validate(model, document.data, document)
    if built is None or problems:
        raise ConfigError(problems)
    return built, document


def validate(
    model: type[Model], data: Any, located: Located, *, below: Place = ()
) -> tuple[Model | None, list[Problem]]:
    """Build `model` from `data` and return it with all problems.

    `below` is the place of `data` in the file `located`; the place of every problem begins with it.

    If there are problems, the model is built without the wrong values (None if that is not possible), and serves only
    to find further problems.
    """
    if not isinstance(data, dict):
        return None, [_problem(located, below, f"must be a mapping of keys, not {shown(data)}")]
    problems: list[Problem] = []
    data = json.loads(json.dumps(data))  # a copy without shared parts
    removed: list[Place] = []
    for place, value in list(_not_finite(data, ())):
        unit = _in_unit(place)
        message = f"must be a finite number{f' in{unit}' if unit else ''}, not {value}"
        problems.append(_problem(located, below + place, message))
        _remove(data, place)
        removed.append(place)
    built, new_problems, wrong_places = _attempt(model, data, located, below, removed)
    problems += new_problems
    if built is None and wrong_places:
        for place in sorted(wrong_places, key=len, reverse=True):
            _remove(data, place)
        built, _, _ = _attempt(model, data, located, below)
    return built, problems


def _attempt(
    model: type[Model], data: Any, located: Located, below: Place, removed: Iterable[Place] = ()
) -> tuple[Model | None, list[Problem], list[Place]]:
    """Return the model or None, problems, and places of wrong values. What is `removed` is not called missing."""
    try:
        return model.model_validate_json(json.dumps(data), strict=True), [], []
    except ValidationError as error:
        problems: dict[str, Problem] = {}
        wrong_places: list[Place] = []
        for item in error.errors(include_url=False):
            kind = item["type"]
            place = _place(item["loc"], data, last=kind == "missing")
            if kind == "missing" and any(other[: len(place)] == place for other in removed):
                continue
            if kind != "missing":
                wrong_places.append(place)
            if kind == "extra_forbidden" and len(problems) >= MAX_HINTS:
                problem = _problem(located, below + place, "unknown key", colon=True)
            else:
                problem = _translate(model, data, item, place, located, below)
            problems.setdefault(str(problem), problem)
        return None, list(problems.values()), [p for p in wrong_places if p]


def _place(loc: tuple[int | str, ...], data: Any, *, last: bool) -> Place:
    """Return pydantic's location without the names of union branches, which are not in the data."""
    place: list[int | str] = []
    here = data
    for i, part in enumerate(loc):
        in_dict = isinstance(here, dict) and part in here
        in_list = isinstance(here, list) and isinstance(part, int) and part < len(here)
        if in_dict or in_list:
            place.append(part)
            here = here[part]
        elif last and i == len(loc) - 1:
            place.append(part)
    return tuple(place)


def _translate(model: type[BaseModel], data: Any, item: Any, place: Place, located: Located, below: Place) -> Problem:
    kind, value, limits = item["type"], item.get("input"), item.get("ctx", {})
    unit = _in_unit(place)
    if kind == "missing":
        if isinstance(place[-1], int):
            here = _get(data, place[:-1])
            return _problem(located, below + place[:-1], f"holds too few values: {shown(here)}")
        enclosing = located.where(below + place[:-1])
        return Problem(enclosing, f"{dotted(below + place)} is missing")
    if kind == "extra_forbidden":
        hint = nearest(str(place[-1]), legal_keys(model, place[:-1], _get(data, place[:-1])))
        where = located.where(below + place)
        if where.startswith(COMMAND_LINE):
            hint = re.sub(
                r"^did you mean '(.*)'", lambda m: f"did you mean {dotted((*below, *place[:-1], m[1]))!r}", hint
            )
        return _problem(located, below + place, "unknown key", hint, colon=True)
    simple = {
        "int_type": "a whole number", "int_from_float": "a whole number", "float_type": "a number",
        "bool_type": "true or false", "string_type": "text", "list_type": "a list", "tuple_type": "a list",
        "dict_type": "a mapping of keys", "model_type": "a mapping of keys", "none_required": "null",
        "model_attributes_type": "a mapping of keys", "mapping_type": "a mapping of keys",
    }  # fmt: skip
    compare = {
        "greater_than": ("above", "gt"), "greater_than_equal": ("at least", "ge"),
        "less_than": ("below", "lt"), "less_than_equal": ("at most", "le"),
    }  # fmt: skip
    hint = ""
    if kind in simple:
        message = (
            f"must be {simple[kind]}{f' in{unit}' if unit and 'number' in simple[kind] else ''}, not {shown(value)}"
        )
        if kind == "string_type" and isinstance(value, int | float):
            hint = "put it in quotes"
        if kind == "bool_type" and str(value).lower() in ("on", "off", "yes", "no"):
            hint = "write true or false"
        if kind in ("float_type", "int_type") and isinstance(value, str) and _is_number(value):
            hint = "leave the quotes away"
    elif kind in compare:
        word, key = compare[kind]
        limit = limits[key]  # a whole number in full: 9.22337e+18 is above the greatest seed
        message = f"must be {word} {limit if isinstance(limit, int) else f'{limit:g}'}{unit}, not {shown(value)}"
    elif kind in ("literal_error", "enum"):
        legal = re.findall(r"'([^']*)'", limits["expected"]) or [limits["expected"]]
        message = f"must be {_alternatives(legal)}, not {shown(value)}"
        close = nearest(str(value), legal)
        hint = close if close.startswith("did") else ""
    elif kind == "union_tag_invalid":
        legal = re.findall(r"'([^']*)'", limits["expected_tags"])
        message = f"has an unknown {limits['discriminator'].strip(chr(39))}: {limits['tag']!r}"
        hint = nearest(limits["tag"], legal)
    elif kind in ("too_short", "too_long"):
        bound, word = ("min_length", "at least") if kind == "too_short" else ("max_length", "at most")
        message = f"must hold {word} {limits[bound]} values, not {limits['actual_length']}"
    elif kind == "finite_number":
        message = f"must be a finite number{f' in{unit}' if unit else ''}, not {shown(value)}"
    elif kind in ("value_error", "assertion_error"):
        return _problem(located, below + place, str(limits["error"]), colon=True)
    else:
        message = f"{item['msg'][:1].lower()}{item['msg'][1:]}"
        return _problem(located, below + place, message, colon=True)
    return _problem(located, below + place, message, hint)


def _problem(located: Located, place: Place, message: str, hint: str = "", *, colon: bool = False) -> Problem:
    """Return 'file:line: a.b.c must be ...'; the place is left out if the origin already names it."""
    where, name = located.where(place), dotted(place)
    if name and not (where.startswith(COMMAND_LINE) and where.endswith((f" {name}", f"--{name}"))):
        message = f"{name}{':' if colon else ''} {message}"
    return Problem(where, message, hint)


def at(located: Located, place: Place, message: str, hint: str = "") -> Problem:
    """Return a problem at a place; `message` starts with the verb, as in this module."""
    return _problem(located, place, message, hint)


def shown(value: Any) -> str:
    """Return a value as text for a message, shortened."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        text = json.dumps(value)
        return text if len(text) <= 40 else f"a list of {len(value)}"
    if isinstance(value, str):
        return repr(value if len(value) <= 60 else value[:57] + "...")
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def legal_keys(model: type[BaseModel], place: Place, mapping: Any) -> list[str]:
    """Return the keys that the model's annotations allow in `mapping`, which is at `place`.

    Of a union, the models of another `kind` than that of the mapping do not count.
    """
    annotations: list[Any] = [model]
    for part in place:
        step: list[Any] = []
        for annotation in _branches(annotations):
            if isinstance(annotation, type) and issubclass(annotation, BaseModel):
                if part in annotation.model_fields:
                    step.append(annotation.model_fields[str(part)].annotation)
            elif get_origin(annotation) in (dict, list, tuple):
                # The type of the elements: V of dict[K, V], T of list[T] and of tuple[T, ...].
                step += [a for a in get_args(annotation)[-2:] if a is not ...][-1:]
        annotations = step
    models = [a for a in _branches(annotations) if isinstance(a, type) and issubclass(a, BaseModel)]
    meant = [each for each in models if _may_be(each, mapping)] or models
    return list(dict.fromkeys(key for each in meant for key in each.model_fields))


def _may_be(model: type[BaseModel], mapping: Any) -> bool:
    """Return False if a key of the mapping names another model, as `kind` does."""
    return not isinstance(mapping, dict) or all(
        get_origin(field.annotation) is not Literal or mapping.get(name, field.default) in get_args(field.annotation)
        for name, field in model.model_fields.items()
        if name == "kind"
    )


def _branches(annotations: list[Any]) -> Iterator[Any]:
    for annotation in annotations:
        origin = get_origin(annotation)
        if origin in (Union, types.UnionType):
            yield from _branches(list(get_args(annotation)))
        elif origin is not None and hasattr(annotation, "__metadata__"):
            yield from _branches([annotation.__origin__])
        else:
            yield annotation


def _in_unit(place: Place) -> str:
    names = [part for part in place if isinstance(part, str)]
    return unit_of(names[-1]) if names else ""


def _alternatives(legal: list[str]) -> str:
    quoted = [repr(word) for word in legal]
    return quoted[0] if len(quoted) == 1 else ", ".join(quoted[:-1]) + " or " + quoted[-1]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _not_finite(value: Any, place: Place) -> Iterator[tuple[Place, float]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield place, value
    elif isinstance(value, dict):
        for key, child in value.items():
            yield from _not_finite(child, (*place, key))
    elif isinstance(value, list):
        for i, child in enumerate(value):
            yield from _not_finite(child, (*place, i))


def _get(data: Any, place: Place) -> Any:
    for part in place:
        data = data[part]
    return data


def _remove(data: Any, place: Place) -> None:
    """Remove a value; for a value inside a list, remove the whole list."""
    here = data
    for part, following in zip(place, (*place[1:], None), strict=True):
        if not isinstance(here, dict) or part not in here:
            return
        if following is None or isinstance(here[part], list):
            del here[part]
            return
        here = here[part]
