"""Voxels of the scene with its objects; vehicles are left out.

A cell is occupied where one of the three lines through its middle, along the axes, meets a surface or is inside an
object: between the first and the second hit of the same geom, the third and the fourth, and so on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.world.objects.line_of_sight import cast
from signals.samples import Vec3
from sim.frame.geometry import FrameGeometry
from sim.frame.source import VEHICLE_CLASS, SharedFrames

_STEP_M = 1e-4  # past a hit
_MOST_HITS = 200  # along one line
_LINES_AT_ONCE = 1 << 17  # a flat grid has millions, of some hundred bytes each while they are cast


def occupied(frames: SharedFrames, middle_W: Vec3, counts: tuple[int, int, int], edge_m: float) -> NDArray[np.bool_]:
    """Return the cells (east, north, up) about `middle_W` that are occupied; their middles are multiples of the edge.

    Cell i of n along an axis has its middle at (i - n // 2) edges from `middle_W`, as in AirSim.
    """
    geometry = frames.geometry
    geometry.pose_within()
    world = frames.world
    is_vehicle = world.geom_class == world.class_names.index(VEHICLE_CLASS)
    cells = np.zeros(counts, bool)
    middles = [middle_W[a] + edge_m * (np.arange(n) - n // 2) for a, n in enumerate(counts)]
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        begin = middles[axis][0] - 0.5 * edge_m
        length_m = counts[axis] * edge_m
        lines = np.moveaxis(cells, axis, 2).reshape(-1, counts[axis])  # a copy
        for start in range(0, len(lines), _LINES_AT_ONCE):
            numbers = np.arange(start, min(start + _LINES_AT_ONCE, len(lines)))
            origins = np.empty((len(numbers), 3))
            origins[:, a], origins[:, b] = middles[a][numbers // counts[b]], middles[b][numbers % counts[b]]
            origins[:, axis] = begin
            for row, geom, near, far in _spans(geometry, origins, axis, length_m):
                if is_vehicle[geom]:
                    continue
                first = min(max(int(near / edge_m), 0), counts[axis] - 1)
                last = min(max(int(far / edge_m), 0), counts[axis] - 1)
                lines[start + row, first : last + 1] = True
        shape = (counts[a], counts[b], counts[axis])
        cells |= np.moveaxis(lines.reshape(shape), 2, axis)
    return cells


def binvox(cells: NDArray[np.bool_], size_m: Vec3) -> bytes:
    """Return a voxel grid (north, east, up) as a binvox file, with the header and the order of cells of AirSim."""
    x, y, z = cells.shape
    header = (
        f"#binvox 1\ndim {x} {z} {y}\n"
        f"translate {-0.5 * size_m[0]:g} {-0.5 * size_m[1]:g} {-0.5 * size_m[2]:g}\n"
        f"scale {1.0 / size_m[0]:g}\ndata\n"
    )
    # Cell (i, j, k) is number i + x (k + z j).
    values = cells.transpose(1, 2, 0).ravel().astype(np.uint8)
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    runs = bytearray()
    for value, length in zip(values[starts].tolist(), lengths.tolist(), strict=True):
        full, rest = divmod(length, 255)
        runs += bytes((value, 255)) * full
        if rest:
            runs += bytes((value, rest))
    return header.encode() + bytes(runs)


def _spans(
    geometry: FrameGeometry, origins: NDArray, axis: int, length_m: float
) -> list[tuple[int, int, float, float]]:
    """Return (line, geom, from, to) [m] of what each line along an axis meets; a single hit spans nothing."""
    direction = np.zeros(3)
    direction[axis] = 1.0
    rows, travelled = np.arange(len(origins)), np.zeros(len(origins))
    entered: dict[tuple[int, int], float] = {}
    spans: list[tuple[int, int, float, float]] = []
    for _ in range(_MOST_HITS):
        if len(rows) == 0:
            break
        starts = origins[rows] + travelled[:, None] * direction
        directions = np.tile(direction, (len(rows), 1))
        range_m, geoms = cast(geometry, starts, directions, float((length_m - travelled).max()))
        hit = range_m <= length_m - travelled
        rows, at, geoms = rows[hit], (travelled + range_m)[hit], geoms[hit]
        for row, geom, where in zip(rows.tolist(), geoms.tolist(), at.tolist(), strict=True):
            begin = entered.pop((row, geom), None)
            if begin is None:
                entered[row, geom] = where
            else:
                spans.append((row, geom, begin, where))
        travelled = at + _STEP_M
        kept = travelled < length_m
        rows, travelled = rows[kept], travelled[kept]
    return spans + [(row, geom, where, where) for (row, geom), where in entered.items()]
