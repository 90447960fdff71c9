"""Preview sensors of the page: a camera, a LiDAR and a radar at the vehicle's nose, without sensor errors.

The page's server computes them from the newest pose, so they take no time of the run's thread and are not part of the
digest. Only streams of open panes are computed, one frame at a time and as often as the processor allows.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.run.feed.payloads import MAX_POINTS, frame_streams
from hil.run.feed.streams import CLOUD_CHANNEL, PREVIEW_PREFIX, PREVIEW_STREAMS
from signals.classes import Classes
from signals.samples import TruthState, Vec3

if TYPE_CHECKING:
    from signals.geodesy import Site
    from sim.frame.scene_mesh import Actors

_SIZE = (320, 240)
_FOV_DEG = 90.0
_STEP_NS = 4_000_000
_ALL = "*"  # no name of a vehicle: the scene with all of them
_NOSE_M = (0.15, 0.0, 0.02)


class PreviewSensors:
    """Sensors in the scene of one bench, each made on first use. `render` and `triangles` are thread-safe."""

    def __init__(self, bench_file: Path) -> None:
        self._bench_file = bench_file
        self._lock = threading.Lock()
        self._bench: Any = None
        self._sources: dict[str, Any] = {}  # SharedFrames by vehicle; "": the scene without vehicles
        self._sensors: dict[tuple[str, str, tuple[str, ...]], Any] = {}
        self._actors: Actors | None = None
        self._seq = 0

    @property
    def classes(self) -> Classes:
        """Classes of the scene; empty until it is loaded."""
        return self._sources[""].classes if self._sources else Classes()

    def triangles(self) -> bytes:
        """Return the scene for the 3-D view. Raises HilError if the bench file or its scene cannot be loaded."""
        from hil.apps.dash.views.scene_mesh import scene_triangles
        from sim.frame.scene_mesh import Actors

        with self._lock:
            world = self._source("").world
            triangles = scene_triangles(world)
        self._actors = Actors(world)
        return triangles

    def site_and_start(self) -> tuple[Site, Vec3]:
        """Return the site of the scene and where the (first) vehicle starts, in W. Raises HilError as `triangles`."""
        with self._lock:
            self._source("")
            bench = self._bench
        first = next(iter(bench.vehicles.values()), bench)
        return bench.scene.site, first.config.start.p_W

    def places(self, t_ns: int) -> list[tuple[float, float, float, float]]:
        """Return x, y, z [m, W] and yaw [rad] of people and vehicles; empty before `triangles` was called."""
        return [] if self._actors is None else self._actors.places(t_ns)

    def render(
        self, wanted: list[str], places: Mapping[str, tuple[Any, Any]], t_ns: int, vehicle: str = ""
    ) -> dict[str, Any]:
        """Return payloads as `hil.run.feed.payloads` makes them, by stream.

        `places`: position and attitude of each vehicle by name; `vehicle`: the one with the sensors. The names are
        empty in a run of one.
        """
        payloads: dict[str, Any] = {}
        with self._lock:
            frames = self._source(vehicle)
            truth = _truth(t_ns, *places[vehicle], rotors=4)
            for name, place in places.items() if vehicle else ():
                rotors = len(self._bench.vehicles[name].vehicle.rotors)
                self._sources[_ALL].place(name, _truth(t_ns, *place, rotors=rotors))
            self._seq += 1
            for name in ("camera", "lidar", "radar"):
                port = f"{PREVIEW_PREFIX}/{name}"
                channels = tuple(sorted(s.removeprefix(f"{port}/") for s in wanted if s.startswith(f"{port}/")))
                if not channels or any(f"{port}/{channel}" not in PREVIEW_STREAMS for channel in channels):
                    continue
                frames.expect(t_ns)
                sample = self._sensor(vehicle, name, channels).sample(truth, self._seq)
                if sample is not None:
                    payloads |= frame_streams({port: sample}, [f"{port}/{channel}" for channel in channels], {})
        return payloads

    def _source(self, vehicle: str) -> Any:
        """Return the scene as a vehicle sees it: with the others."""
        if not self._sources:
            from hil.config import load_bench
            from sim.frame.source import SharedFrames
            from sim.world_loader import load_world

            self._bench = load_bench(self._bench_file, flown=False)
            self._sources[""] = SharedFrames(load_world(self._bench.scene))
        if vehicle not in self._sources:
            from sim.frame.source import SharedFrames
            from sim.physics.vehicle_bodies import with_vehicles

            if _ALL not in self._sources:
                vehicles = {name: bench.vehicle for name, bench in self._bench.vehicles.items()}
                self._sources[_ALL] = SharedFrames(with_vehicles(self._sources[""].world, vehicles))
            self._sources[vehicle] = self._sources[_ALL].seen_by(vehicle)
        return self._sources[vehicle]

    def _sensor(self, vehicle: str, name: str, channels: tuple[str, ...]) -> Any:
        key = (vehicle, name, channels)
        if key not in self._sensors:
            from sim.sensors.catalog import make_sensor
            from sim.sensors.sensor import Installation

            if len(self._sensors) > 8:  # sensors of panes that were closed
                self._sensors.clear()
            installation = Installation(
                name, rate_hz=10.0, seed=1, scene=self._bench.scene, step_ns=_STEP_NS, frames=self._source(vehicle)
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


def _truth(t_ns: int, p_WB: Any, q_WB: Any, *, rotors: int) -> TruthState:
    """Return the state of a vehicle that does not move, at a place."""
    zero = (0.0, 0.0, 0.0)
    tick = t_ns // _STEP_NS
    return TruthState(tick, t_ns, tuple(p_WB), tuple(q_WB), zero, zero, zero, zero, (0.0,) * rotors, False)


def _lidar() -> dict[str, Any]:
    """Return overrides for only as many rays as the page shows points, which saves three quarters of the time.

    All rays have the same time, since the page has one pose.
    """
    from sim.sensors.presets import PRESETS

    pattern = PRESETS["vlp16"].parameters.model_dump()["pattern"]
    columns = MAX_POINTS // len(pattern["elevation_deg"])
    return {"pattern": pattern | {"column_ns": None, "columns": columns}, "rolling": False, "subsweeps": 1}
