"""Budget of one map: what its files may make the bench allocate, draw and compute, all files of the map together.

A file of a few kilobytes can ask for gigabytes and hours: an accessor of zeros, a picture of one colour, an element
that repeats itself. A reader therefore charges the budget before it allocates. The limits are far above what maps of a
district need, and a variable of the environment raises each one: not the map's own file, which may come from anybody.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field

from signals.errors import ConfigError

_UNITS = {  # limit -> variable, size of its unit, and what it counts
    "memory_bytes": ("HIL_MAP_MEMORY_GB", 1e9, "GB of memory"),
    "cpu_s": ("HIL_MAP_CPU_S", 1.0, "s of processor time"),
    "triangles": ("HIL_MAP_MILLION_TRIANGLES", 1e6, "million triangles"),
    "objects": ("HIL_MAP_OBJECTS", 1.0, "objects"),
    "pixels": ("HIL_MAP_MEGAPIXELS", 1e6, "megapixels of pictures"),
}


_AT_ONCE = 8.0  # share of the memory, as a divisor, that is needed for a moment only


def _default_memory_bytes() -> float:
    """Return 8 GB, or half of the machine's memory if that is less."""
    try:
        machine_bytes = float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError):
        return 8e9
    return min(8e9, 0.5 * machine_bytes)


@dataclass(frozen=True)
class MapLimits:
    """Limits of one map."""

    memory_bytes: float = field(default_factory=_default_memory_bytes)
    cpu_s: float = 300.0  # reading, making and compiling the map, without its use in flight
    triangles: float = 5e6
    objects: float = 200_000  # elements of an MJCF file; geoms of an imported map
    pixels: float = 2e9  # after decoding

    def told(self, name: str) -> str:
        """Return a limit for a message, such as '4 GB of memory'."""
        _, unit, text = _UNITS[name]
        return f"{getattr(self, name) / unit:,.6g} {text}"


def map_limits() -> MapLimits:
    """Return the limits that the environment states, else the default ones. Raises ConfigError."""
    values = {}
    for name, (variable, unit, _) in _UNITS.items():
        text = os.environ.get(variable)
        if text is None:
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < 1e9:
            raise ConfigError.at(f"${variable}", f"must be a number above 0, not {text[:40]!r}")
        values[name] = value * unit
    return MapLimits(**values)


def raise_hint(name: str, needed: float = 0.0) -> str:
    """Return how to raise a limit; `needed`: at least to this value, if it is known."""
    variable, unit, _ = _UNITS[name]
    value = f"={math.ceil(needed / unit)}" if 0.0 < needed / unit < 1e6 else ""
    return f"make it smaller, or raise the limit: environment variable {variable}{value}"


class Budget:
    """Rest of the limits of one map. `source`: the file that errors name."""

    def __init__(self, source: str, limits: MapLimits | None = None) -> None:
        self.source = source
        self.limits = limits or map_limits()
        self._spent = dict.fromkeys(_UNITS, 0.0)

    def memory(self, n_bytes: float, where: str) -> None:
        """Charge memory that stays allocated until the map is made. Raises ConfigError, as the others do."""
        self._charge("memory_bytes", n_bytes, where)

    def triangles(self, count: int, where: str) -> None:
        self._charge("triangles", count, where)

    def objects(self, count: int, where: str) -> None:
        self._charge("objects", count, where)

    def pixels(self, count: int, where: str) -> None:
        self._charge("pixels", count, where)

    def seconds(self, cpu_s: float, where: str) -> None:
        self._charge("cpu_s", cpu_s, where)

    @property
    def left_s(self) -> float:
        """Processor time that is left [s]."""
        return self.limits.cpu_s - self._spent["cpu_s"]

    def at_once(self, n_bytes: float, where: str) -> None:
        """Check memory that is needed for a moment only, or for one thing: at most an eighth of the limit."""
        if _AT_ONCE * n_bytes > self.limits.memory_bytes:
            allowed = f"an eighth of the {self.limits.told('memory_bytes')} of a whole map is allowed"
            message = f"needs {n_bytes / 1e9:,.3g} GB of memory at once for {where}; {allowed}"
            raise ConfigError.at(self.source, message, raise_hint("memory_bytes", _AT_ONCE * n_bytes))

    def exceeded(self, name: str, where: str, needed: float = 0.0) -> ConfigError:
        """Return the error for a limit; `needed`: what the map asks for, if it is known."""
        _, unit, text = _UNITS[name]
        told = self.limits.told(name)
        if needed:
            message = f"needs {needed / unit:,.4g} {text} with {where}; {told} are allowed for a whole map"
        else:
            message = f"needs more than {told} for {where}; that is the limit of a whole map"
        return ConfigError.at(self.source, message, raise_hint(name, needed))

    def _charge(self, name: str, amount: float, where: str) -> None:
        self._spent[name] += amount
        if self._spent[name] > getattr(self.limits, name):
            raise self.exceeded(name, where, self._spent[name])
