"""The parts that fly a standard VTOL: those of a multirotor, those of a plane, and what joins them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.mock_pixhawk.flight.failsafe import Action, Failsafe
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.flight_modes import FlightMode
from firmware_bridge.mock_pixhawk.flight.mode_table import FlightModes
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.flight.stack import Handlers, MissionState, MultirotorStack, Say
from firmware_bridge.mock_pixhawk.ids import Cmd, Result, Severity
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.plane.plane_stack import PlaneModes, PlaneOffboard, PlaneStack, PlaneTelemetry
from firmware_bridge.mock_pixhawk.services.commands import Command
from firmware_bridge.mock_pixhawk.services.telemetry import Telemetry
from firmware_bridge.mock_pixhawk.vtol.transition import Regime
from firmware_bridge.mock_pixhawk.vtol.vtol_modes import VtolHold, VtolHome, VtolMode
from firmware_bridge.mock_pixhawk.vtol.vtol_navigator import VtolNavigator
from firmware_bridge.mock_pixhawk.vtol.vtol_pilot import VtolPilot

_QUAD_CHUTE = {0: Action.RETURN, 1: Action.LAND, 2: Action.HOLD}  # COM_QC_ACT; -1 only warns


class WingStack(PlaneStack):
    """The plane's parts. The nose of a hovering vehicle tells nothing about the wind."""

    wing_borne: Callable[[], bool]

    def flies(self) -> bool:
        return self.wing_borne()


class VtolOffboard(PlaneOffboard):
    """OFFBOARD: set-points of a multirotor in hover, of a plane on the wings."""

    def __init__(self, vtol: VtolPilot, *parts: Any) -> None:
        super().__init__(*parts)
        self._vtol = vtol

    def step(self, now_us: int) -> Mode | None:
        if self._vtol.transiting:
            self._vtol.step_transition(now_us)
            return None
        return super().step(now_us) if self._vtol.flies else Offboard.step(self, now_us)


class VtolModes:
    """Table of the flight modes of a VTOL."""

    def __init__(
        self,
        pilot: VtolPilot,
        navigator: VtolNavigator,
        offboard: VtolOffboard,
        hover: FlightModes,
        wing: PlaneModes,
        home: tuple[VtolHome, VtolHome],
    ) -> None:
        """`home`: return and landing on the wings."""
        self.guidance, self.navigator, self.offboard = pilot, navigator, offboard
        self.takeoff = hover.takeoff
        self.hold = VtolHold(pilot, hover.hold, wing.hold)
        to_return, to_land = home
        both = {mode: VtolMode(pilot, hover.by_mode[mode], wing.by_mode[mode]) for mode in hover.by_mode}
        self.by_mode: dict[Mode, FlightMode] = {
            **both,
            Mode.LOITER: self.hold,
            Mode.MISSION: navigator,
            Mode.OFFBOARD: offboard,
            Mode.RTL: VtolMode(pilot, hover.by_mode[Mode.RTL], to_return),
            Mode.LAND: VtolMode(pilot, hover.by_mode[Mode.LAND], to_land),
        }


class VtolFailsafe(Failsafe):
    """The failsafes of every vehicle, and the quad-chute: COM_QC_ACT."""

    def __init__(self, stack: VtolStack, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._stack = stack

    def armed(self, now_us: int) -> None:
        super().armed(now_us)
        self._stack.wing.engine.reset()
        self._stack.pilot.transition.reset()

    def check(self, now_us: int) -> Action | None:
        return super().check(now_us) or self._wings(now_us)

    def _wings(self, now_us: int) -> Action | None:
        pilot = self._stack.pilot
        if self._stack.pusher_failed(now_us):
            pilot.quad_chute(now_us, "pusher failure")
        pilot.watch(now_us)
        reason, pilot.new_failure = pilot.new_failure, None
        if reason is None:
            return None
        self._say(Severity.EMERGENCY, f"Failsafe activated: quad-chute, {reason}")
        return _QUAD_CHUTE.get(int(self._params["COM_QC_ACT"]))


class VtolTelemetry(PlaneTelemetry):
    """Telemetry of a plane, with the VTOL's state."""

    def __init__(self, pilot: VtolPilot, *args: Any, **settings: Any) -> None:
        self._pilot = pilot
        super().__init__(*args, **settings)

    def _extended_sys_state(self, cls: Any, now_us: int) -> Any:
        state = super()._extended_sys_state(cls, now_us)
        return state._replace(vtol_state=self._pilot.regime.value)

    def _throttle(self) -> float:
        pilot = self._pilot
        return max(self.controls[i] for i in (pilot.pushers if pilot.flies else pilot.lifters))


class VtolStack:
    """Parts that fly a standard VTOL."""

    def __init__(self, parts: FirmwareParts) -> None:
        core, vehicle, estimate, _, params, _ = self._parts = parts
        self.hover = MultirotorStack(parts)
        self.wing = WingStack(parts)
        hover, wing = self.hover.modes, self.wing.modes
        pilot = self.pilot = VtolPilot(core, vehicle, params, hover.guidance, self.wing.pilot)
        self.wing.wing_borne = lambda: pilot.flies
        navigator = VtolNavigator(pilot, parts, hover.navigator, wing.navigator)
        self._offboard = VtolOffboard(pilot, core, vehicle, estimate.ned, self.wing.pilot, params)
        home = VtolHome(pilot, vehicle, params, lands_here=False), VtolHome(pilot, vehicle, params, lands_here=True)
        self.modes = VtolModes(pilot, navigator, self._offboard, hover, wing, home)
        self.commands: Handlers = {Cmd.DO_VTOL_TRANSITION: self._transition}

    def observe(self, now_us: int) -> None:
        """Update the air data."""
        self.wing.observe(now_us)

    def outputs(self, now_us: int) -> list[float]:
        """Run the inner loops."""
        return self.pilot.commands(now_us)

    def pusher_failed(self, now_us: int) -> bool:
        """Return True at the moment in which the pusher is found to have failed on the wings."""
        return self.pilot.flies and self.wing.engine_failed(now_us)

    def failsafe(self, say: Say, *, hitl: bool) -> Failsafe:
        """Make the failsafes."""
        return VtolFailsafe(self, self._parts, self._offboard, say, hitl=hitl)

    def telemetry(self, mission: MissionState, *, system_type: int, hil: bool) -> Telemetry:
        """Make the telemetry."""
        wing = self.wing
        return VtolTelemetry(
            self.pilot, wing.air, wing.pilot.rotors, self._parts, mission, system_type=system_type, hil=hil
        )

    def _transition(self, command: Command, now_us: int) -> int:
        """DO_VTOL_TRANSITION: only armed and in flight."""
        pilot, vehicle = self.pilot, self._parts.vehicle
        if not vehicle.armed or vehicle.landed:
            return Result.DENIED
        if command.p1 == Regime.WING.value:
            done = pilot.flies or pilot.regime is Regime.FRONT or pilot.start_front(now_us)
        elif command.p1 == Regime.HOVER.value:
            done = pilot.regime in (Regime.HOVER, Regime.BACK) or pilot.start_back(now_us)
        else:
            return Result.DENIED
        return Result.ACCEPTED if done else Result.TEMPORARILY_REJECTED
