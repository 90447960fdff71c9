"""Compares the autopilot's parameters with the values that the bench gave it, before it may arm.

Of others it is checked only that they exist: those that a script sets during the flight.

Each parameter is read by name (PARAM_REQUEST_READ, answered by PARAM_VALUE), and again each second while there is no
answer or another value: firmware loads its parameters while it boots. If one stays unanswered, the whole list is read:
it tells a misspelt name, for which it has the nearest, from answers that were lost.

Parameters of a file are compared with the whole list, which PX4 restricts to those that its modules use, once these
have had time to start. What does not hold is told and does no harm: the file may be of another build.

A pure function of (simulated time, frames received), as the ground station is, with a component id of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.vehicle_link import VehicleLink, param_as_held, param_as_read
from signals.documents.validate import nearest
from signals.errors import ConfigError, HandshakeError, Problem
from signals.time import NS_PER_S

_RequestRead = message_class("PARAM_REQUEST_READ")
_RequestList = message_class("PARAM_REQUEST_LIST")

_COMPID = 27  # MAV_COMP_ID_USER3, which ground stations and SDKs do not use
_TRIES = 5
_RETRY_NS = NS_PER_S
_AT_ONCE = 10  # ArduPilot queues 20 requests and drops the others
_LIST_GAP_NS = 4 * NS_PER_S  # without another parameter, after which the list is taken as complete
_LIST_LIMIT_NS = 40 * NS_PER_S
_START_NS = 5 * NS_PER_S  # for the modules of a firmware, from its first heartbeat on
_SHOWN = 10  # names of a finding
_REAL32_STEP = 1.2e-7  # two neighbouring values of 32 bits, relative to them: firmware reads decimals its own way
_REAL32 = 9  # MAV_PARAM_TYPE


class Reported(NamedTuple):
    """A parameter as the autopilot reports it."""

    value: float
    kind: int  # MAV_PARAM_TYPE


class ParameterCheck:
    """Compares with `wanted` (name -> value). A command source: `step` returns the requests.

    `named`: parameters that must exist, with the place that names each, for messages. `of_file`: those that the
    firmware need not have; `finding` says then how many of them hold.

    `step` raises ConfigError if a parameter does not exist or has another value, HandshakeError if none is reported.
    """

    def __init__(
        self,
        wanted: Mapping[str, float],
        firmware: Firmware,
        named: Mapping[str, str] | None = None,
        of_file: Mapping[str, float] | None = None,
    ) -> None:
        self._wanted: dict[str, float | None] = dict.fromkeys(named or ()) | dict(wanted)
        self._named = {name: where for name, where in (named or {}).items() if name not in wanted}
        self._firmware = firmware
        self._of_file = dict(of_file or {})
        self.finding = ""
        self._heard_ns: int | None = None  # first heartbeat
        self._link = VehicleLink(target_sysid=None, compid=_COMPID)
        self._reported: dict[str, Reported] = {}
        self._tries = dict.fromkeys(self._wanted, 0)
        self._asked: list[str] = []
        self._due_ns = 0
        self._t_ns = 0
        self._list_ns: int | None = None  # since then the list is read; None: it is not
        self._came_ns = 0  # the newest PARAM_VALUE
        self._count = 0  # parameters that the autopilot says it has
        self._handlers = {MSGID["HEARTBEAT"]: lambda _: None, MSGID["PARAM_VALUE"]: self._on_value}
        self._strict_done = not self._wanted
        self.done = self._strict_done and not self._of_file

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Take last tick's `frames`; return the requests to send at `t_ns`."""
        if self.done:
            return b""
        self._t_ns = t_ns
        changed = self._link.dispatch(frames, self._handlers)
        if not self._link.target_sysid or not (changed or t_ns >= self._due_ns):
            return b""
        if self._heard_ns is None:
            self._heard_ns = t_ns
        if self._list_ns is not None:
            self._read_list(t_ns, self._list_ns)
        elif not self._strict_done:
            self._read(t_ns)
        elif t_ns >= self._heard_ns + _START_NS:
            self._request_list(t_ns)
        return self._link.take()

    def _open(self) -> list[str]:
        """Return the names that are not known to have the value asked for."""
        return [name for name, value in self._wanted.items() if self._differs(name, value)]

    def _differs(self, name: str, value: float | None) -> bool:
        reported = self._reported.get(name)
        return reported is None or not (value is None or same_value(value, reported))

    def _read(self, t_ns: int) -> None:
        left = self._open()
        if t_ns < self._due_ns and any(name in left for name in self._asked):
            return
        self._asked = [name for name in left if self._tries[name] < _TRIES][:_AT_ONCE]
        for name in self._asked:
            self._tries[name] += 1
            self._link.send(_RequestRead(self._link.target_sysid, self._link.target_compid, name, -1))
        self._due_ns = t_ns + _RETRY_NS
        if self._asked:
            return
        if all(name in self._reported for name in left):
            self._conclude(left)
            return
        self._request_list(t_ns)

    def _request_list(self, t_ns: int) -> None:
        self._list_ns = self._came_ns = t_ns
        self._due_ns = t_ns + _RETRY_NS
        self._link.send(_RequestList(self._link.target_sysid, self._link.target_compid))

    def _read_list(self, t_ns: int, since_ns: int) -> None:
        self._due_ns = t_ns + _RETRY_NS
        complete = 0 < self._count <= len(self._reported)
        if not (complete or t_ns - self._came_ns >= _LIST_GAP_NS or t_ns - since_ns >= _LIST_LIMIT_NS):
            return
        self._list_ns = None
        if self._strict_done:
            self._compare_file()
        else:
            self._conclude(self._open())

    def _compare_file(self) -> None:
        self.done = True
        missing = [name for name in self._of_file if name not in self._reported]
        other = [
            f"{name} {self._reported[name].value:g} instead of {value:g}"
            for name, value in self._of_file.items()
            if name in self._reported and not same_value(value, self._reported[name])
        ]
        parts = [
            f"{len(self._of_file) - len(missing) - len(other)} of {len(self._of_file)} parameters of the file hold",
            *([f"not in use in this firmware ({len(missing)}): {_first(missing)}"] if missing else []),
            *([f"other values ({len(other)}): {_first(other)}"] if other else []),
        ]
        self.finding = "; ".join(parts)

    def _conclude(self, left: Sequence[str]) -> None:
        self._strict_done = True
        self.done = not self._of_file
        if left and not self._reported:
            raise HandshakeError(
                self._firmware.name,
                f"it answered none of the requests for the parameters {', '.join(left)}, so they cannot be compared "
                "with autopilot.params or the script: is its MAVLink parameter service running?",
            )
        problems = [
            parameter_problem(
                name, self._wanted[name], self._reported, self._firmware.name, where=self._named.get(name, "")
            )
            for name in left
        ]
        if problems:
            raise ConfigError(problems)

    def unfinished(self) -> HandshakeError:
        """Return the error for a flight that ended before the parameters were compared."""
        return HandshakeError(
            self._firmware.name,
            f"the run ended before its parameters {', '.join(self._open())} were read: nothing shows that it had the "
            "values of autopilot.params, and those that the script names",
        )

    def _on_value(self, message: Any) -> None:
        name = message.param_id
        if name.startswith("_"):  # PX4's _HASH_CHECK is none
            return
        value = param_as_read(message.param_value, message.param_type, bytewise=self._firmware.bytewise_params)
        self._reported[name] = Reported(value, message.param_type)
        self._came_ns = self._t_ns
        if self._list_ns is not None:
            self._count = message.param_count


