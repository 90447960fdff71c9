"""`detect` with boxes from the bench's instance picture in place of the network. For tests only."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion.cuts.detect import Detect  # noqa: E402
from hil_companion.detect.decode import Detection  # noqa: E402

PERSON = 10  # class id: sim/scene/classes.py
LEAST_PX = 60


class StandIn(Detect):
    """Detects every person of 60 pixels or more; needs the camera's topics `segmentation` and `instance`."""

    def __init__(
        self,
        *,
        camera: str = "front/rgb",
        depth: str | None = None,
        radar: str | None = None,
        localiser: str = "own",
        tiles: Any = (1, 1),
        out: str | None = None,
    ) -> None:
        super().__init__(camera=camera, depth=depth, radar=radar, localiser=localiser, tiles=tiles, out=out)
        sensor = self._settings.camera.partition("/")[0]
        self._ids = (f"{sensor}/segmentation", f"{sensor}/instance")
        self.topics = (*self.topics, *self._ids)

    @staticmethod
    def _load(*_: Any) -> Any:
        return SimpleNamespace(model=SimpleNamespace(path=SimpleNamespace(name="stand-in"), score_threshold=0.5))

    def __call__(self, frame: Any) -> None:
        self._frame = frame
        super().__call__(frame)

    def _detect(self, rgb: np.ndarray) -> list[Any]:
        classes, instances = (self._frame[topic].array for topic in self._ids)
        found = []
        for instance in np.unique(instances[classes == PERSON]).tolist():
            rows, columns = np.nonzero((instances == instance) & (classes == PERSON))
            if len(rows) >= LEAST_PX:
                box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
                found.append(Detection("person", box, 0.9))
        return found
