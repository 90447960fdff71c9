"""The dashboard's side of a run: sends the newest values to the page's server and carries out the page's commands.

Before each tick the bench calls `before_tick`, which usually only compares the clock. Every few milliseconds of wall-
clock time it polls the connection and, if the page has requested an update, sends the values at that time. The run does
not wait for the page, and following a run does not change it: the digest is the same with and without a page.

The tick recorded with a command is the first one that the command affects. `pause`, `step`, `resume` and `pace` only
delay the run and leave the digest as it is. `inject` and `wind` change what is simulated, and sticks steer the vehicle:
the run is then marked as altered by hand and not deterministic.
"""

from __future__ import annotations

import math
import select
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pydantic

from hil.apps.dash.live.fault_request import requested_fault
from hil.apps.dash.live.live_vehicle import MAX_COMMANDS, LiveVehicle, Present, RunAccess
from hil.apps.dash.live.server_connection import ServerConnection
from hil.apps.dash.messages import is_number
from signals.samples import Vec3
from sim.scene.wind import GustEvent

_POLL_NS = 12_000_000  # wall clock between two polls of the connection
_BUSY_POLL_NS = 4_000_000  # between two polls while an update is partly unsent
_UPDATE_NS = 46_000_000  # between two updates, on average
_WIND_RISE_S = 1.0
_MAX_WIND_CHANGES = 100  # in one run: each is a permanent gust, which every later tick adds
_LAST_MESSAGE_S = 2.0  # time limit for sending it
_WIND_LIMIT_MPS = 30.0
_PAUSED_WAIT_S = 0.02  # between two polls while paused


class StoppedByPage(KeyboardInterrupt):
    """The page's Stop button was pressed. It ends the run as Ctrl-C does, with everything so far recorded."""


