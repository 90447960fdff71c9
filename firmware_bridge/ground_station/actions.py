"""Carries out a mission script: actions at simulated times, or after events of the vehicle.

A pure function of (simulated time, frames received), as the ground station is: no I/O and no clock of its own. It has
its own component id on the ground station's system, so that answers to script and station cannot be confused.

Requests to the autopilot are made one after the other, in the order in which they fall due, each until it has been
answered; an `Effect` (a gust, a fault) takes place at its instant, independently of them. No request is sent before the
vehicle's first heartbeat, which identifies the autopilot, and with it the numbers of modes and parameters.

    command     repeated each second without an answer or while it is rejected temporarily, five times
    mode        DO_SET_MODE with the numbers of this autopilot
    parameter   read first, for its type, then set; done when the autopilot echoes the value
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.commands import ACCEPTED, TEMPORARILY_REJECTED, Commands
from firmware_bridge.ground_station.modes import firmware_of, mode_params, mode_word
from firmware_bridge.ground_station.vehicle_link import (
    VehicleLink,
    enum_name,
    param_as_held,
    param_as_read,
    param_as_sent,
)
from signals.errors import HandshakeError
from signals.time import NS_PER_S

_ParamRequestRead = message_class("PARAM_REQUEST_READ")
_ParamSet = message_class("PARAM_SET")

SCRIPT_COMPID = 25  # MAV_COMP_ID_USER1, which ground stations and SDKs do not use
_DO_SET_MODE = 176
_SAFETY_ARMED = 0x80
_LANDED_ON_GROUND = 1
_LANDED_IN_AIR = (2, 3, 4)  # in the air, taking off, landing

_TRIES = 5
_RETRY_NS = NS_PER_S
_HEARTBEAT_LIMIT_NS = 30 * NS_PER_S  # from when an action is due


class VehicleEvent(NamedTuple):
    """An event that the autopilot reports. Only its first report counts.

    `kind`: armed, disarmed, takeoff, landed, item (mission item `number` reached) or mode (changed to `word`).
    """

    kind: str
    number: int = 0
    word: str = ""


class SetMode(NamedTuple):
    """Enter the mode named `word` (see `modes`)."""

    word: str


class SetParam(NamedTuple):
    """Set a parameter."""

    name: str
    value: float


class RunCommand(NamedTuple):
    """Send a COMMAND_LONG with up to seven parameters; the others are zero."""

    command: int
    params: tuple[float, ...]


class Effect(NamedTuple):
    """Change the simulated world: `run` is called with the simulated time [ns]."""

    run: Callable[[int], None]


class Action(NamedTuple):
    """One entry of a script: what to do, at `at_ns` or `delay_ns` after an event.

    `name` is for messages ('flight.yaml:12: set_mode HOLD'). An action that is not `required` may be refused.
    """

    name: str
    do: SetMode | SetParam | RunCommand | Effect
    at_ns: int | None = None
    after: VehicleEvent | None = None
    delay_ns: int = 0
    required: bool = True


class Record(NamedTuple):
    """The result of an action: when it began [ns], and its outcome."""

    name: str
    required: bool
    t_ns: int | None  # None: it was never due
    outcome: str  # waiting, running, done or refused


class _Job(Protocol):
    """An action under way. `step` returns True when it is done; HandshakeError if it is refused."""

    @property
    def due_ns(self) -> int: ...

    def step(self, t_ns: int) -> bool: ...


class ActionSource:
    """Carries out `actions`. A required one that is refused ends the run with a HandshakeError that names it.

    `first_item` is the autopilot's number of the mission's first item (1 where home is item 0).
    `on_event(t_ns, kind, text)` gets the begin of each action, and other refusals. Requests wait until
    `may_begin` is True.
    """

    def __init__(
        self,
        actions: Sequence[Action],
        *,
        target_sysid: int | None = 1,
        first_item: int = 0,
        on_event: Callable[[int, str, str], None] | None = None,
        may_begin: Callable[[], bool] = lambda: True,
    ) -> None:
        self._actions = tuple(actions)
        self._link = VehicleLink(target_sysid=target_sysid, compid=SCRIPT_COMPID)
        self._commands = Commands(self._link)
        self._first_item = first_item
        self._on_event = on_event
        self._may_begin = may_begin
        self._due: list[tuple[int, int]] = []
        self._waiting: dict[VehicleEvent, list[int]] = {}
        for index, action in enumerate(self._actions):
            if action.after is not None:
                self._waiting.setdefault(action.after, []).append(index)
            else:
                heapq.heappush(self._due, (action.at_ns or 0, index))
        self._queue: deque[tuple[int, int]] = deque()  # (due time, index)
        self._running: tuple[int, _Job] | None = None  # index of the action, and its exchange with the vehicle
        self._began_ns: list[int | None] = [None] * len(self._actions)
        self._outcome = ["waiting"] * len(self._actions)
        self._autopilot: int | None = None
        self._vehicle_type = 0  # MAV_TYPE
        self._armed = False
        self._custom_mode: int | None = None
        self._flown = False
        self._t_ns = 0
        self._next_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._on_heartbeat,
            MSGID["COMMAND_ACK"]: lambda m: self._commands.on_ack(self._t_ns, m),
            MSGID["PARAM_VALUE"]: self._on_param_value,
            MSGID["MISSION_ITEM_REACHED"]: lambda m: self._on_vehicle_event(
                VehicleEvent("item", m.seq - self._first_item)
            ),
            MSGID["EXTENDED_SYS_STATE"]: self._on_extended_sys_state,
        }

    @property
    def records(self) -> list[Record]:
        """The results of all actions so far, in the order of the script."""
        columns = zip(self._actions, self._began_ns, self._outcome, strict=True)
        return [Record(action.name, action.required, t_ns, outcome) for action, t_ns, outcome in columns]

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`; return the bytes to send at `t_ns`."""
        self._t_ns = t_ns
        if not self._link.dispatch(frames, self._handlers) and t_ns < self._next_ns:
            return b""
        while self._due and self._due[0][0] <= t_ns:
            due_ns, index = heapq.heappop(self._due)
            do = self._actions[index].do
            if isinstance(do, Effect):
                self._begin(index, t_ns)
                do.run(t_ns)
                self._outcome[index] = "done"
            else:
                self._queue.append((due_ns, index))
        while self._work(t_ns):
            pass
        self._next_ns = self._wake_ns()
        return self._link.take()

    def _work(self, t_ns: int) -> bool:
        """Continue the action under way, or begin the next one. Return False when there is no more to do now."""
        if self._running is None:
            if not self._queue:
                return False
            due_ns, index = self._queue[0]
            if self._autopilot is None:
                if t_ns - due_ns < _HEARTBEAT_LIMIT_NS:
                    return False
                self._queue.popleft()
                self._refuse(index, t_ns, "the vehicle has sent no heartbeat, so there is no autopilot to send it to")
                return True
            if not self._may_begin():
                return False
            self._queue.popleft()
            self._begin(index, t_ns)
            try:
                self._running = index, self._start(self._actions[index], self._autopilot, t_ns)
            except HandshakeError as error:
                self._end(index, t_ns, error)
                return True
        index, job = self._running
        try:
            done = job.step(t_ns)
        except HandshakeError as error:
            self._end(index, t_ns, error)
            return True
        if done:
            self._outcome[index] = "done"
            self._running = None
        return done

    def _start(self, action: Action, autopilot: int, t_ns: int) -> _Job:
        do = action.do
        if isinstance(do, SetMode):
            return _CommandJob(self._commands, _DO_SET_MODE, mode_params(autopilot, do.word, self._vehicle_type), t_ns)
        if isinstance(do, SetParam):
            return _ParamJob(self._link, do, bytewise=firmware_of(autopilot).bytewise_params, t_ns=t_ns)
        assert isinstance(do, RunCommand)
        return _CommandJob(self._commands, do.command, do.params, t_ns)

    def _begin(self, index: int, t_ns: int) -> None:
        self._began_ns[index] = t_ns
        self._outcome[index] = "running"
        self._report(t_ns, "action", self._actions[index].name)

    def _end(self, index: int, t_ns: int, error: HandshakeError) -> None:
        self._running = None
        self._refuse(index, t_ns, str(error).removeprefix(f"{error.port}: "))

    def _refuse(self, index: int, t_ns: int, why: str) -> None:
        action = self._actions[index]
        self._outcome[index] = "refused"
        if action.required:
            raise HandshakeError("mission script", f"{action.name}: {why} (`required: false` lets the flight continue)")
        self._report(t_ns, "warning", f"{action.name}: {why}")

    def _report(self, t_ns: int, kind: str, text: str) -> None:
        if self._on_event is not None:
            self._on_event(t_ns, kind, text)

    def _wake_ns(self) -> int:
        """Return the time of the next step that is due without frames."""
        wake = [self._due[0][0]] if self._due else []
        if self._running is not None:
            wake.append(self._running[1].due_ns)
        elif self._queue:
            wake.append(self._queue[0][0] + _HEARTBEAT_LIMIT_NS)
        return min(wake, default=1 << 62)

    # -- messages of the vehicle --------------------------------------------------------------------------------

    def _on_vehicle_event(self, event: VehicleEvent) -> None:
        for index in self._waiting.pop(event, ()):
            heapq.heappush(self._due, (self._t_ns + self._actions[index].delay_ns, index))

    def _on_heartbeat(self, message: Any) -> None:
        self._autopilot, self._vehicle_type = message.autopilot, message.type
        armed = bool(message.base_mode & _SAFETY_ARMED)
        if armed != self._armed:
            self._armed = armed
            self._on_vehicle_event(VehicleEvent("armed" if armed else "disarmed"))
        if message.custom_mode != self._custom_mode:
            first, self._custom_mode = self._custom_mode is None, message.custom_mode
            if not first:
                word = mode_word(message.autopilot, message.custom_mode, message.type)
                self._on_vehicle_event(VehicleEvent("mode", word=word))

    def _on_extended_sys_state(self, message: Any) -> None:
        if message.landed_state in _LANDED_IN_AIR:
            if not self._flown:
                self._flown = True
                self._on_vehicle_event(VehicleEvent("takeoff"))
        elif message.landed_state == _LANDED_ON_GROUND and self._flown:
            self._on_vehicle_event(VehicleEvent("landed"))

    def _on_param_value(self, message: Any) -> None:
        if self._running is not None and isinstance(job := self._running[1], _ParamJob):
            job.on_value(self._t_ns, message)


