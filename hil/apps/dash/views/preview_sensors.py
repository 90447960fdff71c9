"""Preview sensors of the page: a camera, a LiDAR and a radar at the vehicle's nose, without sensor errors.

The page's server computes them from the newest pose, so they take no time of the run's thread and are not part of the
digest. Only streams of open panes are computed, one frame at a time and as often as the processor allows.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.apps.dash.streams import CLOUD_CHANNEL, PREVIEW_PREFIX, PREVIEW_STREAMS
from hil.apps.dash.views.payloads import MAX_POINTS, frame_streams
from signals.classes import Classes
from signals.samples import TruthState

if TYPE_CHECKING:
    from hil.apps.dash.views.scene_mesh import Actors

_SIZE = (320, 240)
_FOV_DEG = 90.0
_STEP_NS = 4_000_000
_NOSE_M = (0.15, 0.0, 0.02)


class PreviewSensors:
    """Sensors in the scene of one bench, each made on first use. `render` and `triangles` are thread-safe."""

    def __init__(self, bench_file: Path) -> None:
        self._bench_file = bench_file
        self._lock = threading.Lock()
        self._bench: Any = None
        self._frames: Any = None
        self._sensors: dict[tuple[str, tuple[str, ...]], Any] = {}
        self._actors: Actors | None = None
        self._seq = 0

    @property
    def classes(self) -> Classes:
        """Classes of the scene; empty until it is loaded."""
        return Classes() if self._frames is None else self._frames.classes

    def triangles(self) -> bytes:
        """Return the scene for the 3-D view. Raises HilError if the bench file or its scene cannot be loaded."""
        from hil.apps.dash.views.scene_mesh import Actors, scene_triangles

        with self._lock:
            world = self._loaded().world
            triangles = scene_triangles(world)
        self._actors = Actors(world)
        return triangles

    def places(self, t_ns: int) -> list[tuple[float, float, float, float]]:
        """Return x, y, z [m, W] and yaw [rad] of people and vehicles; empty before `triangles` was called."""
        return [] if self._actors is None else self._actors.places(t_ns)

    def render(self, wanted: list[str], p_WB: Any, q_WB: Any, t_ns: int) -> dict[str, Any]:
        """Return payloads as `hil.apps.dash.views.payloads` makes them, by stream."""
        zero = (0.0, 0.0, 0.0)
        truth = TruthState(t_ns // _STEP_NS, t_ns, tuple(p_WB), tuple(q_WB), zero, zero, zero, zero, (0.0,) * 4, False)
        payloads: dict[str, Any] = {}
        with self._lock:
            self._loaded()
            self._seq += 1
            for name in ("camera", "lidar", "radar"):
                port = f"{PREVIEW_PREFIX}/{name}"
                channels = tuple(sorted(s.removeprefix(f"{port}/") for s in wanted if s.startswith(f"{port}/")))
                if not channels or any(f"{port}/{channel}" not in PREVIEW_STREAMS for channel in channels):
                    continue
                self._frames.expect(t_ns)
                sample = self._sensor(name, channels).sample(truth, self._seq)
                if sample is not None:
                    payloads |= frame_streams({port: sample}, [f"{port}/{channel}" for channel in channels], {})
        return payloads

    def _loaded(self) -> Any:
        if self._frames is None:
            from hil.config import load_bench
            from sim.frame.source import SharedFrames
            from sim.world_loader import load_world

            self._bench = load_bench(self._bench_file)
            self._frames = SharedFrames(load_world(self._bench.scene))
        return self._frames

    def _sensor(self, name: str, channels: tuple[str, ...]) -> Any:
        key = (name, channels)
        if key not in self._sensors:
            from sim.sensors.catalog import make_sensor
            from sim.sensors.sensor import Installation

            if len(self._sensors) > 8:  # sensors of panes that were closed
                self._sensors.clear()
            installation = Installation(
                name, rate_hz=10.0, seed=1, scene=self._bench.scene, step_ns=_STEP_NS, frames=self._frames
            )
            mount = {"mount_m": _NOSE_M}
            if name == "camera":
                camera = {"resolution": _SIZE, "fov_deg": _FOV_DEG, "channels": channels, "shadows": True}
                self._sensors[key] = make_sensor(installation, kind="camera", overrides=camera | mount)
            elif name == "lidar":
                assert channels == (CLOUD_CHANNEL,)
                self._sensors[key] = make_sensor(installation, preset="vlp16", overrides=_lidar())
            else:
                outputs = {"outputs": channels, "processing": {"clutter": "none"}}
                self._sensors[key] = make_sensor(installation, preset="bgt60tr13c", overrides=outputs | mount)
        return self._sensors[key]


def _lidar() -> dict[str, Any]:
    """Return overrides for only as many rays as the page shows points, which saves three quarters of the time.

    All rays have the same time, since the page has one pose.
    """
    from sim.sensors.presets import PRESETS

    pattern = PRESETS["vlp16"].parameters.model_dump()["pattern"]
    columns = MAX_POINTS // len(pattern["elevation_deg"])
    return {"pattern": pattern | {"column_ns": None, "columns": columns}, "rolling": False, "subsweeps": 1}
