"""The common part of flights by mission and by companion: connecting, requests, phases, end.

A pure function of (simulated time, frames received): no I/O and no clock of its own, so that a run with it is as
repeatable as one without. An idle tick costs about a microsecond. The common phases:

    CONNECTING  until the vehicle's first heartbeat; then requests the necessary telemetry
    LANDED      on the ground and disarmed; one more second, for the vehicle's last messages
    DONE        only heartbeats
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any, ClassVar

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.commands import ACCEPTED, Commands
from firmware_bridge.ground_station.modes import firmware_of
from firmware_bridge.ground_station.procedure import Step, declined_for_now
from firmware_bridge.ground_station.progress import Progress
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name, refused
from signals.mission import MissionItem
from signals.time import NS_PER_S

_Heartbeat = message_class("HEARTBEAT")
_TYPE_GCS = 6
_AUTOPILOT_INVALID = 8
_STATE_ACTIVE = 4
_MAVLINK_VERSION = 3
_SAFETY_ARMED = 0x80

_PREARM_CHECK = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
# PX4 sets it in the health word but, from 1.14 on, never in the present one.
# A vehicle that does not report its pre-arm check gets the arm command after this time, repeated until it accepts.
_UNREPORTED_NS = 5 * NS_PER_S

_SET_MESSAGE_INTERVAL = 511
_SETTLE_NS = NS_PER_S
_RETRY_NS = NS_PER_S
_ARMINGS_LIMIT = 5
_INFO = 6  # MAV_SEVERITY
_ARMING_CHECKS = ("Arming denied", "Preflight Fail", "PreArm:", "Arm:")  # PX4's words, then ArduPilot's
_TEXTS_LIMIT = 1000  # bounds the memory for a vehicle that sends texts without end

_ARDUPILOT_CHECKS = ("PreArm:", "Arm:")
_SLOW_LOOP = (
    "its main loop is too fast for one sample a tick: set SCHED_LOOP_RATE to half of tick_hz at most, as the defaults "
    "file does that `hil run --print-command` writes"
)
# Texts of failed checks whose remedy lies in the set-up of the bench.
_REMEDIES = (("< loop rate", _SLOW_LOOP), ("Main loop slow", _SLOW_LOOP))


def _remedy(text: str) -> str:
    return next((f" ({remedy})" for part, remedy in _REMEDIES if part in text), "")


class Phase(Enum):
    """The phases in the order of a flight. No flight has all of them."""

    CONNECTING = "connecting"
    UPLOADING = "uploading"
    PREFLIGHT = "preflight"
    ARMING = "arming"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    DONE = "done"


class Heartbeats:
    """Sends the ground station's heartbeat once a simulated second, and keeps the vehicle's latest one.

    PX4 starts its data-link failsafe when the ground station's heartbeats stop.
    """

    def __init__(self, link: VehicleLink) -> None:
        self._link = link
        self.due_ns = 0
        self.connected = False
        self.armed = False
        self.has_armed = False  # once
        self.autopilot = 0  # MAV_AUTOPILOT
        self.vehicle_type = 0  # MAV_TYPE
        self.custom_mode = 0

    def on_heartbeat(self, message: Any) -> None:
        self.connected = True
        self.armed = bool(message.base_mode & _SAFETY_ARMED)
        self.has_armed |= self.armed
        self.autopilot, self.vehicle_type = message.autopilot, message.type
        self.custom_mode = message.custom_mode

    @property
    def firmware(self) -> Firmware:
        """Facts about the firmware of the vehicle."""
        return firmware_of(self.autopilot, self.vehicle_type)

    def step(self, t_ns: int) -> None:
        if t_ns >= self.due_ns:
            # From the previous due time, not from now: no drift if a tick does not fall on the second.
            self.due_ns += NS_PER_S * ((t_ns - self.due_ns) // NS_PER_S + 1)
            self._link.send(_Heartbeat(_TYPE_GCS, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, _MAVLINK_VERSION))


class Estimator:
    """Convergence of PX4's estimator, from ESTIMATOR_STATUS: several good reports in a row.

    A report is good if attitude, velocity and position are valid, nothing is wrong, and every innovation passes its
    test (ratio below 1).
    """

    INTERVAL_US = 250_000.0
    _ENOUGH = 8  # good reports in a row: 2 s
    _NEEDED: ClassVar = {0x1: "attitude", 0x2: "horizontal velocity", 0x4: "vertical velocity",
                         0x10: "horizontal position", 0x20: "vertical position"}  # fmt: skip
    _WRONG: ClassVar = {0x400: "GPS glitch", 0x800: "bad accelerometer data"}
    _RATIOS = ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")

    def __init__(self) -> None:
        self._good_reports = 0
        self._faults: list[str] | None = None  # None: no report yet

    def on_status(self, message: Any) -> None:
        flags = message.flags
        faults = [f"no {name}" for bit, name in self._NEEDED.items() if not flags & bit]
        faults += [name for bit, name in self._WRONG.items() if flags & bit]
        faults += [f"{name} {getattr(message, name):.1f}" for name in self._RATIOS if not getattr(message, name) < 1.0]
        self._faults = faults
        self._good_reports = 0 if faults else self._good_reports + 1

    @property
    def converged(self) -> bool:
        return self._good_reports >= self._ENOUGH

    def problem(self) -> str:
        """Describe why it has not converged."""
        if self._faults is None:
            return "its estimator does not report (ESTIMATOR_STATUS)"
        return f"its estimator has not converged ({', '.join(self._faults) or 'too few good reports in a row'})"


class Health:
    """The pre-arm bit of SYS_STATUS: PX4 sets it when every arming check passes. With `estimator`, that one too."""

    def __init__(self, estimator: Estimator | None = None) -> None:
        self._estimator = estimator
        self._reported = False
        self._healthy = False
        self._sensors_bad = 0
        self._since_ns: int | None = None

    def on_sys_status(self, message: Any) -> None:
        self._reported = bool(message.onboard_control_sensors_present & _PREARM_CHECK)
        self._healthy = bool(message.onboard_control_sensors_health & _PREARM_CHECK)
        self._sensors_bad = (
            message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health & ~_PREARM_CHECK
        )

    def ready(self, t_ns: int) -> bool:
        """Return True if the vehicle is ready to arm at `t_ns`, as far as it reports."""
        if self._estimator is not None and not self._estimator.converged:
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        if self._reported or self._healthy:
            return self._healthy
        return t_ns - self._since_ns >= _UNREPORTED_NS

    def problem(self) -> str:
        """Describe why the vehicle is not ready."""
        if self._estimator is not None and not self._estimator.converged:
            return self._estimator.problem()
        if not self._reported:
            return "it does not report its pre-arm check (SYS_STATUS)"
        sensors = f" (unhealthy sensors: {self._sensors_bad:#x} in SYS_STATUS)" if self._sensors_bad else ""
        return f"its pre-arm check does not pass{sensors}"


class StatusTexts:
    """STATUSTEXT messages as (t_ns, severity, text), long ones joined from their chunks.

    Arming checks that fail while the vehicle is still starting are not errors: their severity is INFO here.
    """

    def __init__(self) -> None:
        self.texts: list[tuple[int, int, str]] = []
        self._chunk_id = 0
        self._chunk_next = 0

    def on_statustext(self, t_ns: int, message: Any, *, starting: bool = False) -> None:
        if message.chunk_seq and message.id == self._chunk_id and message.chunk_seq == self._chunk_next and self.texts:
            first_ns, severity, text = self.texts[-1]
            self.texts[-1] = (first_ns, severity, text + message.text)
        elif len(self.texts) < _TEXTS_LIMIT:
            expected = starting and message.text.startswith(_ARMING_CHECKS)
            self.texts.append((t_ns, max(message.severity, _INFO) if expected else message.severity, message.text))
        self._chunk_id, self._chunk_next = message.id, message.chunk_seq + 1

    def failed_checks(self) -> str:
        """Return the latest different texts of ArduPilot's arming checks with their remedies; "" if there are none."""
        checks = [text.strip() for _, _, text in self.texts if text.startswith(_ARDUPILOT_CHECKS)]
        latest = list(dict.fromkeys(reversed(checks)))[:3]
        return " | ".join(text + _remedy(text) for text in latest)

    def said(self, part: str) -> bool:
        """Return True if a text holds `part`."""
        return any(part in text for _, _, text in self.texts)

    def last(self, count: int = 3) -> str:
        """Return the latest different texts, for an error message; "" if there are none."""
        latest = list(dict.fromkeys(text.strip() for _, _, text in reversed(self.texts)))[:count]
        return f"; it last said: {' | '.join(reversed(latest))}" if latest else ""


