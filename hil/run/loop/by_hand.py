"""Commands by hand to a run under way: hold its ticks, change the wind, inject faults. From a dashboard or Foxglove.

`pause`, `step`, `resume` and `pace` only delay the run and leave the digest as it is. `inject`, `wind` and `turbulence`
change what is simulated: the run is then marked as altered by hand and not deterministic. The tick recorded with a
command is the first one that the command affects.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, MutableMapping
from typing import Any, Protocol

import pydantic

from hil.run.loop.fault_request import requested_fault
from signals.samples import ActuatorFrame, TruthState, Vec3
from sim.scene.wind import GustEvent

MAX_COMMANDS = 500  # of one run: limit of commands that alter it, and of recorded ones that do not
WIND_LIMIT_MPS = 30.0
PACE_LIMITS = (0.01, 1000.0)  # times real time
_WIND_RISE_S = 1.0
_MAX_WIND_CHANGES = 100  # in one run: each is a permanent gust, which every later tick adds
_PAUSED_WAIT_S = 0.02  # between two polls while paused


class Refused(ValueError):
    """Refusal of a command; the message is for the person who gave it."""


class Present(Protocol):
    """Present state of one vehicle: a run's scheduler, or a vehicle of `hil airsim`."""

    @property
    def tick(self) -> int: ...
    @property
    def tick_ns(self) -> int: ...
    @property
    def t_ns(self) -> int: ...
    @property
    def truth(self) -> TruthState | None: ...
    @property
    def actuators(self) -> ActuatorFrame: ...

    def take_pace(self) -> float | None:
        """Stop pacing the ticks and return the pace so far, times real time; None: there was none."""


class Access(Protocol):
    """The part of a vehicle's run that commands by hand read and change."""

    @property
    def scheduler(self) -> Present: ...
    @property
    def inject(self) -> Callable[[Any], None]: ...  # a fault or gust; ValueError if it does not fit
    @property
    def set_turbulence(self) -> Callable[[float], None]: ...  # wind at 20 ft [m/s]
    @property
    def event(self) -> Callable[[int, str, str], None]: ...
    @property
    def lockstep(self) -> bool: ...  # the autopilot waits for the bench, so the run can be paused


class HandledVehicle:
    """One vehicle and the commands by hand that were carried out."""

    def __init__(self, name: str) -> None:
        """`name`: in a run of several vehicles; empty in a run of one."""
        self.name = name
        self.commands: list[dict[str, Any]] = []  # for run.json
        self.paused_s = 0.0  # wall clock, of pauses before a tick of this vehicle
        self.altered = False  # a command changed what is simulated
        self._access: Access | None = None

    @property
    def access(self) -> Access:
        """The built run."""
        assert self._access is not None
        return self._access

    @property
    def built(self) -> bool:
        return self._access is not None

    def record(self, text: str, *, alters: bool = False) -> None:
        """Add a command that was carried out to the recording, its taps and run.json."""
        scheduler = self.access.scheduler
        self.altered = self.altered or alters
        if len(self.commands) < MAX_COMMANDS or alters:
            self.commands.append({"tick": scheduler.tick, "what": text, "alters": alters})
            self.access.event(scheduler.t_ns, "by_hand", f"before tick {scheduler.tick}: {text}")