class _CommandJob:
    """Sends a command until it is accepted."""

    def __init__(self, commands: Commands, command: int, params: tuple[float, ...], t_ns: int) -> None:
        self._commands, self._command, self._params = commands, command, params
        self._rejections = 0
        self._retry_ns: int | None = None
        commands.send(t_ns, command, params)

    @property
    def due_ns(self) -> int:
        due = self._retry_ns if self._retry_ns is not None else self._commands.due_ns
        assert due is not None
        return due

    def step(self, t_ns: int) -> bool:
        commands = self._commands
        if self._retry_ns is not None:
            if t_ns >= self._retry_ns:
                self._retry_ns = None
                commands.send(t_ns, self._command, self._params)
            return False
        if commands.busy:
            commands.step(t_ns)
            return False
        if commands.result == ACCEPTED:
            return True
        self._rejections += 1
        if commands.result != TEMPORARILY_REJECTED or self._rejections >= _TRIES:
            assert commands.result is not None
            result = enum_name("MAV_RESULT", commands.result)
            tries = f"sent {self._rejections} times, " if self._rejections > 1 else ""
            raise HandshakeError("mission script", f"{tries}the autopilot answered {result}")
        self._retry_ns = t_ns + _RETRY_NS
        return False


class _ParamJob:
    """Reads the parameter for its type, sets it, and waits for the echo."""

    def __init__(self, link: VehicleLink, wanted: SetParam, *, bytewise: bool, t_ns: int) -> None:
        self._link, self._wanted, self._bytewise = link, wanted, bytewise
        self._kind: int | None = None  # MAV_PARAM_TYPE, once it is known
        self._value = 0.0  # as the autopilot can store it
        self._done = False
        self._error: HandshakeError | None = None
        self._tries = 0
        self.due_ns = t_ns

    def step(self, t_ns: int) -> bool:
        if self._error is not None:
            raise self._error
        if self._done or t_ns < self.due_ns:
            return self._done
        if self._tries >= _TRIES:
            name = self._wanted.name
            if self._kind is None:
                raise HandshakeError(
                    "mission script",
                    f"no answer to {_TRIES} requests for the parameter {name}: does the firmware have it?",
                )
            raise HandshakeError(
                "mission script", f"{name} was set {_TRIES} times and never became {self._value:g}: is it out of range?"
            )
        self._tries += 1
        self.due_ns = t_ns + _RETRY_NS
        link, name = self._link, self._wanted.name
        if self._kind is None:
            link.send(_ParamRequestRead(link.target_sysid, link.target_compid, name, -1))
        else:
            sent_value = param_as_sent(self._value, self._kind, bytewise=self._bytewise)
            link.send(_ParamSet(link.target_sysid, link.target_compid, name, sent_value, self._kind))
        return False

    def on_value(self, t_ns: int, message: Any) -> None:
        if message.param_id != self._wanted.name:
            return
        if self._kind is None:
            wanted, self._kind = self._wanted, message.param_type
            stored = param_as_held(wanted.value, message.param_type)
            if stored is None:  # raised in `step`, which ends this action
                text = f"{wanted.name} takes a whole number of 32 bits, not {wanted.value:g}"
                self._error = HandshakeError("mission script", text)
            self._value = stored or 0.0
            self._tries = 0
            self.due_ns = t_ns
        elif param_as_read(message.param_value, self._kind, bytewise=self._bytewise) == self._value:
            self._done = True
