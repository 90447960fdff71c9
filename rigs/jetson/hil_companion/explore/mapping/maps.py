"""The maps of all particles: an occupancy grid at the flight's height, and a layer of hits on upright surfaces.

The grid holds log-odds in steps of 1/20, from -2 (free: three hits make it occupied) to 3.5 (occupied: ten misses undo
it). A hit makes a cell occupied; a beam that passes at the flight's height makes it a little freer, so that a person
who walks away disappears from the map.

The other layer is for matching: for each cell with hits on an upright surface, the mean position of the hits within the
cell and their number. Cell centres alone would move every wall by up to half a cell, and the particle with it.

Both layers are stored in tiles of 32 x 32 cells in one pool, with copy on write: each particle has a table of tile
numbers, resampling copies only the tables, and a tile held by several particles is copied before one of them writes it.
Tile 0 means unknown, is never written, and fills every new table. Tiles in no table are reused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hil_companion.explore.mapping.scan import Scan

OCCUPIED, FREE = 0.8, -0.5  # log-odds above which a cell is occupied, and below which it is free
STEP = 0.05  # log-odds
_HIT, _MISS = 24, -6  # change of a cell by a hit and by a beam that passes, in steps
_LOWEST, _HIGHEST = -40, 70  # limits of a cell, in steps
_UNITS = 4096  # resolution of a position within a cell
_MAX_COUNT = 48  # largest weight of a mean, so that later hits still change it
_BINS = 720  # azimuths of a turn
SIDE = 32  # cells along each side of a tile
CELLS = SIDE * SIDE
SHIFT, LOW_BITS = 5, 31  # index of a cell -> its tile and its index within the tile, for tiles of 32


@dataclass(frozen=True)
class GridView:
    """A copy of one particle's grid. Rows go north (y), columns east (x)."""

    log_odds: np.ndarray  # (H, W) float32
    origin_W: tuple[float, float]  # x, y of the corner of cell (0, 0)
    cell_m: float
    version: int  # rises with every change of the maps

    @property
    def occupied(self) -> np.ndarray:
        return self.log_odds > OCCUPIED

    @property
    def free(self) -> np.ndarray:
        return self.log_odds < FREE

    @property
    def unknown(self) -> np.ndarray:
        return (self.log_odds <= OCCUPIED) & (self.log_odds >= FREE)

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Return row and column of a position, which may lie outside."""
        return (
            int(np.floor((y - self.origin_W[1]) / self.cell_m)),
            int(np.floor((x - self.origin_W[0]) / self.cell_m)),
        )

    def centres(self, mask: np.ndarray) -> np.ndarray:
        """Return x, y (n, 2) of the centres of a mask's cells."""
        rows, columns = np.nonzero(mask)
        xy: Any = np.stack([columns, rows], axis=-1)
        return (xy + 0.5) * self.cell_m + np.array(self.origin_W)


