"""Arming, mode changes and the end of a flight, from commands and failsafes.

As PX4: while disarmed every mode may be chosen and the pre-flight checks decide on arming; while armed a mode must be
able to run. Refusals are sent as STATUSTEXT.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_bridge.mock_pixhawk.estimate.state import Estimate
from firmware_bridge.mock_pixhawk.flight.failsafe import Action, Failsafe
from firmware_bridge.mock_pixhawk.flight.preflight import BIAS, Preflight
from firmware_bridge.mock_pixhawk.flight.stack import Modes
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.ids import Result, Severity
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Home, Vehicle
from signals.time import US_PER_S

_READY_PERIOD_US = 100_000


@dataclass(frozen=True)
class Output:
    """Output functions for the commander."""

    say: Callable[[int, str], None]  # severity, text: STATUSTEXT
    silence: Callable[[], None]  # ends all output
    offboard_silence: bool  # as PX4 does, when OFFBOARD is selected while disarmed without set-points


class Commander:
    """Commander of one vehicle: arming, mode and the end of a flight."""

    def __init__(
        self,
        vehicle: Vehicle,
        estimate: Estimate,
        params: ParamTable,
        modes: Modes,
        preflight: Preflight,
        failsafe: Failsafe,
        output: Output,
        *,
        hitl: bool = False,
    ) -> None:
        self._vehicle, self._estimate, self._params = vehicle, estimate, params
        self._modes, self._guidance = modes, modes.guidance
        self._navigator, self._offboard = modes.navigator, modes.offboard
        self._preflight, self._failsafe = preflight, failsafe
        self._say, self._silence = output.say, output.silence
        self._offboard_silence = output.offboard_silence
        self._hitl = hitl
        self._bias_reported = False
        self._sensors_came = False  # all sensors have been healthy once, in HITL
        self.hold, self.takeoff = modes.hold, modes.takeoff
        self._next_ready_us = 0
        self._reported: set[str] = set()  # sensor failures already reported; membership only, never iterated

    # -- home ---------------------------------------------------------------------------------------------------

    def set_home_here(self) -> bool:
        """Set home to the current position. Return False if there is none."""
        estimate = self._estimate
        if not estimate.position_ok:
            return False
        n, e, d = estimate.p_NF
        self._vehicle.home = Home(*estimate.geodetic(n, e, d), n, e, d)
        return True

    def set_home(self, position: tuple[float, float, float] | None) -> bool:
        """Set home to (degrees, degrees, metres above sea level), or to the current position for None."""
        if position is None:
            return self.set_home_here()
        if not self._estimate.has_origin:
            return False
        self._vehicle.home = Home(*position, *self._estimate.ned(*position))
        return True

    # -- modes --------------------------------------------------------------------------------------------------

    def _runnable(self, mode: Mode, now_us: int) -> str | None:
        """Return why `mode` cannot run in flight, or None."""
        traits = mode.value
        if traits.needs_position and not self._estimate.position_ok:
            return "no valid position"
        if traits.needs_manual_control and not self._failsafe.manual_control_ok(now_us):
            return "no manual control input"
        if mode is Mode.MISSION:
            return self._navigator.infeasible()
        if mode is Mode.OFFBOARD and not self._offboard.fresh(now_us):
            return "no offboard setpoints"
        return None

    def set_mode(self, mode: Mode, now_us: int) -> int:
        """Change to the mode that an operator requests."""
        vehicle = self._vehicle
        if not vehicle.armed:
            vehicle.mode = mode
            if mode is Mode.OFFBOARD and self._offboard.last_us is None and self._offboard_silence:
                self._silence()
            return Result.ACCEPTED
        why = self._runnable(mode, now_us)
        if why is not None:
            self._say(Severity.CRITICAL, f"Switching to {mode.label} is currently not available: {why}")
            return Result.TEMPORARILY_REJECTED
        self._failsafe.operator_took_over()
        self._enter(mode, now_us)
        return Result.ACCEPTED

    def _enter(self, mode: Mode, now_us: int) -> None:
        vehicle = self._vehicle
        if vehicle.mode is Mode.MISSION and mode is not Mode.MISSION:
            self._navigator.stop()
        vehicle.mode = mode
        self._guidance.take_over()
        self._modes.by_mode[mode].start(now_us)

    def reposition(self, point: Point, speed_mps: float | None, yaw: float | None, now_us: int) -> int:
        """DO_REPOSITION: fly to `point` and hold there. Only in flight."""
        if not self._vehicle.armed or self._vehicle.landed:
            return Result.DENIED
        result = self.set_mode(Mode.LOITER, now_us)
        if result == Result.ACCEPTED:
            self.hold.go_to(point, speed_mps, yaw)
        return result

    # -- arming -------------------------------------------------------------------------------------------------

    def arm(self, now_us: int, *, force: bool = False) -> int:
        """Arm in the current mode, or send the reasons for refusal."""
        vehicle = self._vehicle
        if vehicle.armed:
            return Result.ACCEPTED
        if vehicle.terminated:
            self._say(Severity.CRITICAL, "Arming denied: flight terminated, reboot needed")
            return Result.TEMPORARILY_REJECTED
        mode = vehicle.mode
        if not mode.value.can_arm:
            self._say(Severity.CRITICAL, f"Arming denied: mode {mode.label} not suitable for takeoff")
            return Result.TEMPORARILY_REJECTED
        if not force:
            failures = self._preflight.failures(now_us, mode)
            why = self._runnable(mode, now_us) if not failures else None
            if why is not None:
                failures.append(why)
            if failures:
                self._say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
                for failure in failures:
                    self._say(Severity.CRITICAL, f"Preflight Fail: {failure}")
                return Result.TEMPORARILY_REJECTED
        self.set_home_here()
        vehicle.armed = True
        vehicle.armed_at_us = now_us
        vehicle.airborne = False
        self._failsafe.armed(now_us)
        self._say(Severity.INFO, "Armed by external command")
        self._enter(mode, now_us)
        return Result.ACCEPTED

    def disarm(self, now_us: int, *, force: bool = False) -> int:
        """Disarm; in the air only by force."""
        vehicle = self._vehicle
        if not vehicle.armed:
            return Result.ACCEPTED
        if not vehicle.landed and not force:
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.DENIED
        self._disarm(now_us, "Disarmed by external command")
        return Result.ACCEPTED

    def _disarm(self, now_us: int, text: str) -> None:
        vehicle = self._vehicle
        vehicle.armed = False
        vehicle.failsafe = False
        self._navigator.stop()
        self._guidance.off()
        self._say(Severity.INFO, text)
        if vehicle.mode in (Mode.LAND, Mode.RTL, Mode.TAKEOFF):
            vehicle.mode = Mode.LOITER  # the next flight starts in a mode that can arm
        self._next_ready_us = now_us

    def terminate(self, now_us: int) -> None:
        """Terminate the flight: motors off until the next boot.

        In lockstep PX4 falls silent in the air: its last reply has hover thrust and the armed bit.
        """
        vehicle = self._vehicle
        if vehicle.terminated:
            return
        vehicle.terminated = True
        self._say(Severity.EMERGENCY, "Flight termination active")
        if vehicle.armed and not vehicle.landed:
            self._navigator.stop()
            self._guidance.off()
            self._silence()
        elif vehicle.armed:
            self._disarm(now_us, "Disarmed by flight termination")

    # -- every guidance step ------------------------------------------------------------------------------------

    def step(self, now_us: int) -> None:
        """Run the checks, the failsafes, the current mode and automatic disarming."""
        vehicle = self._vehicle
        if now_us >= self._next_ready_us:
            self._next_ready_us = now_us + _READY_PERIOD_US
            self._check_ready(now_us)
        if not vehicle.armed or vehicle.terminated:
            return
        self._act(self._failsafe.check(now_us), now_us)
        if not vehicle.armed or vehicle.terminated:
            return
        if self._failsafe.descending_blind:
            self._guidance.descend_blind()
        else:
            following = self._modes.by_mode[vehicle.mode].step(now_us)
            if following is not None:
                self._enter(following, now_us)
                self._modes.by_mode[following].step(now_us)
        self._auto_disarm(now_us)

    def _check_ready(self, now_us: int) -> None:
        vehicle = self._vehicle
        if vehicle.home is None:
            self.set_home_here()
        vehicle.ready = not self._preflight.failures(now_us, Mode.LOITER)
        self._check_arrivals()
        if vehicle.armed:
            return
        failures = self._preflight.sensor_failures(now_us)
        if self._hitl and not failures:
            self._sensors_came = True
            self._reported.clear()
        for failure in failures:
            # Missing samples are not reported before the bench has connected.
            is_new = failure.endswith("STALE") or self._sensors_came
            if is_new and failure not in self._reported:
                self._reported.add(failure)
                self._say(Severity.CRITICAL, f"Preflight Fail: {failure}")

    def _check_arrivals(self) -> None:
        bad = self._preflight.arrivals_bad
        if bad and not self._bias_reported:
            self._say(Severity.CRITICAL, BIAS if self._vehicle.armed else f"Preflight Fail: {BIAS}")
        self._bias_reported = bad

    def _act(self, action: Action | None, now_us: int) -> None:
        if action is None:
            return
        vehicle = self._vehicle
        if action is Action.TERMINATE:
            self.terminate(now_us)
            return
        if action is Action.DISARM:
            self._disarm(now_us, "Failsafe: disarmed")
            return
        vehicle.failsafe = True
        mode = {Action.HOLD: Mode.LOITER, Action.RETURN: Mode.RTL, Action.LAND: Mode.LAND}[action]
        if vehicle.landed:
            self._disarm(now_us, "Failsafe on the ground: disarmed")
        elif vehicle.mode is not mode:
            self._enter(mode, now_us)

    def _auto_disarm(self, now_us: int) -> None:
        vehicle = self._vehicle
        if not vehicle.landed:
            if not vehicle.airborne:
                vehicle.airborne = True
                self._say(Severity.INFO, "Takeoff detected")
            return
        if vehicle.airborne:
            wait = self._params["COM_DISARM_LAND"]
            since, text = vehicle.landed_since_us, "Disarmed by landing"
        else:
            wait = self._params["COM_DISARM_PRFLT"]
            since, text = vehicle.armed_at_us, "Disarmed by auto preflight disarming"
        if wait > 0.0 and now_us - since >= int(wait * US_PER_S):
            self._disarm(now_us, text)
