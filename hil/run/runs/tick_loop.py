"""The loop over the ticks of a run, of one vehicle or of several in one world."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any, NoReturn

from firmware_bridge.links.ardupilot.json_link import RestartRequested
from hil.config import Bench
from hil.run.part import FlightEnded, Part, RunContext
from hil.run.runs.progress import Progress
from signals.time import NS_PER_S

# Without a part that flies the vehicle, the flight ends this long after disarming [ns of simulated time].
_AFTER_DISARM_NS = 3 * NS_PER_S


class VehicleFailed(Exception):
    """Error of one vehicle among several, its cause."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


class Flight:
    """One vehicle's flight in the loop.

    If no part flies the vehicle, its flight also ends a few seconds after it was disarmed, unless the autopilot may
    reboot (`autopilot.on_restart: reset`): then the user decides when the run ends.
    """

    def __init__(self, run: RunContext, name: str = "") -> None:
        """`name`: of the vehicle among several; empty: it is the only one."""
        self.run, self.name = run, name
        self.lost = False  # its autopilot is lost, and the vehicle falls (`autopilot.on_loss: go_on`)
        self.over = False
        config = run.bench.config
        self._until_disarmed = config.autopilot.on_restart != "reset" and not any(part.phase() for part in run.parts)
        self._after_ticks = _AFTER_DISARM_NS // config.tick_ns
        self._armed_tick: int | None = None
        self.scheduler = run.scheduler
        self.before_hooks = [part.before_tick for part in _overriding(run, "before_tick")]
        self._after_hooks = [(part.every_ticks, part.after_tick) for part in _overriding(run, "after_tick")]
        self._end_checks = [(part.every_ticks, part.ended) for part in _overriding(run, "ended")]

    def before_tick(self) -> None:
        """Call the parts before a tick. Raises VehicleFailed if the vehicle has a name."""
        try:
            for before_tick in self.before_hooks:
                before_tick()
        except Exception as error:  # noqa: BLE001 (a defect of a part, too, is that of its vehicle)
            self._fail(error)

    def step(self) -> bool:
        """Run one tick. Return False if the autopilot has rebooted instead, and the vehicle is back at its start."""
        try:
            self.scheduler.step()
        except RestartRequested:
            physics: Any = self.run.physics
            physics.restart()  # simulated time goes on
            self.scheduler.skip_tick()
            return False
        return True

    def after_tick(self) -> None:
        """Call the parts after a tick, and set `over` if the flight has ended. Raises as `before_tick`."""
        scheduler = self.scheduler
        tick = scheduler.tick
        try:
            for period, after_tick in self._after_hooks:
                if not tick % period:
                    after_tick(tick)
            for period, ended in self._end_checks:
                if not tick % period and ended():
                    self.over = True
                    break
        except Exception as error:  # noqa: BLE001 (likewise)
            self._fail(error)
        if self.over:
            return
        if self.lost:
            self.over = scheduler.truth is not None and scheduler.truth.in_contact
        elif scheduler.actuators.armed:
            self._armed_tick = tick
        elif self._until_disarmed and self._armed_tick is not None:
            self.over = tick >= self._armed_tick + self._after_ticks

    def _fail(self, error: Exception) -> NoReturn:
        if not self.name or isinstance(error, FlightEnded):
            raise error
        raise VehicleFailed(self.name) from error


def fly_ticks(flights: Sequence[Flight], *, quiet: bool, step: Callable[[], bool] | None = None) -> None:
    """Run ticks until every flight is over or the bench's `duration_s` has passed.

    `step` runs one tick of all vehicles; None: of the only one. A run that flies no mission of the bench ends without
    an error when it is stopped by Ctrl-C or a signal, or by a part while the autopilot is silent.
    """
    first = flights[0]
    config = first.run.bench.config
    step = step or first.step
    end_tick = round(config.duration_s * config.tick_hz)
    one = len(flights) == 1
    progress = Progress(
        tick_ns=config.tick_ns,
        sim_limit_ns=end_tick * config.tick_ns,
        status=first.run.status if one else lambda: _status_of_all(flights),
        title=f"{config.rig}: {config.mission or 'no mission'}" if one else f"{len(flights)} vehicles",
        quiet=quiet,
    )
    # The garbage collector is off during the flight: its pauses are jitter on the link, and a tick makes no
    # reference cycles.
    gc.disable()
    try:
        with progress, ExitStack() as stack:
            for flight in flights:
                for part in flight.run.parts:
                    stack.enter_context(part.around_flight())
            flying = list(flights)
            tick = 0
            while flying and tick < end_tick:
                for flight in flying:
                    if flight.before_hooks:
                        flight.before_tick()
                stepped = step()
                tick = flying[0].scheduler.tick
                if not stepped:
                    continue
                if not quiet:
                    progress.tick(tick)
                some_over = False
                for flight in flying:
                    flight.after_tick()
                    some_over |= flight.over
                if some_over:
                    for flight in flying:
                        if flight.over and not one:  # it stays in the world
                            flight.run.physics.switch_off()
                    flying = [flight for flight in flying if not flight.over]
    except (KeyboardInterrupt, FlightEnded) as stop:
        if isinstance(stop, KeyboardInterrupt) and not all(_serves(flight.run.bench) for flight in flights):
            raise
        for flight in flights:
            flight.run.stopped_by_hand = True
            flight.run.event("status", str(stop) or "stopped from the keyboard")
    finally:
        gc.enable()


def _status_of_all(flights: Sequence[Flight]) -> tuple[str, int, int]:
    """Return the number of vehicles still flying as a text, and waypoints reached and to reach by all together."""
    counts = [flight.run.status() for flight in flights]
    flying = sum(not flight.over for flight in flights)
    return (
        f"{flying} of {len(flights)} flying",
        sum(status.reached for status in counts),
        sum(status.waypoints for status in counts),
    )


def _serves(bench: Bench) -> bool:
    """Return True for a run that only serves an autopilot: nothing of the bench flies, and no goal is judged."""
    config = bench.config
    judged = config.goal is not None or config.search is not None
    return bench.mission is None and bench.script is None and not judged and not config.companion.control


def _overriding(run: RunContext, name: str) -> list[Part]:
    """Return the parts that override this method, so that other parts cost no time in a tick."""
    return [part for part in run.parts if getattr(type(part), name) is not getattr(Part, name)]