class RequestSequence:
    """Steps requested of the vehicle one after the other, each repeated while it is declined temporarily.

    Call `begin` with the steps, then `step` until it returns True. HandshakeError if the vehicle refuses a step.
    """

    def __init__(self, commands: Commands, heartbeats: Heartbeats, texts: StatusTexts) -> None:
        self._commands, self._heartbeats, self._texts = commands, heartbeats, texts
        self._steps: tuple[Step, ...] = ()
        self._requested: Step | None = None
        self._since_ns = self._limit_ns = 0
        self._armings = 0
        self.retry_ns: int | None = None  # when to request again

    def begin(self, t_ns: int, steps: Sequence[Step], limit_ns: int) -> None:
        """Start with these steps. `limit_ns`: for how long after `t_ns` a step may be declined temporarily."""
        self._steps = tuple(steps)
        self._requested = self.retry_ns = None
        self._since_ns, self._limit_ns = t_ns, limit_ns
        self._commands.result = None  # drop the answer to an earlier command

    def step(self, t_ns: int) -> bool:
        """Send the request that is due at `t_ns`. Return True when all steps are done."""
        while True:
            while self._steps and self._steps[0].arms and self._heartbeats.armed:
                self._next()
            if not self._steps:
                return True
            if self._commands.busy or (self.retry_ns is not None and t_ns < self.retry_ns):
                return False
            result, self._commands.result = self._commands.result, None
            requested, self._requested = self._requested, None
            if requested is not None and result == ACCEPTED and not requested.arms:
                self._next()
                continue
            if requested is not None and result is not None:
                self._wait(t_ns, requested, result)
                return False
            self.retry_ns = None
            self._requested = self._steps[0]
            self._commands.send(t_ns, self._requested.command, self._requested.params)
            return False

    def _next(self) -> None:
        self._steps = self._steps[1:]
        self._requested = self.retry_ns = None

    def _wait(self, t_ns: int, requested: Step, result: int) -> None:
        """Repeat the step in a second, or raise HandshakeError."""
        self.retry_ns = t_ns + _RETRY_NS
        if result == ACCEPTED:  # arming: the heartbeat shows the result
            self._armings += 1
            if self._armings > _ARMINGS_LIMIT:
                raise refused(
                    f"the vehicle has accepted arming {_ARMINGS_LIMIT} times, but its heartbeats never show it "
                    f"armed{self._texts.last()}"
                )
            return
        waited_ns = t_ns - self._since_ns
        if result not in declined_for_now(self._heartbeats.autopilot) or waited_ns >= self._limit_ns:
            raise refused(
                f"the vehicle was asked to {requested.description} and answered {enum_name('MAV_RESULT', result)} "
                f"{waited_ns / NS_PER_S:.1f} s after the first request{self._texts.last()}"
            )


