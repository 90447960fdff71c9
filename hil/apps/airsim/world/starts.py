"""Places where vehicles start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from math import pi

from hil.apps.airsim.settings.vehicles import Vehicle as VehicleSettings
from hil.apps.airsim.world.ned import NedFrame
from hil.apps.airsim.world.objects.present_world import PresentWorld
from signals.errors import ConfigError
from signals.units import RAD_PER_DEG
from sim.physics.flight_start import FlightStart
from sim.physics.start_overlap import overlapping_starts
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene

_GROUND_SEARCH_M = 3.0  # a vehicle that starts within this height of the ground stands on it
# Moves to the north and east [m], the shortest first: room for the greatest number of vehicles at one place.
_NEAR_BY_M = sorted(product(range(-10, 11), repeat=2), key=lambda m: (m[0] * m[0] + m[1] * m[1], -m[1], -m[0]))


class Starts:
    """Starts of all vehicles of one server."""

    def __init__(
        self, scene: Scene, frame: NedFrame, present: PresentWorld, *, on_ground: bool, log: Callable[[str], None]
    ) -> None:
        """`frame`: of the settings. `on_ground`: vehicles near the ground stand on it."""
        self._scene, self._frame, self._present, self._on_ground = scene, frame, present, on_ground
        self._log = log
        self._taken: dict[str, tuple[Vehicle, FlightStart]] = {}

    def take(self, settings: VehicleSettings, model: Vehicle) -> tuple[VehicleSettings, FlightStart]:
        """Return settings and start of a vehicle, near by if it would start inside another one, as AirSim does.

        Raises ConfigError if there is no room within 10 m.
        """
        inside, name, (x, y, z) = "", settings.name, settings.position_m
        for north_m, east_m in _NEAR_BY_M:
            moved = replace(settings, position_m=(x + north_m, y + east_m, z))
            start = self._start(moved, model)
            other = self._inside(name, model, start)
            inside = inside or other or ""
            if other is None:
                break
        else:
            hint = "give Vehicles different X and Y in settings.json"
            raise ConfigError.at(f"vehicle {name!r}", f"starts inside vehicle {inside!r}", hint)
        if inside:
            self._log(
                f"warning: vehicle '{name}' would start inside vehicle '{inside}', so it starts {north_m} m north and "
                f"{east_m} m east of its place; its own coordinates begin there"
            )
        self._taken[name] = (model, start)
        return moved, start

    def _inside(self, name: str, model: Vehicle, start: FlightStart) -> str | None:
        """Return a vehicle whose start overlaps with this one."""
        for other, taken in self._taken.items():
            if overlapping_starts(self._scene, {other: taken, name: (model, start)}):
                return other
        return None

    def _start(self, settings: VehicleSettings, model: Vehicle) -> FlightStart:
        x, y, z = self._frame.to_W(settings.position_m)
        yaw_rad = 0.5 * pi - settings.rotation_deg[2] * RAD_PER_DEG
        if self._on_ground:
            below_m = self._present.ray_distance((x, y, z + _GROUND_SEARCH_M), (0.0, 0.0, -1.0))
            ground_m = z + _GROUND_SEARCH_M - below_m
            if below_m >= 0.0 and abs(z - model.standing_height_m - ground_m) < _GROUND_SEARCH_M:
                return FlightStart(ground_W=(x, y, ground_m), yaw_rad=yaw_rad)
        return FlightStart(p_WB=(x, y, z), yaw_rad=yaw_rad)
