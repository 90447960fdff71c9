"""Conversion of samples for companions: radar points go as one array per field."""

from __future__ import annotations

import numpy as np

from firmware_bridge.companion.outgoing import Outgoing
from firmware_bridge.companion.shared_ring import SharedRing
from hil.run.companion.bundle import Collector
from signals.samples import RadarSample, TruthState
from sim.radar.processing.points import POINT_DTYPE

TRUTH = TruthState(0, 0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), *[(0.0, 0.0, 0.0)] * 4, (), False)


def _radar(points: int) -> RadarSample:
    array = np.zeros(points, POINT_DTYPE)
    array["range_m"] = np.arange(points)
    return RadarSample(0, 0, 0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), {"points": array})


def test_points_of_a_radar_go_as_columns_also_when_there_are_none() -> None:
    collector = Collector(["radar/points"])
    for count in (0, 5):
        collector.add([("radar", _radar(count))])
        frame = collector.take(0, TRUTH).frame(["radar/points"])
        (sample,) = frame.samples
        assert tuple(sample.arrays) == POINT_DTYPE.names
        assert sample.arrays["range_m"].tolist() == list(range(count))
        out = Outgoing(frame)
        out.body(out.topics)  # refuses records
        ring = SharedRing(4096)
        try:
            assert ring.put(out.block(out.topics), ["cut"]) is not None
        finally:
            ring.close()
