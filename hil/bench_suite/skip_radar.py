"""What a radar leaves out, for `hil bench skip`: outputs that nobody reads.

Dropping the weakest echoes has no row: it changes frames, within the tolerance, and in pictures of the scenes no echo
is weak enough for it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

from numpy.typing import NDArray

from hil.bench_suite.raster_cases import Case, View
from hil.signals.samples import RadarSample, TruthState
from hil.view_points import pose_of
from sim.frame.source import SharedFrames
from sim.scene.scene import load_scene
from sim.scene.view_point import ViewPoint
from sim.sensors.catalog import make_sensor

_PRESET = "bgt60tr13c"
_TICK_NS = 4_000_000
Run = Callable[[bool], Iterator[tuple[float, dict[str, NDArray[Any]]]]]


def unread_outputs(case: Case) -> Run:
    """The whole sensor, drawing included: asked for raw frames alone, and for all that it has."""
    scene = load_scene(case.name)
    truths = sorted((_truth(view) for view in case.views), key=lambda truth: truth.t_ns)

    def run(on: bool) -> Iterator[tuple[float, dict[str, NDArray[Any]]]]:
        overrides = {"outputs": ["raw"]} if on else {}
        frames = SharedFrames(case.world)
        radar = make_sensor(
            "radar", preset=_PRESET, rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, overrides=overrides,
            frames=frames,
        )  # fmt: skip
        radar.sample(truths[-1]._replace(t_ns=0), 0)
        for seq, truth in enumerate(truths, start=1):
            began = time.perf_counter()
            sample = radar.sample(truth, seq)
            took = time.perf_counter() - began
            assert isinstance(sample, RadarSample)
            yield took, {"raw": sample.channels["raw"]}
        frames.close()

    return run


def _truth(view: View) -> TruthState:
    """A vehicle that stands where the view is from, and looks as it does but for its roll."""
    x, y, z = view.pose.R_WC[2::3]
    look_deg = (math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y))))
    return pose_of(ViewPoint(name="view", at_m=view.pose.p_WC, look_deg=look_deg))._replace(t_ns=view.t_ns)
