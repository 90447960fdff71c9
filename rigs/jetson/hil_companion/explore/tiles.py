"""A layer of map for every particle, in tiles that particles share until one of them writes.

A tile is 32 x 32 cells in one pool; each particle has a table of which tile lies where. Tile 0 is the unknown: nobody
writes it, and all tables begin with it. Resampling copies tables, never tiles. Who writes a tile that others hold too
gets a copy of its own first. Tiles that no table names any more are taken again.
"""

from __future__ import annotations

import numpy as np

SIDE = 32
CELLS = SIDE * SIDE
SHIFT, LOW_BITS = 5, 31


class Tiles:
    """`dtype` of a cell, 0 when nothing is known; `across` tiles on each side of the area."""

    def __init__(self, particles: int, across: int, dtype: type) -> None:
        self.across = across
        self.table = np.zeros((particles, across * across), np.int32)
        self.pool = np.zeros((64, CELLS), dtype)

    @property
    def bytes(self) -> int:
        """Held by the pool."""
        return int(self.pool.nbytes)

    def own(self, particles: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The tiles of pairs (particle, place), each pair once, made theirs alone to be written."""
        held = np.bincount(self.table.reshape(-1), minlength=len(self.pool))
        held[0] = 2  # the unknown is everybody's
        at = self.table[particles, places]
        shared = np.flatnonzero(held[at] > 1)
        if len(shared):
            # All sharers among the writers get copies; the one left behind is taken again if nobody else holds it.
            free = np.flatnonzero(held == 0)
            if len(free) < len(shared):
                more = max(len(shared) - len(free), len(self.pool) // 2)
                free = np.concatenate([free, np.arange(len(self.pool), len(self.pool) + more)])
                self.pool = np.concatenate([self.pool, np.zeros((more, CELLS), self.pool.dtype)])
            fresh = free[: len(shared)]
            self.pool[fresh] = self.pool[at[shared]]
            self.table[particles[shared], places[shared]] = fresh
            at = self.table[particles, places]
        return at

    def become(self, ancestors: np.ndarray) -> None:
        """Particle i holds from now on what `ancestors[i]` held."""
        self.table = self.table[ancestors]

    def whole(self, particle: int) -> tuple[np.ndarray, int, int]:
        """What one particle knows: cells of the smallest rectangle of tiles, and its first row and column."""
        table = self.table[particle].reshape(self.across, self.across)
        rows, columns = np.flatnonzero(table.any(axis=1)), np.flatnonzero(table.any(axis=0))
        if not len(rows):
            return np.zeros((0, 0), self.pool.dtype), 0, 0
        part = table[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        cells = self.pool[part].reshape(*part.shape, SIDE, SIDE)
        cells = cells.transpose(0, 2, 1, 3).reshape(part.shape[0] * SIDE, part.shape[1] * SIDE)
        return cells, int(rows[0]) * SIDE, int(columns[0]) * SIDE
