"""What a page wants to see and the run does not draw: drawn here, in the page's own process, from the newest pose.

So it costs the run nothing and is no part of its digest. Only what an open pane shows is drawn, one picture at a time,
and only as often as there is time for it. A camera, a LiDAR and a radar at the vehicle's nose, without errors.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.dashboard.hub import OWN_PREFIX, OWN_STREAMS
from hil.dashboard.snapshot import CLOUD_PART, MOST_POINTS, frame_streams
from hil.signals.classes import Classes
from hil.signals.samples import TruthState

if TYPE_CHECKING:
    from hil.dashboard.scene_mesh import Actors

_SIZE = (320, 240)
_FOV_DEG = 90.0
_STEP_NS = 4_000_000
_NOSE_M = (0.15, 0.0, 0.02)


class OwnViews:
    """The sensors of one scene, made when first asked for. Use from one thread at a time."""

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
        """What class ids mean, once geometry is there."""
        return Classes() if self._frames is None else self._frames.classes

    def triangles(self) -> bytes:
        """The scene for the 3-D view. HilError where the bench file or its scene is wrong."""
        from hil.dashboard.scene_mesh import Actors, scene_triangles

        with self._lock:
            world = self._loaded().world
            made = scene_triangles(world)
        self._actors = Actors(world)
        return made

    def places(self, t_ns: int) -> list[tuple[float, float, float, float]]:
        """Of people and vehicles, once the 3-D view has them."""
        return [] if self._actors is None else self._actors.places(t_ns)

    def draw(self, wanted: list[str], p_WB: Any, q_WB: Any, t_ns: int) -> dict[str, Any]:
        """Bodies as `hil.dashboard.snapshot` has them, by stream."""
        zero = (0.0, 0.0, 0.0)
        truth = TruthState(t_ns // _STEP_NS, t_ns, tuple(p_WB), tuple(q_WB), zero, zero, zero, zero, (0.0,) * 4, False)
        made: dict[str, Any] = {}
        with self._lock:
            self._loaded()
            self._seq += 1
            for name in ("camera", "lidar", "radar"):
                port = f"{OWN_PREFIX}/{name}"
                parts = tuple(sorted(s.removeprefix(f"{port}/") for s in wanted if s.startswith(f"{port}/")))
                if not parts or any(f"{port}/{part}" not in OWN_STREAMS for part in parts):
                    continue
                self._frames.expect(t_ns)
                sample = self._sensor(name, parts).sample(truth, self._seq)
                if sample is not None:
                    made |= frame_streams({port: sample}, [f"{port}/{part}" for part in parts], {})
        return made

    def _loaded(self) -> Any:
        if self._frames is None:
            from hil.config import load_bench
            from sim.frame.source import SharedFrames
            from sim.scene.world import load_world

            self._bench = load_bench(self._bench_file)
            self._frames = SharedFrames(load_world(self._bench.scene))
        return self._frames

    def _sensor(self, name: str, parts: tuple[str, ...]) -> Any:
        key = (name, parts)
        if key not in self._sensors:
            from sim.sensors.catalog import make_sensor

            if len(self._sensors) > 8:  # combinations of panes that were open once
                self._sensors.clear()
            common: dict[str, Any] = {
                "rate_hz": 10.0,
                "seed": 1,
                "scene": self._bench.scene,
                "step_ns": _STEP_NS,
                "frames": self._frames,
            }
            mount = {"mount_m": _NOSE_M}
            if name == "camera":
                look = {"resolution": _SIZE, "fov_deg": _FOV_DEG, "channels": parts, "shadows": True}
                self._sensors[key] = make_sensor(name, kind="camera", overrides=look | mount, **common)
            elif name == "lidar":
                assert parts == (CLOUD_PART,)
                self._sensors[key] = make_sensor(name, preset="vlp16", overrides=_lidar(), **common)
            else:
                outputs = {"outputs": parts, "processing": {"clutter": "none"}}
                self._sensors[key] = make_sensor(name, preset="bgt60tr13c", overrides=outputs | mount, **common)
        return self._sensors[key]


def _lidar() -> dict[str, Any]:
    """As many columns as a page shows points of: to cast them all and leave most out takes four times as long.

    A sweep at one instant, since the page tells one pose.
    """
    from sim.sensors.presets import PRESETS

    pattern = PRESETS["vlp16"].parameters.model_dump()["pattern"]
    columns = MOST_POINTS // len(pattern["elevation_deg"])
    return {"pattern": pattern | {"column_ns": None, "columns": columns}, "rolling": False, "subsweeps": 1}