class PhasedFlight:
    """A flight of vehicle `target_sysid`; None: the first autopilot that sends a heartbeat. Limits are simulated time.

    A HandshakeError names the request and the answer. With `grid_ns`, decisions fall on its multiples only,
    independently of when the frames for them came. With `needs_estimator` the vehicle is ready only once its estimator
    has converged (PX4's ESTIMATOR_STATUS), and in any case only once `may_arm` returns True. Set `expected` to the
    firmware of the vehicle to have another of its programs refused.
    """

    # (message, interval [us]): the telemetry that the phases wait for.
    _streams: Sequence[tuple[int, float]]

    def __init__(
        self,
        mission: Sequence[MissionItem],
        *,
        target_sysid: int | None = 1,
        heartbeat_limit_s: float = 30.0,
        preflight_limit_s: float = 60.0,
        takeoff_limit_s: float = 60.0,
        grid_ns: int = 0,
        needs_estimator: bool = False,
        may_arm: Callable[[], bool] = lambda: True,
    ) -> None:
        self._link = VehicleLink(target_sysid=target_sysid)
        self._heartbeat_limit_ns = round(heartbeat_limit_s * NS_PER_S)
        self._preflight_limit_ns = round(preflight_limit_s * NS_PER_S)
        self._takeoff_limit_ns = round(takeoff_limit_s * NS_PER_S)
        self._heartbeats = Heartbeats(self._link)
        self._commands = Commands(self._link)
        estimator = Estimator()
        self._health = Health(estimator if needs_estimator else None)
        self._progress = Progress(mission)
        self._texts = StatusTexts()
        self._requests = RequestSequence(self._commands, self._heartbeats, self._texts)
        self._grid_ns = grid_ns
        self.expected: Firmware | None = None
        self._grid_cell = -1  # of the last decision
        self.may_arm = may_arm
        self.phase = Phase.CONNECTING
        self._phase_since_ns = 0
        self._retry_ns: int | None = None  # when the phase is due again
        self._streams_requested = 0
        self._t_ns = 0
        self._started = False
        self._due_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._heartbeats.on_heartbeat,
            MSGID["COMMAND_ACK"]: lambda m: self._commands.on_ack(self._t_ns, m),
            MSGID["SYS_STATUS"]: self._health.on_sys_status,
            MSGID["EXTENDED_SYS_STATE"]: self._progress.on_extended_sys_state,
            MSGID["STATUSTEXT"]: self._on_statustext,
        }
        if needs_estimator:
            self._streams = (*self._streams, (MSGID["ESTIMATOR_STATUS"], estimator.INTERVAL_US))
            self._handlers[MSGID["ESTIMATOR_STATUS"]] = estimator.on_status

    def _on_statustext(self, message: Any) -> None:
        self._texts.on_statustext(self._t_ns, message, starting=not self._heartbeats.has_armed)

    @property
    def statustexts(self) -> list[tuple[int, int, str]]:
        """(t_ns, MAV_SEVERITY, text) of all texts of the vehicle."""
        return self._texts.texts

    @property
    def armed(self) -> bool:
        return self._heartbeats.armed

    def _decide(self, t_ns: int) -> None:
        """Advance through the phases as far as possible."""
        if not self._started:
            self._started = True
            self._heartbeats.due_ns = self._phase_since_ns = t_ns
        self._heartbeats.step(t_ns)
        cell = t_ns // self._grid_ns if self._grid_ns else -1
        decides = cell < 0 or cell != self._grid_cell
        self._grid_cell = cell
        before = None
        while decides and before is not self.phase:
            before = self.phase
            getattr(self, f"_{before.value}")(t_ns)  # each phase is a method
        self._commands.step(t_ns)
        dues = (
            self._heartbeats.due_ns,
            self._commands.due_ns,
            self._requests.retry_ns,
            self._retry_ns,
            (cell + 1) * self._grid_ns if self._grid_ns else None,
        )
        self._due_ns = min(due for due in dues if due is not None)

    def _decide_by(self, t_ns: int | None) -> None:
        """Make the next decision at `t_ns` at the latest."""
        if t_ns is not None:
            self._due_ns = min(self._due_ns, t_ns)

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase = phase
        self._phase_since_ns = t_ns
        self._retry_ns = None
        self._commands.result = None  # drop the answer to a command of the last phase

    def _connected(self, t_ns: int) -> bool:
        """Return True once the vehicle has sent a heartbeat and answered the requests for telemetry."""
        if not self._heartbeats.connected:
            if t_ns - self._phase_since_ns >= self._heartbeat_limit_ns:
                sysid = self._link.target_sysid
                raise refused(
                    f"no heartbeat of {f'vehicle {sysid}' if sysid else 'any autopilot'} within "
                    f"{self._heartbeat_limit_ns / NS_PER_S:g} s of simulated time; does it have another system id?"
                )
            return False
        self._check_program()
        if self._commands.busy:
            return False
        # A refused stream does no harm here: the phases that need it raise an error if it never comes.
        if self._streams_requested < len(self._streams):
            msgid, interval_us = self._streams[self._streams_requested]
            self._streams_requested += 1
            self._commands.send(t_ns, _SET_MESSAGE_INTERVAL, (float(msgid), interval_us))
            return False
        return True

    def _check_program(self) -> None:
        wanted, found = self.expected, self._heartbeats.firmware
        if wanted is None or wanted.mav_autopilot != found.mav_autopilot or wanted.program == found.program:
            return
        kind = enum_name("MAV_TYPE", self._heartbeats.vehicle_type)
        raise refused(
            f"the autopilot is {found.program} ({kind} in its heartbeat), and the vehicle of this bench needs "
            f"{wanted.program}: start that one"
        )

    def _check_preflight(self, t_ns: int, since_ns: int, problem: str) -> None:
        """Raise HandshakeError if the vehicle has not been ready since `since_ns` for too long."""
        if t_ns - since_ns >= self._preflight_limit_ns:
            checks = self._texts.failed_checks()
            why = f"{checks}; {problem}" if checks else f"{problem}{self._texts.last()}"
            raise refused(
                f"the vehicle is not ready to arm after {self._preflight_limit_ns / NS_PER_S:g} s of simulated time: "
                f"{why}"
            )

    def _check_takeoff(self, t_ns: int, hint: str = "") -> None:
        if t_ns - self._phase_since_ns >= self._takeoff_limit_ns:
            raise refused(
                f"armed, but not in the air after {self._takeoff_limit_ns / NS_PER_S:g} s of simulated time"
                f"{hint}{self._texts.last()}"
            )

    def _land_reached(self, t_ns: int) -> None:
        self._enter(Phase.LANDED, t_ns)
        self._retry_ns = t_ns + _SETTLE_NS

    def _landed(self, t_ns: int) -> None:
        if self._retry_ns is not None and t_ns >= self._retry_ns:
            self._enter(Phase.DONE, t_ns)

    def _done(self, t_ns: int) -> None:
        pass