class Tiles:
    """One layer of all particles. `dtype`: type of a cell, 0 is unknown; `across`: tiles along each side."""

    def __init__(self, particles: int, across: int, dtype: type) -> None:
        self.across = across
        self.table = np.zeros((particles, across * across), np.int32)
        self.pool = np.zeros((64, CELLS), dtype)

    @property
    def bytes(self) -> int:
        """Return the size of the pool."""
        return int(self.pool.nbytes)

    def writable(self, particles: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the tile numbers of distinct pairs (particle, place), copied first if another particle holds them."""
        holders = np.bincount(self.table.reshape(-1), minlength=len(self.pool))
        holders[0] = 2  # the unknown tile counts as shared
        at = self.table[particles, places]
        shared = np.flatnonzero(holders[at] > 1)
        if len(shared):
            # All writers of a shared tile get copies; the original is reused later if no other particle holds it.
            free = np.flatnonzero(holders == 0)
            if len(free) < len(shared):
                more = max(len(shared) - len(free), len(self.pool) // 2)
                free = np.concatenate([free, np.arange(len(self.pool), len(self.pool) + more)])
                self.pool = np.concatenate([self.pool, np.zeros((more, CELLS), self.pool.dtype)])
            fresh = free[: len(shared)]
            self.pool[fresh] = self.pool[at[shared]]
            self.table[particles[shared], places[shared]] = fresh
            at = self.table[particles, places]
        return at

    def resample(self, ancestors: np.ndarray) -> None:
        """Give particle i the tiles of particle `ancestors[i]`."""
        self.table = self.table[ancestors]

    def assembled(self, particle: int) -> tuple[np.ndarray, int, int]:
        """Return one particle's cells in the smallest rectangle of known tiles, and its first row and column."""
        table = self.table[particle].reshape(self.across, self.across)
        rows, columns = np.flatnonzero(table.any(axis=1)), np.flatnonzero(table.any(axis=0))
        if not len(rows):
            return np.zeros((0, 0), self.pool.dtype), 0, 0
        part = table[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        cells = self.pool[part].reshape(*part.shape, SIDE, SIDE)
        cells = cells.transpose(0, 2, 1, 3).reshape(part.shape[0] * SIDE, part.shape[1] * SIDE)
        return cells, int(rows[0]) * SIDE, int(columns[0]) * SIDE


class Maps:
    """Maps of all particles over a square of `area_m` about `centre_W`; beams are used up to `range_m`."""

    def __init__(
        self, particles: int, cell_m: float, area_m: float, range_m: float, centre_W: tuple[float, float]
    ) -> None:
        self.cell_m = cell_m
        across = max(1, math.ceil(area_m / cell_m / SIDE))
        self.side = across * SIDE
        half = 0.5 * self.side * cell_m
        self.origin_W = np.array([centre_W[0] - half, centre_W[1] - half])
        self.grid = Tiles(particles, across, np.int8)
        self.hits = Tiles(particles, across, np.uint32)
        self.version = 0
        # Azimuth and distance of all cells within the range plus one tile about a particle's cell.
        self._reach_cells = math.ceil(range_m / cell_m)
        n = self._reach_cells + SIDE
        dy, dx = np.mgrid[-n : n + 1, -n : n + 1]
        self._middle = n
        self._distance = np.minimum(np.hypot(dx, dy) * 16.0, 65535.0).astype(np.uint16)  # sixteenths of a cell
        self._azimuth = (np.floor((np.arctan2(dy, dx) + math.pi) * (_BINS / (2.0 * math.pi))) % _BINS).astype(np.uint16)

    def cells(self, xy: np.ndarray) -> np.ndarray:
        """Return fractional columns and rows (..., 2) of positions (..., 2) in W."""
        return (xy - self.origin_W) * (1.0 / self.cell_m)

    def insert(self, particles: np.ndarray, pose: np.ndarray, scan: Scan) -> None:
        """Add a scan to the maps of some particles, at their poses (n, 3): x, y, yaw."""
        if not len(particles):
            return
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        self._insert_hits(particles, _transformed(scan.all_xy, pose, c, s))
        band = self.cells(_transformed(scan.band_xy, pose, c, s))
        centres = np.floor(self.cells(pose[:, :2])).astype(int)
        turns = np.rint(pose[:, 2] * (_BINS / (2.0 * math.pi))).astype(int)
        who, places, changes = [], [], []
        for k, particle in enumerate(particles):
            passed = self._missed(centres[k], int(turns[k]), scan.reach_m)
            if passed is not None:
                at, change = self._with_hits(*passed, band[k])
                who.append(np.full(len(at), particle))
                places.append(at)
                changes.append(change)
        if who:
            tiles = self.grid.writable(np.concatenate(who), np.concatenate(places))
            total = np.add(self.grid.pool[tiles], np.concatenate(changes), dtype=np.int16)
            self.grid.pool[tiles] = np.clip(total, _LOWEST, _HIGHEST, out=total)
        self.version += 1

    def resample(self, ancestors: np.ndarray) -> None:
        """Give particle i the maps of particle `ancestors[i]`."""
        self.grid.resample(ancestors)
        self.hits.resample(ancestors)

    @property
    def bytes(self) -> int:
        """Return the size of all maps."""
        return self.grid.bytes + self.hits.bytes

    def view(self, particle: int) -> GridView:
        """Return the occupancy grid of one particle."""
        cells, row, column = self.grid.assembled(particle)
        origin = self.origin_W + self.cell_m * np.array([column, row])
        return GridView(cells * np.float32(STEP), (float(origin[0]), float(origin[1])), self.cell_m, self.version)

    def hit_xy(self, particle: int, min_hits: int = 1) -> np.ndarray:
        """Return positions (n, 2) of one particle's cells with at least `min_hits` hits."""
        cells, row, column = self.hits.assembled(particle)
        rows, columns = np.nonzero((cells >> 24) >= min_hits)
        packed = cells[rows, columns]
        x, y = columns + column + _low(packed), rows + row + _high(packed)
        return np.stack([x, y], axis=-1) * self.cell_m + self.origin_W

    def nearest(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Find the nearest mean hit in the cell of each point (particles, m, 2) or its 8 neighbours, in cells.

        Returns dx, dy to it, the squared distance (inf without a hit), and its number of hits; each (particles, m).
        """
        n, m = cells.shape[:2]
        column, row = np.floor(cells[:, :, 0]).astype(np.int32), np.floor(cells[:, :, 1]).astype(np.int32)
        outside = (column < 1) | (row < 1) | (column > self.side - 2) | (row > self.side - 2)
        column, row = np.clip(column, 1, self.side - 2), np.clip(row, 1, self.side - 2)
        in_x, in_y = (cells[:, :, 0] - column).astype(np.float32), (cells[:, :, 1] - row).astype(np.float32)
        best = np.full((n, m), np.inf, np.float32)
        found = np.zeros((n, m), np.uint32)
        dx_best, dy_best = np.zeros((n, m), np.float32), np.zeros((n, m), np.float32)
        table, pool, across = self.hits.table.reshape(-1), self.hits.pool.reshape(-1), self.hits.across
        base = (np.arange(n, dtype=np.int32) * (across * across))[:, None]
        unit = np.float32(1.0 / _UNITS)
        columns = [((column + j) >> SHIFT, (column + j) & LOW_BITS, np.float32(j) - in_x) for j in (-1, 0, 1)]
        for i in (-1, 0, 1):
            y = row + i
            tile_row, in_row, from_y = base + (y >> SHIFT) * across, (y & LOW_BITS) << SHIFT, np.float32(i) - in_y
            for tile_column, in_column, from_x in columns:
                packed = pool.take((table.take(tile_row + tile_column) << (2 * SHIFT)) + (in_row + in_column))
                dx = (packed & 0xFFF).astype(np.float32) * unit + from_x
                dy = ((packed >> 12) & 0xFFF).astype(np.float32) * unit + from_y
                squared = dx * dx + dy * dy
                better = (squared < best) & (packed > 0)
                np.copyto(best, squared, where=better)
                np.copyto(found, packed, where=better)
                np.copyto(dx_best, dx, where=better)
                np.copyto(dy_best, dy, where=better)
        best[outside] = np.inf
        return dx_best, dy_best, best, (found >> 24).astype(np.int32)

    def _insert_hits(self, particles: np.ndarray, xy: np.ndarray) -> None:
        at = self.cells(xy).reshape(-1, 2)
        who = np.repeat(np.arange(len(particles)), xy.shape[1])
        cell = np.floor(at).astype(np.int64)
        inside = ((cell >= 0) & (cell < self.side)).all(axis=1)
        at, who, cell = at[inside], who[inside], cell[inside]
        place = (cell[:, 1] >> SHIFT) * self.hits.across + (cell[:, 0] >> SHIFT)
        key = who * (self.hits.across * self.hits.across) + place
        pairs, back = np.unique(key, return_inverse=True)
        squares = self.hits.across * self.hits.across
        tiles = self.hits.writable(particles[pairs // squares], pairs % squares)
        spot = tiles[back.reshape(-1)].astype(np.int64) * CELLS + (
            ((cell[:, 1] & LOW_BITS) << SHIFT) | (cell[:, 0] & LOW_BITS)
        )
        pool = self.hits.pool.reshape(-1)
        packed = pool[spot]
        count = (packed >> 24).astype(np.float64)
        new_x, new_y = at[:, 0] - cell[:, 0], at[:, 1] - cell[:, 1]
        gain = 1.0 / (count + 1.0)
        x = _low(packed) + gain * (new_x - _low(packed))
        y = _high(packed) + gain * (new_y - _high(packed))
        pool[spot] = _packed(x, y, np.minimum(count + 1.0, _MAX_COUNT))

    def _missed(
        self, centre: np.ndarray, turn: int, reach_m: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return the change of the cells about a position that beams have passed; None outside the area.

        The parts of the result are column and row of the first tile, number of columns and rows of tiles, and the
        change (tiles, cells).
        """
        across = self.grid.across
        low = np.clip((centre - self._reach_cells) >> SHIFT, 0, across)
        high = np.clip(((centre + self._reach_cells) >> SHIFT) + 1, 0, across)
        if (high <= low).any():
            return None
        begin, end = low * SIDE - centre + self._middle, high * SIDE - centre + self._middle
        part = (slice(begin[1], end[1]), slice(begin[0], end[0]))
        reach = np.roll(reach_m, turn) * (16.0 / self.cell_m)
        # A beam has passed a cell only if it has passed its far corner, hence half a cell less.
        limit = np.clip(reach - 8.0, 0.0, 65535.0).astype(np.uint16)
        passed = self._distance[part] < limit[self._azimuth[part]]
        change = passed.astype(np.int8) * np.int8(_MISS)
        wide, tall = (int(n) for n in high - low)
        change = change.reshape(tall, SIDE, wide, SIDE).transpose(0, 2, 1, 3).reshape(tall * wide, CELLS)
        return low, high - low, change

    def _with_hits(
        self, low: np.ndarray, size: np.ndarray, change: np.ndarray, band: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add the hits `band` (fractional cells) to the change; return the changed tiles' places and their change."""
        hits = np.floor(band).astype(int) - low * SIDE
        hits = hits[((hits >= 0) & (hits < size * SIDE)).all(axis=1)]
        tile = (hits[:, 1] >> SHIFT) * size[0] + (hits[:, 0] >> SHIFT)
        change[tile, ((hits[:, 1] & LOW_BITS) << SHIFT) | (hits[:, 0] & LOW_BITS)] = _HIT
        touched = np.flatnonzero(change.any(axis=1))
        row, column = np.divmod(touched, size[0])
        return (low[1] + row) * self.grid.across + low[0] + column, change[touched]


def _transformed(xy: np.ndarray, pose: np.ndarray, c: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Transform points (m, 2) in H by poses (n, 3) to W: (n, m, 2)."""
    out = np.empty((len(pose), len(xy), 2))
    out[:, :, 0] = c[:, None] * xy[:, 0] - s[:, None] * xy[:, 1] + pose[:, :1]
    out[:, :, 1] = s[:, None] * xy[:, 0] + c[:, None] * xy[:, 1] + pose[:, 1:2]
    return out


def _low(packed: np.ndarray) -> np.ndarray:
    """Unpack x within the cell, 0 to 1."""
    return (packed & 0xFFF) * (1.0 / _UNITS)


def _high(packed: np.ndarray) -> np.ndarray:
    """Unpack y within the cell, 0 to 1."""
    return ((packed >> 12) & 0xFFF) * (1.0 / _UNITS)


def _packed(x: np.ndarray, y: np.ndarray, count: np.ndarray) -> np.ndarray:
    low = np.clip(np.rint(x * _UNITS), 0, _UNITS - 1).astype(np.uint32)
    high = np.clip(np.rint(y * _UNITS), 0, _UNITS - 1).astype(np.uint32)
    return low | (high << np.uint32(12)) | (count.astype(np.uint32) << np.uint32(24))
