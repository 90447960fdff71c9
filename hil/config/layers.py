"""Settings from several places, laid over one another, each value remembering where it came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hil.signals.documents.document import Document, Place
from hil.signals.documents.yaml_lines import MAX_DEPTH, dotted, parse_yaml
from hil.signals.errors import ConfigError, Problem

SET = "--set "


@dataclass
class Settings:
    """Merged plain data; `origins` says where each place was last written ('hil.yaml:12', '--set seed')."""

    data: dict[str, Any] = field(default_factory=dict)
    origins: dict[Place, str] = field(default_factory=dict)

    def where(self, place: Place) -> str:
        """Origin of a place, or of the nearest thing that encloses it."""
        for length in range(len(place), -1, -1):
            origin = self.origins.get(place[:length])
            if origin is not None:
                return origin
        return "defaults"

    def lay(self, document: Document) -> None:
        """Lay a document over what is here: mappings merge key by key, everything else replaces."""
        self._lay((), document.data, document)

    def put(self, place: Place, value: Any, origin: str) -> None:
        """Lay one value over what is here, making the mappings that lead to it."""
        nested: Any = value
        for part in reversed(place):
            nested = {part: nested}
        lines = _Everywhere(origin, place)
        self._lay((), nested, lines)

    def _lay(self, place: Place, value: Any, document: Document | _Everywhere) -> None:
        here = self._at(place)
        if isinstance(value, dict) and isinstance(here, dict):
            if document.marks(place):
                self.origins[place] = document.where(place)
            for key, child in value.items():
                self._lay((*place, key), child, document)
            return
        if place:
            if place in self.origins:
                self._forget(place)
            parent = self._at(place[:-1])
            assert isinstance(parent, dict)
            if isinstance(value, dict):
                parent[place[-1]] = {}
                self._lay(place, value, document)
                self.origins.setdefault(place, document.where(place))
                return
            parent[place[-1]] = value
        self._mark(place, value, document)

    def _mark(self, place: Place, value: Any, document: Document | _Everywhere) -> None:
        self.origins[place] = document.where(place)
        children: Any = ()
        if isinstance(value, dict):
            children = value.items()
        elif isinstance(value, list):
            children = enumerate(value)
        for key, child in children:
            self._mark((*place, key), child, document)

    def _at(self, place: Place) -> Any:
        here: Any = self.data
        for part in place:
            if not isinstance(here, dict) or part not in here:
                return None
            here = here[part]
        return here

    def _forget(self, place: Place) -> None:
        for other in [p for p in self.origins if p[: len(place)] == place]:
            del self.origins[other]


@dataclass(frozen=True)
class _Everywhere:
    """Stands in for a document whose every place has the same origin; only `target` and below are marked."""

    origin: str
    target: Place

    def where(self, place: Place) -> str:  # noqa: ARG002
        return self.origin

    def marks(self, place: Place) -> bool:
        return place[: len(self.target)] == self.target


def parse_setting(text: str) -> tuple[Place, Any, str]:
    """'autopilot.port=/dev/ttyACM0' -> (place, value, origin); the value is read as YAML. Raises ConfigError."""
    key, equals, value_text = text.partition("=")
    key = key.strip()
    if not equals:
        message = "has no value"
        raise ConfigError([Problem(f"{SET}{text}", message, f"write --set {key or 'KEY'}=VALUE")])
    parts = key.split(".")
    if not all(part.strip() for part in parts):
        raise ConfigError([Problem(f"{SET}{text}", "has an empty key", "write --set section.key=VALUE")])
    if len(parts) > MAX_DEPTH:
        raise ConfigError([Problem(f"{SET}{key[:40]}...", f"is nested too deeply: more than {MAX_DEPTH} levels")])
    origin = f"{SET}{key}"
    # "KEY: *x" must not be read as a mapping: the value stands alone, and "" means null.
    try:
        document = parse_yaml(value_text, origin)
    except ConfigError as error:
        raise ConfigError([Problem(origin, problem.message, problem.hint) for problem in error.problems]) from None
    value = document.data if value_text.strip() else None
    return tuple(parts), value, origin


def lay_settings(settings: Settings, texts: Sequence[str]) -> list[Problem]:
    """Lay every `--set` over `settings`, in order. Returns the problems of those that cannot be read."""
    problems: list[Problem] = []
    for text in texts:
        try:
            place, value, origin = parse_setting(text)
        except ConfigError as error:
            problems += error.problems
            continue
        for length in range(1, len(place)):
            here = settings._at(place[:length])
            if here is not None and not isinstance(here, dict):
                hint = f"{dotted(place[:length])} is {here!r}"
                problems.append(Problem(origin, f"{dotted(place[:length])} has no keys below it", hint))
                break
        else:
            settings.put(place, value, origin)
    return problems
