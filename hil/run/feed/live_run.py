"""The dashboard's side of a run: sends the newest values to the page's server and carries out the page's commands.

Before each tick the bench calls `before_tick`, which usually only compares the clock. Every few milliseconds of wall-
clock time it polls the connection and, if the page has requested an update, sends the values at that time. The run does
not wait for the page, and following a run does not change it: the digest is the same with and without a page.

Commands are those of `hil.run.loop.by_hand`. Sticks steer the vehicle, which also makes the run not deterministic.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hil.run.feed.live_vehicle import LiveVehicle, RunAccess
from hil.run.feed.server_connection import ServerConnection
from hil.run.loop.by_hand import HandControl, Refused

_POLL_NS = 12_000_000  # wall clock between two polls of the connection
_BUSY_POLL_NS = 4_000_000  # between two polls while an update is partly unsent
UPDATE_NS = 46_000_000  # between two updates, on average
_LAST_MESSAGE_S = 2.0  # time limit for sending it


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
        self.control = HandControl(self._vehicles, paused=paused, pace=pace, clock_ns=clock_ns)
        self._poll_ns = 0  # wall clock of the next poll
        self._update_ns = 0  # wall clock before which no update is made
        self._requested: tuple[str, ...] | None = None  # streams of the requested update; None: no request
        self._shown: tuple[str, ...] = ()  # vehicles that pages show
        self._served_tick = -1
        self._began = False  # the page has the description of the run
        self._finished = False
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
        self._serving = self.control.serving = next(iter(vehicles))
        if not self.control.can_hold:
            self.control.release()
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
            self._serving = self.control.serving = vehicle
            self._serve(now_ns)

    def _serve(self, now_ns: int) -> None:
        began_ns = time.thread_time_ns()
        self._poll(now_ns)
        self.service_ns += time.thread_time_ns() - began_ns
        self.control.hold(self._wait, lambda: self._poll(self._clock_ns()), lambda: self._connection.lost)
        after_ns = self._clock_ns()
        # While ticks may be held, at every tick.
        self._poll_ns = 0 if self.control.holds else after_ns + self._until_poll_ns(after_ns)

    def _until_poll_ns(self, now_ns: int) -> int:
        """Return the wall-clock time until the next poll. A poll is short, but it evicts the run's data from caches."""
        if self._connection.lost:
            return 1 << 62
        if self._connection.busy:
            return _BUSY_POLL_NS
        if self._requested is not None and self._update_ns > now_ns:
            return min(_POLL_NS, self._update_ns - now_ns)
        return _POLL_NS

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
        for vehicle in self._vehicles.values():
            if connection.lost:  # and is no longer listened to
                vehicle.sticks.move({"held": False})
            vehicle.sticks.listened()
        idle = not connection.busy and not connection.lost
        if self._requested is not None and idle and now_ns >= self._update_ns:
            # A late update, such as after a rendered frame, does not delay the updates after it.
            self._update_ns = max(self._update_ns + UPDATE_NS, now_ns + UPDATE_NS // 2)
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
            "paused": self.control.paused,
            "pace": self.control.pace,
            "by_hand": self.control.wind_W_mps,
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
        elif kind in ("pause", "resume", "step", "pace", "inject", "wind"):
            try:
                self.control.carry_out(kind, message, vehicle)
            except Refused as refusal:
                vehicle.log("refused", str(refusal))


def _texts(values: Any) -> tuple[str, ...]:
    """Return the texts among values that a page sent."""
    return tuple(v for v in values if isinstance(v, str)) if isinstance(values, list | tuple) else ()
