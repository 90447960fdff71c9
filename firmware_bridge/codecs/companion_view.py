"""A client's view for display: its map, its plan, its particles. Pure functions.

A `view` is a message of its own, sent after the answer to a frame, a few times a second of simulated time at most. It
has no effect on the flight: it is not part of an answer, of the trace or of the digest. So it may be larger than other
headers, within the limit of a client's message (128 KiB):

    {k: "view", frame, t_ns, p_W: [x, y, z], yaw_rad, goal_W: [x, y] or null, plan_W, particles_W: bytes,
     map: null, or {rows, columns, cell_m, origin_W: [x, y], cells: bytes}}

`plan_W`, `particles_W`: pairs of little-endian float32, x and y. `cells`: one byte per cell, zlib; row 0 is the
southernmost, and the values are those of `CELLS`. `origin_W` is the corner of cell (0, 0).
"""

from __future__ import annotations

import zlib
from typing import Any, NamedTuple

import numpy as np

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.untrusted import number, whole

UNKNOWN, FREE, NEAR, OCCUPIED = CELLS = (0, 1, 2, 3)  # near: too close to an obstacle to fly there
MAX_SIDE = 256  # cells of a map
MAX_CELL_BYTES = 32 << 10  # compressed: two bits per cell, and zlib's overhead
MAX_POINTS = 256  # of a plan, of the particles
_POINT_BYTES = 8
_LARGEST_M = 1e7
_MAX_INT = 2**62


class MapView(NamedTuple):
    """An occupancy map; `cells` as received, validated."""

    rows: int
    columns: int
    cell_m: float
    origin_W: tuple[float, float]
    cells: bytes  # zlib

    def unpacked(self) -> bytes:
        """Return one byte per cell, row by row."""
        return zlib.decompress(self.cells)


class View(NamedTuple):
    """The view of a client after a frame."""

    frame: int
    t_ns: int  # simulated, of that frame
    p_W: tuple[float, float, float]  # its estimate
    yaw_rad: float
    goal_W: tuple[float, float] | None
    plan_W: bytes
    particles_W: bytes
    map: MapView | None


def view_from_map(m: dict[str, Any]) -> View:
    """Validate and convert the map of a message. CodecError names the wrong entry."""
    x, y, z = _numbers(m, "p_W", 3)
    goal = None if m.get("goal_W") is None else _numbers(m, "goal_W", 2)
    return View(
        _whole(m, "frame", 0, _MAX_INT),
        _whole(m, "t_ns", 0, _MAX_INT),
        (x, y, z),
        _number(m, "yaw_rad"),
        None if goal is None else (goal[0], goal[1]),
        _points(m, "plan_W"),
        _points(m, "particles_W"),
        None if m.get("map") is None else _map(m["map"]),
    )


def _map(m: object) -> MapView:
    if type(m) is not dict:
        raise CodecError("view.map: expected a map")
    rows, columns = _whole(m, "rows", 1, MAX_SIDE), _whole(m, "columns", 1, MAX_SIDE)
    cell_m = _number(m, "cell_m")
    if not 1e-3 <= cell_m <= 1e3:
        raise CodecError(f"view.cell_m: {cell_m!r} is not within 0.001..1000")
    x, y = _numbers(m, "origin_W", 2)
    cells = m.get("cells")
    if type(cells) is not bytes or len(cells) > MAX_CELL_BYTES:
        raise CodecError(f"view.cells: expected at most {MAX_CELL_BYTES} bytes")
    # Decompression stops at the announced size.
    unpacker = zlib.decompressobj()
    try:
        plain = unpacker.decompress(cells, rows * columns + 1)
    except zlib.error as error:
        raise CodecError(f"view.cells: {error}") from error
    if len(plain) != rows * columns or not unpacker.eof:
        raise CodecError(f"view.cells: {rows * columns} cells expected, {len(plain)} or more came")
    if int(np.frombuffer(plain, np.uint8).max()) > max(CELLS):
        raise CodecError(f"view.cells: a value is above {max(CELLS)}")
    return MapView(rows, columns, cell_m, (x, y), cells)


def _points(m: dict[str, Any], key: str) -> bytes:
    data = m.get(key)
    if type(data) is not bytes or len(data) % _POINT_BYTES or len(data) > _POINT_BYTES * MAX_POINTS:
        raise CodecError(f"view.{key}: at most {MAX_POINTS} pairs of float32 expected")
    values = np.frombuffer(data, "<f4")
    if not bool((np.abs(values) <= _LARGEST_M).all()):  # false for NaN, too
        raise CodecError(f"view.{key}: a number is not finite, or too large")
    return data


def _whole(m: dict[str, Any], key: str, low: int, high: int) -> int:
    return whole(f"view.{key}", m.get(key), low, high)


def _number(m: dict[str, Any], key: str) -> float:
    return number(f"view.{key}", m.get(key), _LARGEST_M)


def _numbers(m: dict[str, Any], key: str, count: int) -> list[float]:
    values = m.get(key)
    if type(values) is not list or len(values) != count:
        raise CodecError(f"view.{key}: {count} numbers expected")
    return [number(f"view.{key}", value, _LARGEST_M) for value in values]