def same_value(wanted: float, reported: Reported) -> bool:
    """Return True if the parameter has the value asked for, as its type can hold it."""
    held = param_as_held(wanted, reported.kind)
    if held is None:
        return False
    return math.isclose(held, reported.value, rel_tol=_REAL32_STEP if reported.kind >= _REAL32 else 0.0)


def parameter_problem(
    name: str,
    wanted: float | None,
    reported: Mapping[str, Reported] | Iterable[str],
    firmware: str,
    *,
    where: str = "",
) -> Problem:
    """Return what is wrong with a parameter of `autopilot.params`, or with the one that is named at `where`.

    `reported`: all parameters that are known; `wanted` None: any value is right.
    """
    where = where or f"autopilot.params.{name}"
    if wanted is None or not isinstance(reported, Mapping) or name not in reported:
        return Problem(where, f"is unknown to {firmware}", nearest(name, reported, listed=False) or _NO_NEAREST)
    found = reported[name]
    whole = found.kind < _REAL32 and wanted != int(wanted)
    hint = (
        "it is a whole number"
        if whole
        else "it is out of the parameter's range, or set by the firmware itself or on the board"
    )
    return Problem(where, f"is {found.value:.9g} on {firmware}, not {wanted:.9g}", hint)


def _first(texts: Sequence[str]) -> str:
    more = len(texts) - _SHOWN
    return ", ".join([*texts[:_SHOWN], *([f"and {more} more"] if more > 0 else [])])


_NO_NEAREST = "the firmware has no parameter of a similar name; those of other versions may differ"