class LiveRun:
    """A run that the dashboard follows. The bench calls `attach` for each vehicle, then `before_tick` at every tick."""

    _serving: LiveVehicle  # from `attach` on: the vehicle that called `before_tick` last

    def __init__(
        self,
        link: socket.socket,
        *,
        paused: bool = False,
        pace: float | None = None,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """`link`: to the page's server. `paused`: wait at tick 0. `pace`: times real time; None: unlimited."""
        self._vehicles: dict[str, LiveVehicle] = {}
        self.service_ns = 0  # processor time of this thread spent on polls and updates
        self._connection = ServerConnection(link)
        self._link = link
        self._clock_ns = clock_ns
        self._paused = paused
        self._steps = 0
        self._pace = pace
        self._pace_from: tuple[int, int] | None = None  # tick, wall clock [ns]
        self._poll_ns = 0  # wall clock of the next poll
        self._update_ns = 0  # wall clock before which no update is made
        self._requested: tuple[str, ...] | None = None  # streams of the requested update; None: no request
        self._shown: tuple[str, ...] = ()  # vehicles that pages show
        self._served_tick = -1
        self._began = False  # the page has the description of the run
        self._finished = False
        self._wind_changes = 0
        self._wind_W_mps: Vec3 = (0.0, 0.0, 0.0)  # set by hand, on top of the bench's own
        self._speed_from = (0, 0)
        self._speed = 0.0

    # -- called by the bench --------------------------------------------------------------------------------------

    def vehicle(self, name: str = "") -> LiveVehicle:
        """Return the vehicle of that name; empty in a run of one. All are made before the first is attached."""
        return self._vehicles.setdefault(name, LiveVehicle(name))

    def attach(self, vehicle: LiveVehicle, run: RunAccess) -> None:
        """Take a built run, and after that of the last vehicle describe the whole run to the page."""
        vehicle.run = run
        vehicles = self._vehicles.values()
        if not all(vehicle.built for vehicle in vehicles):
            return
        self._serving = next(iter(vehicles))
        if not all(vehicle.run.lockstep for vehicle in vehicles):
            self._paused, self._pace = False, None
        description = dict(self._serving.run.description)
        if self._several:
            description |= {
                "out": str(Path(description["out"]).parent),
                "lockstep": all(vehicle.run.lockstep for vehicle in vehicles),
                "vehicles": {vehicle.name: dict(vehicle.run.description) for vehicle in vehicles},
            }
        for each in vehicles:
            each.forget_closed(())  # the page begins anew and needs every frame
        self._connection.write({"kind": "begin", **description})
        self._began = True
        self._speed_from = (self._serving.run.scheduler.tick, self._clock_ns())

    @property
    def _several(self) -> bool:
        return "" not in self._vehicles

    def finish(self, run_json: Mapping[str, Any]) -> None:
        """Send the last state and the contents of run.json: the run is over."""
        connection = self._connection
        if self._finished:
            return
        self._finished = True
        if self._began and not connection.lost and not connection.busy:
            connection.write_last(self._state(self._clock_ns(), slow=True), _LAST_MESSAGE_S)
        if not connection.lost:
            connection.write_last({"kind": "end", "run": dict(run_json)}, _LAST_MESSAGE_S)

    def close(self) -> None:
        self._connection.close()

    # -- by a world that others advance, in which nothing waits for the page ------------------------------------------

    @property
    def idle(self) -> bool:
        """True if nothing is left to be sent."""
        return not self._connection.busy

    def poll(self) -> None:
        """Serve the page if that is due, also while simulated time stands still."""
        now_ns = self._clock_ns()
        if now_ns >= self._poll_ns:
            self._serve(now_ns)

    # -- before each tick -----------------------------------------------------------------------------------------

    def before_tick(self, vehicle: LiveVehicle) -> None:
        """Serve the page if a poll is due; every vehicle that flies calls this. Raises StoppedByPage."""
        now_ns = self._clock_ns()
        if now_ns < self._poll_ns:
            return
        if self._served_tick != vehicle.run.scheduler.tick:  # else another vehicle has called
            self._served_tick = vehicle.run.scheduler.tick
            self._serving = vehicle
            self._serve(now_ns)

    def _serve(self, now_ns: int) -> None:
        scheduler = self._serving.run.scheduler
        began_ns = time.thread_time_ns()
        self._poll(now_ns)
        self.service_ns += time.thread_time_ns() - began_ns
        wait_began_ns = self._clock_ns()
        while self._paused and not self._steps and not self._connection.lost:
            self._wait(_PAUSED_WAIT_S)
            self._poll(self._clock_ns())
        after_ns = self._clock_ns()
        self._serving.paused_s += (after_ns - wait_began_ns) * 1e-9
        if self._steps:
            self._steps -= 1
        elif self._pace is not None and not self._connection.lost:
            self._keep_pace(scheduler)
        if self._connection.lost:
            self._paused, self._pace = False, None
        if self._paused or self._steps or self._pace is not None:
            self._poll_ns = 0  # at every tick
        else:
            self._poll_ns = after_ns + self._until_poll_ns(after_ns)

    def _until_poll_ns(self, now_ns: int) -> int:
        """Return the wall-clock time until the next poll. A poll is short, but it evicts the run's data from caches."""
        if self._connection.lost:
            return 1 << 62
        if self._connection.busy:
            return _BUSY_POLL_NS
        if self._requested is not None and self._update_ns > now_ns:
            return min(_POLL_NS, self._update_ns - now_ns)
        return _POLL_NS

    def _keep_pace(self, scheduler: Present) -> None:
        assert self._pace is not None
        now_ns = self._clock_ns()
        if self._pace_from is None:
            self._pace_from = (scheduler.tick, now_ns)
        tick, from_ns = self._pace_from
        due_ns = from_ns + round((scheduler.tick - tick) * scheduler.tick_ns / self._pace)
        if now_ns - due_ns > 200_000_000:  # too slow for this pace: measure it from here, so that no burst follows
            self._pace_from = (scheduler.tick, now_ns)
        while now_ns < due_ns and not self._connection.lost and not self._paused and self._pace is not None:
            self._wait((due_ns - now_ns) * 1e-9)
            now_ns = self._clock_ns()
            if now_ns < due_ns:
                self._poll(now_ns)

    def _wait(self, limit_s: float) -> None:
        writing = [self._link] if self._connection.busy else []
        select.select([self._link], writing, [], limit_s)

    def _poll(self, now_ns: int) -> None:
        connection = self._connection
        for vehicle in self._vehicles.values():
            vehicle.extend_trail()
        if connection.busy:
            connection.push()
        for message in sorted(connection.read(), key=lambda message: message.get("kind") != "stop"):
            self._carry_out(message)
        idle = not connection.busy and not connection.lost
        if self._requested is not None and idle and now_ns >= self._update_ns:
            # A late update, such as after a rendered frame, does not delay the updates after it.
            self._update_ns = max(self._update_ns + _UPDATE_NS, now_ns + _UPDATE_NS // 2)
            connection.write(self._state(now_ns))

    # -- updates --------------------------------------------------------------------------------------------------

    def _state(self, now_ns: int, *, slow: bool = False) -> dict[str, Any]:
        scheduler = self._serving.run.scheduler
        from_tick, from_ns = self._speed_from
        if now_ns - from_ns > 400_000_000:
            self._speed = (scheduler.tick - from_tick) * scheduler.tick_ns / (now_ns - from_ns)
            self._speed_from = (scheduler.tick, now_ns)
        vehicles = self._vehicles
        state: dict[str, Any] = {
            "kind": "state",
            "tick": scheduler.tick,
            "t_ns": scheduler.t_ns,
            "speed": self._speed,
            "paused": self._paused,
            "pace": self._pace,
            "by_hand": self._wind_W_mps,
            "altered": any(vehicle.altered for vehicle in vehicles.values()),
            "events": [event for vehicle in vehicles.values() for event in vehicle.take_events()],
        }
        if not self._several:
            state |= self._serving.state(now_ns, self._streams_of(""), slow=slow)
        else:
            shown = [name for name in self._shown if name in vehicles] or [next(iter(vehicles))]
            if slow:  # the last state, from which a page may show any vehicle
                shown = list(vehicles)
            state["vehicles"] = {
                name: vehicles[name].state(now_ns, self._streams_of(f"{name}/"), slow=slow) for name in shown
            }
            frames = [vehicle.pop("frames", {}) for vehicle in state["vehicles"].values()]
            state["frames"] = {stream: payload for payloads in frames for stream, payload in payloads.items()}
            state["places"] = {name: vehicle.place() for name, vehicle in vehicles.items()}
        self._requested = None
        return state

    def _streams_of(self, prefix: str) -> list[str]:
        """Return the requested streams that begin with the prefix, without it."""
        return [s.removeprefix(prefix) for s in self._requested or () if s.startswith(prefix)]

    # -- commands -------------------------------------------------------------------------------------------------

    def _carry_out(self, message: Mapping[str, Any]) -> None:
        kind = message.get("kind")
        name = message.get("vehicle")
        vehicle = self._vehicles.get(name if isinstance(name, str) else "", self._serving)
        if kind == "next":
            self._requested, self._shown = _texts(message.get("streams")), _texts(message.get("vehicles"))
            for vehicle in self._vehicles.values():
                vehicle.forget_closed(self._streams_of(f"{vehicle.name}/" if vehicle.name else ""))
        elif kind == "sticks":
            vehicle.sticks.move(message)
        elif kind == "stop" and not vehicle.run.stops:
            vehicle.log("refused", "stop: this page only watches")
        elif kind == "stop":
            self._serving.record("stop")
            raise StoppedByPage("stopped from the dashboard")
        elif kind in ("pause", "resume", "step", "pace"):
            self._control_time(str(kind), message)
        elif kind in ("inject", "wind"):
            try:
                self._alter(str(kind), vehicle, message)
            except (ValueError, KeyError, TypeError, pydantic.ValidationError) as error:
                vehicle.log("refused", f"{kind}: {_brief(error)}")

    def _control_time(self, kind: str, message: Mapping[str, Any]) -> None:
        if not all(vehicle.run.lockstep for vehicle in self._vehicles.values()):
            self._serving.log("refused", f"{kind}: this autopilot runs on wall-clock time and cannot be held")
            return
        self._pace_from = None
        if kind == "pace":
            pace = message.get("pace")
            if pace is not None and not (is_number(pace) and 0.01 <= pace <= 1000.0):
                self._serving.log("refused", "pace: must be from 0.01 to 1000 times real time, or none")
                return
            if pace != self._pace:
                self._pace = pace
                self._serving.record("pace: as fast as it goes" if pace is None else f"pace: {pace:g} times real time")
            return
        if kind == "step":
            self._paused, self._steps = True, self._steps + 1
            self._serving.record("step one tick")
            return
        if self._paused != (kind == "pause"):
            self._paused = kind == "pause"
            self._serving.record(kind)

    def _alter(self, kind: str, vehicle: LiveVehicle, message: Mapping[str, Any]) -> None:
        """Change the wind, which blows on all vehicles, or inject a fault of one.

        Raises what `requested_fault` raises if it does not fit this run.
        """
        scheduler = self._serving.run.scheduler
        if sum(command["alters"] for command in vehicle.commands) >= MAX_COMMANDS:
            raise ValueError(f"no more than {MAX_COMMANDS} commands may alter one run; start a new run")
        flying = [v for v in self._vehicles.values() if v.run.scheduler.tick == scheduler.tick]
        at_s = scheduler.t_ns / 1e9
        if kind == "wind":
            x, y, z = (float(v) for v in message["velocity_W_mps"])
            if not all(math.isfinite(v) and abs(v) <= _WIND_LIMIT_MPS for v in (x, y, z)):
                raise ValueError(f"three numbers within {_WIND_LIMIT_MPS:g} m/s are needed (east, north, up)")
            # Gusts add up, so the new gust is the difference from the wind set before.
            previous = self._wind_W_mps
            change = (x - previous[0], y - previous[1], z - previous[2])
            self._wind_changes += 1
            if self._wind_changes > _MAX_WIND_CHANGES:
                raise ValueError(f"no more than {_MAX_WIND_CHANGES} changes of the wind in one run; start a new run")
            fault: Any = GustEvent(at_s=at_s, velocity_W_mps=change, rise_s=_WIND_RISE_S)
            text = f"wind by hand: {x:g}, {y:g}, {z:g} m/s (east, north, up)"
        else:
            fault, text = requested_fault(message["fault"], at_s)
            text = f"fault: {text}"
        if not isinstance(fault, GustEvent):
            if vehicle not in flying:
                raise ValueError(f"the flight of {vehicle.name} is over")
            flying = [vehicle]
        for altered in flying:
            altered.run.inject(fault)
            altered.record(text, alters=True)
        if kind == "wind":
            self._wind_W_mps = (x, y, z)


def _texts(values: Any) -> tuple[str, ...]:
    """Return the texts among values that a page sent."""
    return tuple(v for v in values if isinstance(v, str)) if isinstance(values, list | tuple) else ()


def _brief(error: Exception) -> str:
    if isinstance(error, pydantic.ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(str(part) for part in first['loc'])} {first['msg']}".strip()
    return str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
