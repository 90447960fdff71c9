"""Settings merged from several sources, with the origin of each value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from signals.documents.document import Document, Place
from signals.documents.yaml_lines import MAX_DEPTH, dotted, parse_yaml
from signals.errors import ConfigError, Problem

SET = "--set "

DEFAULTS = "defaults"  # origin of what no file and no option sets


@dataclass
class Settings:
    """Merged plain data. `origins`: place of a value -> source that set it last: 'hil.yaml:12', '--set seed'."""

    data: dict[str, Any] = field(default_factory=dict)
    origins: dict[Place, str] = field(default_factory=dict)

    def where(self, place: Place) -> str:
        """Return the origin of a place, or of the nearest mapping or list that contains it."""
        for length in range(len(place), -1, -1):
            origin = self.origins.get(place[:length])
            if origin is not None:
                return origin
        return DEFAULTS

    def merge(self, document: Document | SettingsPart) -> None:
        """Merge a document over the settings: mappings key by key; any other value is replaced whole."""
        self._merge((), document.data, document)

    def set(self, place: Place, value: Any, origin: str) -> None:
        """Set one value, creating the mappings that lead to it."""
        nested: Any = value
        for key in reversed(place):
            nested = {key: nested}
        self._merge((), nested, _SingleOrigin(origin, place))

    def _merge(self, place: Place, value: Any, document: Source) -> None:
        present = self._value_at(place)
        if isinstance(value, dict) and isinstance(present, dict):
            if document.covers(place):
                self.origins[place] = document.where(place)
            for key, child in value.items():
                self._merge((*place, key), child, document)
            return
        if place:
            if place in self.origins:
                self._forget(place)
            parent = self._value_at(place[:-1])
            assert isinstance(parent, dict)
            if isinstance(value, dict):
                parent[place[-1]] = {}
                self._merge(place, value, document)
                self.origins.setdefault(place, document.where(place))
                return
            parent[place[-1]] = value
        self._mark(place, value, document)

    def _mark(self, place: Place, value: Any, document: Source) -> None:
        self.origins[place] = document.where(place)
        children: Any = ()
        if isinstance(value, dict):
            children = value.items()
        elif isinstance(value, list):
            children = enumerate(value)
        for key, child in children:
            self._mark((*place, key), child, document)

    def _value_at(self, place: Place) -> Any:
        value: Any = self.data
        for key in place:
            if not isinstance(value, dict) or key not in value:
                return None
            value = value[key]
        return value

    def _forget(self, place: Place) -> None:
        for other in [p for p in self.origins if p[: len(place)] == place]:
            del self.origins[other]


@dataclass(frozen=True)
class _SingleOrigin:
    """Source of one value, at `target`, in place of a `Document`: all places have the origin `origin`."""

    origin: str
    target: Place

    def where(self, place: Place) -> str:  # noqa: ARG002
        return self.origin

    def covers(self, place: Place) -> bool:
        return place[: len(self.target)] == self.target


@dataclass(frozen=True)
class SettingsPart:
    """The mapping at `place` of merged settings, as a layer to merge over others."""

    settings: Settings
    place: Place

    @property
    def data(self) -> dict[str, Any]:
        value: dict[str, Any] = self.settings._value_at(self.place) or {}
        return value

    def where(self, place: Place) -> str:
        return self.settings.where(self.place + place)

    def covers(self, place: Place) -> bool:
        return self.place + place in self.settings.origins


Source = Document | SettingsPart | _SingleOrigin


def parse_setting(text: str) -> tuple[Place, Any, str]:
    """Parse 'autopilot.port=/dev/ttyACM0' to (place, value, origin), the value as YAML. Raises ConfigError."""
    key, equals, value_text = text.partition("=")
    key = key.strip()
    if not equals:
        raise ConfigError.at(f"{SET}{text}", "has no value", f"write --set {key or 'KEY'}=VALUE")
    parts = key.split(".")
    if not all(part.strip() for part in parts):
        raise ConfigError.at(f"{SET}{text}", "has an empty key", "write --set section.key=VALUE")
    if len(parts) > MAX_DEPTH:
        raise ConfigError.at(f"{SET}{key[:40]}...", f"is nested too deeply: more than {MAX_DEPTH} levels")
    origin = f"{SET}{key}"
    # The value is parsed alone, because "KEY: VALUE" could be a nested mapping or an alias. An empty value is null.
    try:
        document = parse_yaml(value_text, origin)
    except ConfigError as error:
        raise ConfigError([Problem(origin, problem.message, problem.hint) for problem in error.problems]) from None
    value = document.data if value_text.strip() else None
    return tuple(parts), value, origin


def merge_options(settings: Settings, texts: Sequence[str]) -> list[Problem]:
    """Merge the texts of `--set` over the settings, in order. Returns the problems of texts that cannot be read."""
    problems: list[Problem] = []
    for text in texts:
        try:
            place, value, origin = parse_setting(text)
        except ConfigError as error:
            problems += error.problems
            continue
        if len(place) > 2 and place[0] == "vehicles" and isinstance(settings._value_at(place[:2]), str):
            continue  # of a vehicle with a file of its own: merged over that file
        for length in range(1, len(place)):
            value_there = settings._value_at(place[:length])
            if value_there is not None and not isinstance(value_there, dict):
                hint = f"{dotted(place[:length])} is {value_there!r}"
                problems.append(Problem(origin, f"{dotted(place[:length])} has no keys below it", hint))
                break
        else:
            settings.set(place, value, origin)
    return problems
