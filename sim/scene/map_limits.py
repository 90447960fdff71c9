"""Limits of a map's size, checked before MuJoCo compiles it. A short MJCF file can ask for gigabytes and hours."""

from __future__ import annotations

import math

from signals.errors import Problem
from sim.scene.budget import map_limits, raise_hint
from sim.scene.map_file import Element

MAX_COPIES = 10_000  # elements made by <replicate> and <composite>; MuJoCo's time grows with their square
MAX_CELLS = 1 << 24  # of a height field
MAX_TEXELS = 1 << 26  # of a texture made by MuJoCo
MAX_USER_VALUES = 1000
MAX_MESH_PARAMETER = 100
_MOST = 10**12  # that is told of a count


def size_problems(root: Element) -> list[Problem]:
    """Return every element that asks for more than the bench compiles."""
    problems: list[Problem] = []
    total, copies = _count(root, 1, problems)
    allowed = int(map_limits().objects)
    if copies > MAX_COPIES:
        message = f"holds {copies} copies made by <replicate> and <composite>; {MAX_COPIES} are allowed"
        problems.append(Problem(root.source, message, "use fewer copies, or one mesh"))
    elif total > allowed:
        hint = f"use meshes; {raise_hint('objects', total)}"
        problems.append(Problem(root.source, f"holds {total} elements; {allowed} are allowed", hint))
    return problems


def _count(element: Element, copies: int, problems: list[Problem]) -> tuple[int, int]:
    """Return the number of elements at and below `element`, with copies, and how many of them are copies."""
    tag = element.tag
    own = copies
    if tag == "replicate":
        own, copies = 0, copies * max(1, _product(element, "count"))
    elif tag == "hfield":
        _limit(element, "nrow x ncol", _product(element, "nrow", "ncol"), MAX_CELLS, problems)
    elif tag == "texture":
        sides = 6 if element.attributes.get("type", "cube") != "2d" else 1
        _limit(element, "texels", sides * _product(element, "width", "height"), MAX_TEXELS, problems)
    elif tag == "mesh" and "builtin" in element.attributes:
        _limit(element, "params", _largest(element, "params"), MAX_MESH_PARAMETER, problems)
    elif tag == "user":
        _limit(element, "dim", _largest(element, "dim"), MAX_USER_VALUES, problems)
    elif tag == "size":
        for key in element.attributes:
            if key.startswith("nuser_"):
                _limit(element, key, _largest(element, key), MAX_USER_VALUES, problems)
    total, copied = own, own if own > 1 else 0
    if tag == "composite":
        made = copies * _product(element, "count")
        total, copied = total + made, copied + made
    for child in element.children:
        below, copied_below = _count(child, copies, problems)
        total, copied = total + below, copied + copied_below
    return total, copied


def _limit(element: Element, name: str, value: int, limit: int, problems: list[Problem]) -> None:
    if value > limit:
        message = f"<{element.tag}> {name} is {float(value):.6g}; {limit} is allowed"
        problems.append(Problem(element.where, message, "make it smaller"))


def _numbers(element: Element, key: str) -> list[int]:
    """Return the numbers of an attribute as whole numbers, limited to 0 .. `_MOST`."""
    try:
        numbers = [float(word) for word in element.attributes.get(key, "").split()]
    except ValueError:
        return []  # MuJoCo reports it
    return [int(min(max(0.0, number), _MOST)) for number in numbers]


def _product(element: Element, *keys: str) -> int:
    """Return the product of all numbers of these attributes; missing ones count as 1."""
    return min(math.prod(number for key in keys for number in _numbers(element, key)), _MOST)


def _largest(element: Element, key: str) -> int:
    return max(_numbers(element, key), default=0)
