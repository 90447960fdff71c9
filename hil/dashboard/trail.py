"""Where the vehicle has been: bounded however long a run is."""

from __future__ import annotations

from collections.abc import Sequence

_POINTS = 4000  # beyond that every second one goes


class Trail:
    """Points (t [s], x, y, z [m, W]) as they came, thinned. `version` changes when old points do."""

    def __init__(self, limit: int = _POINTS) -> None:
        self.points: list[tuple[float, ...]] = []
        self.version = 0
        self._limit = limit
        self._every = 1
        self._count = 0

    def add(self, flat: Sequence[float]) -> None:
        """Four numbers a point."""
        for at in range(0, len(flat) - 3, 4):
            self._count += 1
            if self._count % self._every == 0:
                self.points.append(tuple(flat[at : at + 4]))
            if len(self.points) >= self._limit:
                del self.points[::2]
                self._every *= 2
                self.version += 1

    def clear(self) -> None:
        """A new run."""
        self.points.clear()
        self._every, self._count = 1, 0
        self.version += 1
