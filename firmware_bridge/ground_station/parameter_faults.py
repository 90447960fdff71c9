"""Makes faults of sensors that the firmware simulates itself, by its parameters: set at the begin, put back at the end.

A pure function of (simulated time, frames received), as the ground station is.

    read     before the first fault, from the vehicle's first heartbeat on: every parameter, for its name in this
             firmware and its value. A name that no answer comes to is one that the firmware does not have
    set      in the tick in which a fault begins or ends, and every 0.1 s while one drifts. Firmware in lockstep takes
             it in the step of that tick
    confirm  the firmware reports the value. Otherwise it is set again, and then the run ends

Several faults of one parameter: offsets add up, and of values that are held the last fault's counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from firmware_bridge.autopilots.intake import Change, Held
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.modes import firmware_of
from firmware_bridge.ground_station.vehicle_link import VehicleLink, param_as_held, param_as_read, param_as_sent
from signals.errors import HandshakeError
from signals.time import NS_PER_MS, NS_PER_S

_ParamRequestRead = message_class("PARAM_REQUEST_READ")
_ParamSet = message_class("PARAM_SET")

_COMPID = 26  # MAV_COMP_ID_USER2
_TRIES = 5
_READ_AGAIN_NS = NS_PER_S
_SET_AGAIN_NS = NS_PER_S // 2
_RAMP_NS = 100 * NS_PER_MS
_HEARTBEAT_LIMIT_NS = 30 * NS_PER_S  # from when a fault begins
_NEVER_NS = 1 << 62


class ParameterFault(NamedTuple):
    """A fault that parameters make: `text` names it ("gps: dropout").

    It holds from `begin_ns` to `end_ns` (None: no end) and offsets by `offset` + `rate_per_s` (t - begin), in the unit
    of the sensor's field.
    """

    text: str
    begin_ns: int
    end_ns: int | None
    changes: tuple[Change, ...]
    offset: float = 0.0
    rate_per_s: float = 0.0


@dataclass(eq=False)
class _Parameter:
    """A parameter of the firmware. `names`: its names in different versions, `why`: a fault that needs it."""

    names: tuple[str, ...]
    why: str
    due_ns: int = 0  # of the next request
    tries: int = 0
    name: str = ""  # once it is known, with the following
    kind: int = 0  # MAV_PARAM_TYPE
    original: float = 0.0
    wanted: float = 0.0
    unconfirmed_ns: int | None = None  # since then `wanted` is not confirmed


@dataclass
class _State:
    """A fault and its progress."""

    fault: ParameterFault
    parameters: list[_Parameter]
    active: bool = False
    ended: bool = False
    record: dict[str, Any] = field(default_factory=dict)


class ParameterFaults:
    """Sends the requests of all faults. `on_event(t_ns, kind, text)` gets their begin and end.

    `altitude_m`: of the vehicle's start above mean sea level.
    """

    def __init__(self, *, altitude_m: float, on_event: Callable[[int, str, str], None]) -> None:
        self._link = VehicleLink(target_sysid=None, compid=_COMPID)
        self._altitude_m = altitude_m
        self._on_event = on_event
        self._parameters: dict[tuple[str, ...], _Parameter] = {}
        self._states: list[_State] = []
        self._bytewise: bool | None = None  # None: no heartbeat yet
        self._t_ns = 0
        self._due_ns = 0
        self._handlers: dict[int, Callable[[Any], None]] = {
            MSGID["HEARTBEAT"]: self._on_heartbeat,
            MSGID["PARAM_VALUE"]: self._on_param_value,
        }

    @property
    def records(self) -> list[dict[str, Any]]:
        """The parameters that were set, for run.json: one entry for each fault that has begun."""
        return [state.record for state in self._states if state.record]

    def expect(self, text: str, changes: Sequence[Change]) -> list[_Parameter]:
        """Read the parameters of a fault that may begin later."""
        found = []
        for change in changes:
            names = tuple(spelling.name for spelling in change)
            found.append(self._parameters.setdefault(names, _Parameter(names, text)))
        self._due_ns = 0
        return found

    def add(self, fault: ParameterFault) -> None:
        """Add a fault, now or in the future."""
        self._states.append(_State(fault, self.expect(fault.text, fault.changes)))

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`; return the bytes to send. HandshakeError if the firmware does not follow."""
        self._t_ns = t_ns
        if not self._link.dispatch(frames, self._handlers) and t_ns < self._due_ns:
            return b""
        if self._bytewise is None:
            self._check_heartbeat(t_ns)
            return b""
        for state in self._states:
            self._update(state, t_ns)
        for parameter in self._parameters.values():
            if parameter.name:
                self._set(parameter, t_ns)
            else:
                self._read(parameter, t_ns)
        self._due_ns = self._wake_ns(t_ns)
        return self._link.take()

    def check_confirmed(self) -> None:
        """Raise HandshakeError if, a second after it was to be set, a parameter is not confirmed."""
        for parameter in self._parameters.values():
            since_ns = parameter.unconfirmed_ns
            if since_ns is not None and self._t_ns - since_ns >= NS_PER_S:
                raise self._not_confirmed(parameter)
        for state in self._states:
            if not (state.active or state.ended) and self._t_ns - state.fault.begin_ns >= NS_PER_S:
                raise self._never_began(state.fault)

    # -- faults -------------------------------------------------------------------------------------------------

    def _update(self, state: _State, t_ns: int) -> None:
        """Begin or end a fault whose parameters are known."""
        fault = state.fault
        over = fault.end_ns is not None and t_ns >= fault.end_ns
        if state.ended or (t_ns < fault.begin_ns and not state.active):
            return
        if not state.active:
            if over:
                raise self._never_began(fault)
            if all(parameter.name for parameter in state.parameters):
                state.active = True
                state.record = {
                    "fault": fault.text,
                    "began_s": t_ns / NS_PER_S,
                    "ended_s": None,
                    "parameters": {p.name: self._value(p, t_ns) for p in state.parameters},
                }
                self._report(state, "drift from" if fault.rate_per_s else "set to")
        elif over:
            state.active, state.ended = False, True
            state.record["ended_s"] = t_ns / NS_PER_S
            self._report(state, "ended, back to")

    def _report(self, state: _State, what: str) -> None:
        values = ", ".join(f"{p.name} {self._value(p, self._t_ns):g}" for p in state.parameters)
        self._on_event(self._t_ns, "fault", f"{state.fault.text} by parameters of the firmware, {what}: {values}")

    def _value(self, parameter: _Parameter, t_ns: int) -> float:
        """Return the value that a parameter should have now, as the firmware stores it."""
        value, held = parameter.original, None
        for state in self._states:
            if not state.active or parameter not in state.parameters:
                continue
            fault = state.fault
            change = fault.changes[state.parameters.index(parameter)][parameter.names.index(parameter.name)]
            if isinstance(change, Held):
                held = change.value
            else:
                steps = (t_ns - fault.begin_ns) // _RAMP_NS  # of a drift
                offset = fault.offset + fault.rate_per_s * (steps * _RAMP_NS / NS_PER_S)
                value += change.convert(offset, self._altitude_m) if offset else 0.0
        wanted = value if held is None else held
        stored = param_as_held(wanted, parameter.kind)
        if stored is None:
            raise HandshakeError(
                parameter.why, f"the firmware's {parameter.name} takes a whole number of 32 bits, not {wanted:g}"
            )
        return stored

    def _wake_ns(self, t_ns: int) -> int:
        """Return the time of the next step that is due without frames."""
        wake = [
            parameter.due_ns
            for parameter in self._parameters.values()
            if not parameter.name or parameter.unconfirmed_ns is not None
        ]
        for state in self._states:
            fault = state.fault
            if state.active and fault.rate_per_s:
                wake.append(t_ns + _RAMP_NS - (t_ns - fault.begin_ns) % _RAMP_NS)
            if not state.ended:
                edge_ns = fault.end_ns if state.active else fault.begin_ns
                wake.append(_NEVER_NS if edge_ns is None else max(edge_ns, t_ns))
        return min(wake, default=_NEVER_NS)

    # -- requests -----------------------------------------------------------------------------------------------

    def _read(self, parameter: _Parameter, t_ns: int) -> None:
        if t_ns < parameter.due_ns:
            return
        if parameter.tries >= _TRIES:
            names = " or ".join(parameter.names)
            raise HandshakeError(
                parameter.why,
                f"the firmware has no parameter {names} (no answer to {_TRIES} requests), so it cannot have this "
                "fault: take the fault out, or fly a version of the firmware that has it",
            )
        parameter.tries += 1
        parameter.due_ns = t_ns + _READ_AGAIN_NS
        link = self._link
        for name in parameter.names:
            link.send(_ParamRequestRead(link.target_sysid, link.target_compid, name, -1))

    def _set(self, parameter: _Parameter, t_ns: int) -> None:
        wanted = self._value(parameter, t_ns)
        if wanted != parameter.wanted:
            parameter.wanted, parameter.tries, parameter.due_ns = wanted, 0, t_ns
            if parameter.unconfirmed_ns is None:
                parameter.unconfirmed_ns = t_ns
        if parameter.unconfirmed_ns is None or t_ns < parameter.due_ns:
            return
        if parameter.tries >= _TRIES or t_ns - parameter.unconfirmed_ns > _TRIES * _SET_AGAIN_NS:
            raise self._not_confirmed(parameter)
        parameter.tries += 1
        parameter.due_ns = t_ns + _SET_AGAIN_NS
        link = self._link
        carried = param_as_sent(wanted, parameter.kind, bytewise=bool(self._bytewise))
        link.send(_ParamSet(link.target_sysid, link.target_compid, parameter.name, carried, parameter.kind))

    def _not_confirmed(self, parameter: _Parameter) -> HandshakeError:
        return HandshakeError(
            parameter.why,
            f"the firmware's {parameter.name} was set to {parameter.wanted:g} and did not become it: is it refused, or "
            "set by another client?",
        )

    def _never_began(self, fault: ParameterFault) -> HandshakeError:
        return HandshakeError(
            fault.text,
            f"was to begin at {fault.begin_ns / NS_PER_S:g} s, but the firmware had not answered yet to a request for "
            "its parameters: let the fault begin later",
        )

    # -- messages of the vehicle --------------------------------------------------------------------------------

    def _check_heartbeat(self, t_ns: int) -> None:
        begin_ns = min((state.fault.begin_ns for state in self._states), default=_NEVER_NS)
        if t_ns - begin_ns >= _HEARTBEAT_LIMIT_NS:
            raise HandshakeError(
                self._states[0].fault.text,
                "the vehicle has sent no heartbeat, so no parameter of it can be set: is its MAVLink connected?",
            )
        self._due_ns = begin_ns + _HEARTBEAT_LIMIT_NS

    def _on_heartbeat(self, message: Any) -> None:
        self._bytewise = firmware_of(message.autopilot).bytewise_params

    def _on_param_value(self, message: Any) -> None:
        for parameter in self._parameters.values():
            if message.param_id not in (parameter.names if not parameter.name else (parameter.name,)):
                continue
            value = param_as_read(message.param_value, message.param_type, bytewise=bool(self._bytewise))
            if not parameter.name:
                parameter.name, parameter.kind = message.param_id, message.param_type
                parameter.original = parameter.wanted = value
            elif value == parameter.wanted:
                parameter.unconfirmed_ns = None
