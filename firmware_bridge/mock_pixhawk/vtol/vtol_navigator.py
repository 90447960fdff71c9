"""Execution of missions by a VTOL: items are flown by the multirotor's navigator in hover, by the plane's on the wings.

NAV_VTOL_TAKEOFF    a vertical climb, then a front transition towards the next item. NAV_TAKEOFF is the same while
                    NAV_FORCE_VT is 1, as in PX4, else a climb alone
DO_VTOL_TRANSITION  param 1: 4 to the wings, with the nose first turned towards the next item; 3 to hover
NAV_VTOL_LAND       on the wings straight to the place at the height of flight, a back-transition where the way to a
                    stop leads there, then a vertical landing at the place. NAV_LAND is the same while NAV_FORCE_VT is 1
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.mission_item import VTOL_NAVIGATION
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.flight.navigator import Navigator
from firmware_bridge.mock_pixhawk.ids import Cmd
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.plane.plane_navigator import PlaneNavigator
from firmware_bridge.mock_pixhawk.vtol.transition import Regime
from firmware_bridge.mock_pixhawk.vtol.vtol_modes import approach
from firmware_bridge.mock_pixhawk.vtol.vtol_pilot import VtolPilot
from signals.mission import MissionItem

_TO_WINGS = Regime.WING.value
_ALIGNED_RAD = 0.1
_NEAR_M = 2.0  # a next item nearer than this gives no direction


class VtolNavigator(MissionRunner):
    """AUTO.MISSION of a VTOL."""

    navigation = VTOL_NAVIGATION

    def __init__(self, pilot: VtolPilot, parts: FirmwareParts, hover: Navigator, wing: PlaneNavigator) -> None:
        super().__init__(parts)
        self._pilot, self._hover, self._wing = pilot, hover, wing

    # -- what flies ---------------------------------------------------------------------------------------------

    @property
    def _flyer(self) -> Navigator | PlaneNavigator:
        return self._wing if self._pilot.flies else self._hover

    def _stay(self) -> None:
        if not self._pilot.transiting:
            self._flyer._stay()

    def _idle(self) -> None:
        self._pilot.idle()

    def _forget(self) -> None:
        super()._forget()
        self._hover._forget()
        self._wing._forget()

    def change_speed(self, speed_mps: float) -> bool:
        known = super().change_speed(speed_mps)
        if self._pilot.flies:
            self._pilot.plane.airspeed_mps = self._speed
        return known

    def step(self, now_us: int) -> Mode | None:
        if self._pilot.transiting:
            self._pilot.step_transition(now_us)
            if self._pilot.transiting:
                return None
            self._speed = None  # that of the other regime
            self._stay()
        return super().step(now_us)

    # -- items --------------------------------------------------------------------------------------------------

    def _begin(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        command, forced = item.command, self._params["NAV_FORCE_VT"] == 1.0
        if command == Cmd.NAV_VTOL_TAKEOFF or (command == Cmd.NAV_TAKEOFF and forced):
            return self._begin_takeoff(item)
        if command == Cmd.DO_VTOL_TRANSITION:
            return self._begin_transition(item, to_wings=item.param1 == _TO_WINGS)
        if command == Cmd.NAV_VTOL_LAND or (command == Cmd.NAV_LAND and forced):
            return self._begin_landing(item, now_us)
        return self._by_flyer(item, now_us)

    def _by_flyer(
        self, item: MissionItem, now_us: int, items: list[MissionItem] | None = None
    ) -> Callable[[int], bool]:
        """Let the navigator of the present regime fly an item; it shares the progress of this one."""
        flyer = self._flyer
        flyer.items, flyer.index, flyer.complete = items or self.items, self.index, False
        flyer._speed, flyer._jumps = self._speed, self._jumps
        action = flyer._begin(item, now_us)

        def step(now: int) -> bool:
            done = action(now)
            self.index, self._speed = flyer.index, flyer._speed
            self.complete = self.complete or flyer.complete
            self._next_mode, flyer._next_mode = flyer._next_mode, None
            return done

        return step

    def _begin_takeoff(self, item: MissionItem) -> Callable[[int], bool]:
        if not self._vehicle.landed:
            # In the air the take-off is done.
            return lambda _now: self._pass(item)
        climb = self._hover._begin_climb(item._replace(command=Cmd.NAV_TAKEOFF))
        transition: Callable[[int], bool] | None = None

        def step(now: int) -> bool:
            nonlocal transition
            if transition is None:
                if climb(now):
                    transition = self._begin_transition(item, to_wings=True)
                return False
            return transition(now)

        return step

    def _begin_transition(self, item: MissionItem, *, to_wings: bool) -> Callable[[int], bool]:
        pilot, guidance = self._pilot, self._pilot.guidance
        bearing = self._bearing_after(item)
        began = False

        def step(now: int) -> bool:
            nonlocal began
            if pilot.flies == to_wings or began or pilot.transition.failure is not None:
                return self._pass(item)
            if not to_wings:
                began = pilot.start_back(now)
                pilot.step_transition(now)
                return False
            if bearing is not None:
                guidance.yaw_target = bearing
            guidance.follow()
            if bearing is None or abs(el.wrap_pi(self._vehicle.yaw - bearing)) < _ALIGNED_RAD:
                began = pilot.start_front(now)
                self._info("Transition to forward flight")
            return False

        return step

    def _bearing_after(self, item: MissionItem) -> float | None:
        """Return the direction to the next item with a place."""
        following = self._following(item)
        if following is None:
            return None
        n, e, d = self._pilot.here()
        to = self._point(following, (n, e, d))
        dn, de = to[0] - n, to[1] - e
        return el.atan2(de, dn) if dn * dn + de * de > _NEAR_M * _NEAR_M else None

    def _begin_landing(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        pilot = self._pilot
        here = pilot.here()
        point = self._point(item, here)
        over = (point[0], point[1], here[2])
        down: Callable[[int], bool] | None = None
        if not pilot.flies:
            return self._land_from_hover(item, now_us)

        def step(now: int) -> bool:
            nonlocal down
            if pilot.flies:
                approach(pilot, over, now)
                return False
            if down is None:
                down = self._land_from_hover(item, now)
            return down(now)

        return step

    def _land_from_hover(self, item: MissionItem, now_us: int) -> Callable[[int], bool]:
        """Go over the place at the present height, then down."""
        landing = item._replace(command=Cmd.NAV_LAND)
        items = [*self.items[: item.seq], landing, *self.items[item.seq + 1 :]]
        return self._by_flyer(landing, now_us, items)