class HandControl:
    """Holds the ticks of a run and alters it on command. All vehicles of a run have one."""

    serving: HandledVehicle  # from the first tick on: the vehicle whose tick comes next

    def __init__(
        self,
        vehicles: MutableMapping[str, Any],
        *,
        paused: bool = False,
        pace: float | None = None,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """`vehicles`: HandledVehicle by name. `paused`: wait at tick 0. `pace`: times real time; None: no limit."""
        self._vehicles = vehicles
        self._clock_ns = clock_ns
        self.paused = paused
        self.pace = pace
        self.paces = False  # a command has taken over the pace from the vehicles' schedulers
        self.wind_W_mps: Vec3 = (0.0, 0.0, 0.0)  # set by hand, on top of the bench's own
        self.turbulence_mps: float | None = None  # set by hand, wind at 20 ft; None: the bench's own
        self.watchers: list[Callable[[], None]] = []  # called while ticks are held, about fifty times a second
        self._steps = 0
        self._pace_from: tuple[int, int] | None = None  # tick, wall clock [ns]
        self._wind_changes = 0

    @property
    def holds(self) -> bool:
        """True while ticks may have to wait, so that `hold` is needed before each."""
        return self.paused or self._steps > 0 or self.pace is not None

    @property
    def can_hold(self) -> bool:
        """True if the run can be paused: every autopilot waits for the bench."""
        return all(vehicle.access.lockstep for vehicle in self._vehicles.values())

    def vehicle(self, name: str) -> HandledVehicle:
        """Return the vehicle of that name."""
        vehicle: HandledVehicle = self._vehicles[name]
        return vehicle

    def release(self) -> None:
        """Hold no more ticks: nobody is left who could resume the run."""
        self.paused, self.pace = False, None

    # -- before a tick ----------------------------------------------------------------------------------------------

    def hold(self, wait: Callable[[float], None], poll: Callable[[], None], lost: Callable[[], bool]) -> None:
        """Wait while the run is paused, then until the next tick is due.

        `wait`: sleep for at most this time [s], less if a command arrives. `poll` carries out commands that arrived.
        `lost`: True if no commands can arrive any more.
        """
        serving = self.serving
        began_ns = self._clock_ns()
        while self.paused and not self._steps and not lost():
            wait(_PAUSED_WAIT_S)
            self._poll(poll)
        serving.paused_s += (self._clock_ns() - began_ns) * 1e-9
        if self._steps:
            self._steps -= 1
        elif self.pace is not None and not lost():
            self._keep_pace(self.pace, serving.access.scheduler, wait, poll, lost)
        if lost():
            self.release()

    def _poll(self, poll: Callable[[], None]) -> None:
        poll()
        for watch in self.watchers:
            watch()

    def _keep_pace(
        self,
        pace: float,
        scheduler: Present,
        wait: Callable[[float], None],
        poll: Callable[[], None],
        lost: Callable[[], bool],
    ) -> None:
        now_ns = self._clock_ns()
        if self._pace_from is None:
            self._pace_from = (scheduler.tick, now_ns)
        tick, from_ns = self._pace_from
        due_ns = from_ns + round((scheduler.tick - tick) * scheduler.tick_ns / pace)
        if now_ns - due_ns > 200_000_000:  # too slow for this pace: measure it from here, so that no burst follows
            self._pace_from = (scheduler.tick, now_ns)
        while now_ns < due_ns and not lost() and not self.paused and self.pace is not None:
            wait(min((due_ns - now_ns) * 1e-9, _PAUSED_WAIT_S))
            now_ns = self._clock_ns()
            if now_ns < due_ns:
                self._poll(poll)

    # -- commands ---------------------------------------------------------------------------------------------------

    def carry_out(self, kind: str, message: Mapping[str, Any], vehicle: HandledVehicle) -> None:
        """Carry out pause, resume, step, pace, inject, wind or turbulence.

        `vehicle`: that a fault concerns. Raises Refused if the command does not fit this run.
        """
        if kind in ("pause", "resume", "step", "pace"):
            self._control_time(kind, message)
            return
        try:
            self._alter(kind, vehicle, message)
        except Refused:
            raise
        except (ValueError, KeyError, TypeError, OverflowError, pydantic.ValidationError) as error:
            raise Refused(f"{kind}: {_brief(error)}") from error

    def _control_time(self, kind: str, message: Mapping[str, Any]) -> None:
        serving = self.serving
        if not self.can_hold:
            raise Refused(f"{kind}: this autopilot runs on wall-clock time and cannot be held")
        self._pace_from = None
        paces = [vehicle.access.scheduler.take_pace() for vehicle in self._vehicles.values()]
        self.pace = next((pace for pace in paces if pace is not None), self.pace)
        self.paces = True
        if kind == "pace":
            pace = message.get("pace")
            is_number = isinstance(pace, int | float) and not isinstance(pace, bool)
            if pace is not None and not (is_number and PACE_LIMITS[0] <= pace <= PACE_LIMITS[1]):
                raise Refused("pace: must be from 0.01 to 1000 times real time, or none")
            if pace != self.pace:
                self.pace = pace
                serving.record("pace: as fast as it goes" if pace is None else f"pace: {pace:g} times real time")
        elif kind == "step":
            self.paused, self._steps = True, self._steps + 1
            serving.record("step one tick")
        elif self.paused != (kind == "pause"):
            self.paused = kind == "pause"
            serving.record(kind)

    def _alter(self, kind: str, vehicle: HandledVehicle, message: Mapping[str, Any]) -> None:
        """Change the wind, which blows on all vehicles, or inject a fault of one.

        Raises what `requested_fault` raises if it does not fit this run.
        """
        scheduler = self.serving.access.scheduler
        if any(sum(row["alters"] for row in each.commands) >= MAX_COMMANDS for each in self._vehicles.values()):
            raise Refused(f"{kind}: no more than {MAX_COMMANDS} commands may alter one run; start a new run")
        flying = [v for v in self._vehicles.values() if v.access.scheduler.tick == scheduler.tick]
        at_s = scheduler.t_ns / 1e9
        if kind == "turbulence":
            strength_mps = float(message["wind_20ft_mps"])
            if not 0.0 <= strength_mps <= WIND_LIMIT_MPS:
                raise Refused(f"turbulence: a wind at 20 ft from 0 to {WIND_LIMIT_MPS:g} m/s is needed")
            for altered in flying:
                altered.access.set_turbulence(strength_mps)
                altered.record(f"turbulence by hand: {strength_mps:g} m/s of wind at 20 ft", alters=True)
            self.turbulence_mps = strength_mps
            return
        if kind == "wind":
            velocity, fault = self._wind_change(message, at_s)
            text = "wind by hand: {:g}, {:g}, {:g} m/s (east, north, up)".format(*velocity)
        else:
            velocity = self.wind_W_mps
            fault, text = requested_fault(message["fault"], at_s)
            text = f"fault: {text}"
        if not isinstance(fault, GustEvent):
            if vehicle not in flying:
                raise Refused(f"{kind}: the flight of {vehicle.name} is over")
            flying = [vehicle]
        for altered in flying:
            altered.access.inject(fault)
            altered.record(text, alters=True)
        self.wind_W_mps = velocity

    def _wind_change(self, message: Mapping[str, Any], at_s: float) -> tuple[Vec3, GustEvent]:
        """Return the wind asked for, and the gust that is its difference from the wind set before: gusts add up."""
        x, y, z = (float(v) for v in message["velocity_W_mps"])
        if not all(math.isfinite(v) and abs(v) <= WIND_LIMIT_MPS for v in (x, y, z)):
            raise Refused(f"wind: three numbers within {WIND_LIMIT_MPS:g} m/s are needed (east, north, up)")
        previous = self.wind_W_mps
        change = (x - previous[0], y - previous[1], z - previous[2])
        self._wind_changes += 1
        if self._wind_changes > _MAX_WIND_CHANGES:
            raise Refused(f"wind: no more than {_MAX_WIND_CHANGES} changes of the wind in one run; start a new run")
        return (x, y, z), GustEvent(at_s=at_s, velocity_W_mps=change, rise_s=_WIND_RISE_S)


def _brief(error: Exception) -> str:
    if isinstance(error, pydantic.ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(str(part) for part in first['loc'])} {first['msg']}".strip()
    return str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
