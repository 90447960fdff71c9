"""Types of the arguments of RPC methods: each checks a decoded MessagePack value and returns it in Python's form.

As in AirSim, an integer may stand for a number but not a number for an integer, a struct is a map whose missing
members keep their defaults and whose unknown members are ignored, and structs of clients before 2018 may be arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from reprlib import Repr
from typing import Any, NamedTuple

_MOST_FLOAT32 = 3.4028234663852886e38


class ArgumentError(Exception):
    """Value of an argument that its method cannot use; the text says what was expected and what came."""


class Type(NamedTuple):
    """Type of an argument: its name in messages, and the function that checks and converts a value."""

    name: str
    convert: Callable[[Any], Any]


_REPR = Repr()  # of values that may be large or deep
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60


def shown(value: Any) -> str:
    """Return a short text of a value for a message."""
    text = _REPR.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _refused(expected: str, value: Any) -> ArgumentError:
    return ArgumentError(f"expected {expected}, got {shown(value)}")


def _boolean(value: Any) -> bool:
    if value is True or value is False:
        return value
    raise _refused("true or false", value)


def _whole(low: int, high: int) -> Callable[[Any], int]:
    def convert(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise _refused("an integer", value)
        if not low <= value <= high:
            raise _refused(f"an integer from {low} to {high}", value)
        return value

    return convert


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _refused("a number", value)
    return float(value)


def _finite(value: Any) -> float:
    x = _number(value)
    if not -_MOST_FLOAT32 <= x <= _MOST_FLOAT32:
        raise _refused("a finite number", value)
    return x


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "surrogateescape")
    if isinstance(value, str):
        return value
    raise _refused("a text", value)


def _name(value: Any) -> str:
    """Return a name; clients of 2018 give cameras by number."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else _text(value)


def struct(name: str, make: Callable[..., Any], **members: Type) -> Type:
    """Return the type of a struct that `make` builds from keyword arguments; a missing member is not passed to it."""

    def convert(value: Any) -> Any:
        if isinstance(value, list | tuple) and len(value) == len(members):
            value = dict(zip(members, value, strict=True))
        if not isinstance(value, Mapping):
            raise _refused(f"a {name} (a map of {', '.join(members)})", value)
        found = {}
        for key, kind in members.items():
            if key in value:
                try:
                    found[key] = kind.convert(value[key])
                except ArgumentError as error:
                    raise ArgumentError(f"{key}: {error}") from None
        return make(**found)

    return Type(name, convert)


def list_of(kind: Type, *, most: int = 1_000_000, exactly: int | None = None) -> Type:
    """Return the type of an array of at most `most`, or of exactly `exactly`, elements of one type."""
    name = f"an array of {kind.name}" if exactly is None else f"an array of {exactly} {kind.name}"

    def convert(value: Any) -> list[Any]:
        if not isinstance(value, list | tuple) or (exactly is not None and len(value) != exactly):
            raise _refused(name, value)
        if len(value) > most:
            raise ArgumentError(f"expected at most {most} elements, got {len(value)}")
        items = []
        for index, item in enumerate(value):
            try:
                items.append(kind.convert(item))
            except ArgumentError as error:
                raise ArgumentError(f"element {index}: {error}") from None
        return items

    return Type(name, convert)


def one_of(name: str, *values: int) -> Type:
    """Return the type of an enumeration: one of these integers."""

    def convert(value: Any) -> int:
        if isinstance(value, bool) or value not in values or not isinstance(value, int):
            raise _refused(f"{name} ({', '.join(map(str, values))})", value)
        return value

    return Type(name, convert)


def either(name: str, *kinds: Type) -> Type:
    """Return the type of a value that has any of these types; the first that fits converts it."""

    def convert(value: Any) -> Any:
        for kind in kinds:
            try:
                return kind.convert(value)
            except ArgumentError:
                continue
        raise _refused(name, value)

    return Type(name, convert)


BOOL = Type("boolean", _boolean)
INT = Type("integer", _whole(-(1 << 31), (1 << 31) - 1))
COUNT = Type("count", _whole(0, (1 << 32) - 1))
TIME = Type("time", _whole(0, (1 << 64) - 1))  # nanoseconds
FLOAT = Type("number", _finite)
FLOAT_OR_NAN = Type("number", _number)  # NaN and infinity too: the method gives them a meaning
TEXT = Type("text", _text)
NAME = Type("name", _name)


class Vector(NamedTuple):
    """AirSim's Vector3r: north, east, down, or along a vehicle's front, right and bottom."""

    x_val: float = 0.0
    y_val: float = 0.0
    z_val: float = 0.0

    @property
    def is_finite(self) -> bool:
        """False if any component is NaN or infinite."""
        return all(map(math.isfinite, self))


class Quaternion(NamedTuple):
    """AirSim's Quaternionr."""

    w_val: float = 1.0
    x_val: float = 0.0
    y_val: float = 0.0
    z_val: float = 0.0


class Pose(NamedTuple):
    """AirSim's Pose: NED position and attitude FRD->NED."""

    position: Vector = Vector()
    orientation: Quaternion = Quaternion()


_XYZ = ("x_val", "y_val", "z_val")
VECTOR = struct("Vector3r", Vector, **dict.fromkeys(_XYZ, FLOAT))
VECTOR_OR_NAN = struct("Vector3r", Vector, **dict.fromkeys(_XYZ, FLOAT_OR_NAN))
QUATERNION = struct("Quaternionr", Quaternion, **dict.fromkeys(("w_val", *_XYZ), FLOAT))
QUATERNION_OR_NAN = struct("Quaternionr", Quaternion, **dict.fromkeys(("w_val", *_XYZ), FLOAT_OR_NAN))
POSE = struct("Pose", Pose, position=VECTOR, orientation=QUATERNION)
POSE_OR_NAN = struct("Pose", Pose, position=VECTOR_OR_NAN, orientation=QUATERNION_OR_NAN)
COLOUR = list_of(FLOAT, most=4)
