"""A flat world of boxes for the explorer: its LiDAR, its frames, and a vehicle that follows velocities with a lag."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.worlds.scripted_bench import CLIENT  # puts the client on the path

from hil_companion.explore.explorer import Explorer  # isort: skip
from hil_companion.explore.planning.flight_settings import FlightSettings  # isort: skip
from hil_companion.explore.mapping.slam_settings import SlamSettings  # isort: skip
from hil_companion.explore.mapping.true_pose import TruePose  # isort: skip
from hil_companion.frame import Frame, Sample  # isort: skip

assert CLIENT
Box = tuple[float, float, float, float]  # x0, y0, x1, y1
HEIGHT_M = 5.0
DT_NS = 100_000_000
_BEAMS = 720
_ANGLES = (np.arange(_BEAMS) + 0.5) * (2.0 * math.pi / _BEAMS)
_FAR_M = 30.0
_GROUND_M = 12.0  # range at which the lower ring meets the ground


def ranges_m(boxes: Sequence[Box], x: float, y: float, angles: np.ndarray = _ANGLES) -> np.ndarray:
    """Return the distance to the nearest box along each direction, by slabs; infinite without a box."""
    c, s = np.cos(angles), np.sin(angles)
    best = np.full(len(angles), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for x0, y0, x1, y1 in boxes:
            tx = np.sort(np.stack([(x0 - x) / c, (x1 - x) / c]), axis=0)
            ty = np.sort(np.stack([(y0 - y) / s, (y1 - y) / s]), axis=0)
            enters, leaves = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
            best = np.where((enters <= leaves) & (enters > 0.0), np.minimum(best, enters), best)
    return best


def clearance_m(boxes: Sequence[Box], x: float, y: float) -> float:
    """Return the distance to the nearest box, from outside."""
    return min((math.hypot(max(b[0] - x, x - b[2], 0.0), max(b[1] - y, y - b[3], 0.0)) for b in boxes), default=1e9)


@dataclass
class Flat:
    """One flight, frame by frame. `lidar(t_s, points)` may change a sweep; it returns None for no sweep."""

    boxes: Sequence[Box]
    goal_W: tuple[float, float]
    settings: dict[str, Any] = field(default_factory=dict)
    start_W: tuple[float, float] = (0.0, 0.0)
    lidar: Callable[[float, np.ndarray], np.ndarray | None] = lambda _t_s, points: points
    lag_s: float = 0.35

    def __post_init__(self) -> None:
        self.p = np.array([*self.start_W, HEIGHT_M])
        self.v = np.zeros(3)
        self.least_m = math.inf
        self.path_m = 0.0
        self.fastest_mps = 0.0
        chosen = {"height_m": HEIGHT_M, "hover_s": 0.5} | self.settings
        lidar = SlamSettings(
            particles=1,
            area_m=80.0,
            flight_height_m=HEIGHT_M,
            lidar_p_BL=(0.0, 0.0, 0.0),
            lidar_elevation_deg=(-math.degrees(math.atan2(HEIGHT_M, _GROUND_M)), 0.0),
            lidar_rings_sure=True,
        )
        self.localiser: Any = TruePose(lidar, start_W=(*self.start_W, HEIGHT_M, 0.0), seed=1)
        self.explorer = Explorer(FlightSettings(**chosen), self.localiser, self.goal_W)
        self.frames = 0

    def frame(self, n: int) -> Frame:
        t_ns = n * DT_NS
        values = {"p_WB": self.p.tolist(), "v_WB_W": self.v.tolist(), "q_WB": [1.0, 0.0, 0.0, 0.0]}
        samples = {"truth": Sample("truth", n, t_ns, t_ns, values, {})}
        far = ranges_m(self.boxes, float(self.p[0]), float(self.p[1]))
        seen = far < _FAR_M
        level = far[seen, None] * np.stack([np.cos(_ANGLES[seen]), np.sin(_ANGLES[seen])], axis=1)
        # No two sweeps are equal: equal sweeps of a moving vehicle would mean a stuck LiDAR.
        ground = (_GROUND_M + 0.002 * (n % 5)) * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
        points: np.ndarray | None = np.vstack(
            [
                np.column_stack([level, np.zeros(len(level))]),
                np.column_stack([ground, np.full(_BEAMS, -HEIGHT_M)]),
            ]
        )
        beam = np.concatenate([np.flatnonzero(seen), np.arange(_BEAMS)])  # the index of a beam also gives its time
        order = np.argsort(beam, kind="stable")
        points = self.lidar(t_ns * 1e-9, points[order])
        if points is not None:
            upper = (points[:, 2] > -0.5 * HEIGHT_M).astype(np.uint8)
            arrays = {"points_L": points.astype(np.float32), "time_offset_ns": np.resize(beam[order], len(points))}
            arrays["ring"] = upper
            samples["lidar"] = Sample("lidar", n, t_ns, t_ns, {}, arrays)
        header = {"frame": n, "tick": n, "t_ns": t_ns, "t_sent_ns": 0, "dropped": 0}
        return Frame(header, samples, in_ring=False, t_received_ns=0)

    def fly(self, limit_s: float = 60.0) -> Flat:
        for _ in range(round(limit_s * 1e9 / DT_NS)):
            self.step()
            if self.explorer.finished:
                break
        return self

    def step(self) -> Any:
        desired = self.explorer.step(self.frame(self.frames))
        self.frames += 1
        wanted = np.asarray(desired.v_W, float)
        for _ in range(10):
            self.v += (wanted - self.v) * (0.01 / self.lag_s)
            self.p += self.v * 0.01
            self.path_m += float(np.hypot(*self.v[:2])) * 0.01
        self.least_m = min(self.least_m, clearance_m(self.boxes, float(self.p[0]), float(self.p[1])))
        self.fastest_mps = max(self.fastest_mps, float(np.hypot(*self.v[:2])))
        return desired

    @property
    def outcome(self) -> str:
        return self.explorer.report.outcome

    @property
    def goal_error_m(self) -> float:
        return math.dist(self.p[:2].tolist(), self.goal_W)
