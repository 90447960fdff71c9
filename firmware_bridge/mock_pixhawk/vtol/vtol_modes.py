"""The flight modes of a VTOL: a multirotor's in hover, a plane's in flight; a transition in between goes on first."""

from __future__ import annotations

from math import sqrt

from firmware_bridge.mock_pixhawk.flight.flight_modes import FlightMode, Hold
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.path import line_between
from firmware_bridge.mock_pixhawk.plane.plane_modes import PlaneHold
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from firmware_bridge.mock_pixhawk.vtol.vtol_pilot import VtolPilot


class VtolMode:
    """One mode by two: `hover` on the lifters, `wing` on the wings."""

    def __init__(self, pilot: VtolPilot, hover: FlightMode, wing: FlightMode) -> None:
        self._pilot, self._hover, self._wing = pilot, hover, wing
        self._running: FlightMode | None = None

    def start(self, now_us: int) -> None:
        self._running = None
        if not self._pilot.transiting:
            self._run(now_us)

    def step(self, now_us: int) -> Mode | None:
        if self._pilot.transiting:
            self._pilot.step_transition(now_us)
            return None
        return self._run(now_us).step(now_us)

    def _run(self, now_us: int) -> FlightMode:
        """Return the mode of the present regime, begun."""
        mode = self._wing if self._pilot.flies else self._hover
        if mode is not self._running:
            if self._running is not None:
                self._pilot.take_over()
            self._running = mode
            mode.start(now_us)
        return mode


class VtolHold(VtolMode):
    """AUTO.LOITER: holds the place in hover, circles on the wings."""

    def __init__(self, pilot: VtolPilot, hover: Hold, wing: PlaneHold) -> None:
        super().__init__(pilot, hover, wing)
        self._holds = hover, wing

    def go_to(self, point: Point, speed_mps: float | None, yaw: float | None) -> None:
        """Go to a place and stay there."""
        hover, wing = self._holds
        (wing if self._pilot.flies else hover).go_to(point, speed_mps, yaw)


class VtolHome:
    """AUTO.RTL and AUTO.LAND on the wings: straight home, or no way at all; then a back-transition.

    The multirotor's mode goes on from there.
    """

    def __init__(self, pilot: VtolPilot, vehicle: Vehicle, params: ParamTable, *, lands_here: bool) -> None:
        self._pilot, self._vehicle, self._params, self._lands_here = pilot, vehicle, params, lands_here
        self._d = 0.0

    def start(self, now_us: int) -> None:  # noqa: ARG002
        home, d = self._vehicle.home, self._vehicle.pos_d
        self._d = d if home is None else min(d, home.d_m - self._params["RTL_RETURN_ALT"])

    def step(self, now_us: int) -> Mode | None:
        pilot, home = self._pilot, self._vehicle.home
        if self._lands_here or home is None:
            pilot.start_back(now_us)
        else:
            approach(pilot, (home.n_m, home.e_m, self._d), now_us)
        return None


def approach(pilot: VtolPilot, point: Point, now_us: int) -> None:
    """Fly to a place on the wings at its height; begin the back-transition where its way to a stop leads there."""
    n, e, _ = pilot.here()
    dn, de = point[0] - n, point[1] - e
    if sqrt(dn * dn + de * de) <= pilot.braking_distance_m():
        pilot.start_back(now_us)
        pilot.step_transition(now_us)
        return
    plane = pilot.plane
    plane.path = line_between(n, e, point[0], point[1], otherwise_rad=plane.course_rad)
    plane.fly(d_m=point[2])
