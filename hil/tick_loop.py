"""The loop over the ticks of a run: when it ends, and what it asks of the machine meanwhile."""

from __future__ import annotations

import gc
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from firmware_bridge.links.ardupilot_json import ArduPilotJsonLink, RestartRequested
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.lockstep import LockstepLink
from firmware_bridge.links.processor import RealtimeProducer, SharedProcessor
from hil.config import BenchConfig
from hil.progress import Progress
from hil.scheduler import Scheduler
from hil.signals.time import NS_PER_S
from hil.summary import FREE_RUNNING

# So long after the motors stopped [ns of simulated time] a flight that nobody scripted is over.
_AFTER_DISARM_NS = 3 * NS_PER_S


class FlightOver:
    """Says when a flight that somebody else commands has ended: armed once, and disarmed for a while."""

    def __init__(self, tick_ns: int) -> None:
        self._after_ticks = _AFTER_DISARM_NS // tick_ns
        self._flown = False
        self._disarmed_tick = 0

    def after(self, tick: int, armed: bool) -> bool:
        if armed:
            self._flown = True
            self._disarmed_tick = tick
            return False
        return self._flown and tick - self._disarmed_tick >= self._after_ticks


def fly_ticks(
    scheduler: Scheduler,
    config: BenchConfig,
    link: AutopilotLink | None,
    *,
    over: Callable[[], bool],
    until_disarmed: bool,
    status: Callable[[], tuple[str, int, int]],
    before_tick: Callable[[], None] | None,
    start_again: Callable[[], None],
    warn: Callable[[str], None],
    quiet: bool,
) -> None:
    """Step until `over` says so, or the time of the bench is up.

    `until_disarmed`: nobody scripts the flight, so it ends a while after the vehicle was disarmed, too; not where the
    autopilot may reboot, for whoever reboots it decides. `start_again` serves an autopilot that has rebooted.
    """
    end_tick = round(config.duration_s * config.tick_hz)
    flight_over = FlightOver(config.tick_ns)
    until_disarmed = until_disarmed and config.autopilot.on_restart != "reset"
    progress = Progress(
        tick_ns=config.tick_ns,
        sim_limit_ns=end_tick * config.tick_ns,
        status=status,
        title=f"{config.rig}: {config.mission or 'no mission'}",
        quiet=quiet,
    )
    # Garbage is collected before and after, not during: a pause of the collector is jitter on the link, and
    # a tick makes no reference cycles.
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        with progress, _processor(link, config) as processor:
            shared_ticks = config.tick_hz if isinstance(processor, SharedProcessor) else 0
            while scheduler.tick < end_tick:
                if before_tick is not None:
                    before_tick()
                try:
                    scheduler.step()
                except RestartRequested:
                    start_again()
                    continue
                progress.tick(scheduler.tick)
                if shared_ticks and scheduler.tick % shared_ticks == 0:
                    given_up = processor.watch(shared_ticks * scheduler.tick_ns)
                    if given_up is not None:
                        shared_ticks = 0
                        warn(given_up)
                if over() or (until_disarmed and flight_over.after(scheduler.tick, scheduler.actuators.armed)):
                    break
    finally:
        gc.enable()
        gc.unfreeze()


def _processor(link: AutopilotLink | None, config: BenchConfig) -> AbstractContextManager[Any]:
    """What the loop asks of the system's scheduler."""
    if isinstance(link, FREE_RUNNING):
        # Whoever prepares the samples of an autopilot that waits for nobody must not wait for a processor either.
        return RealtimeProducer()
    if isinstance(link, LockstepLink | ArduPilotJsonLink) and link.caps.busy_processors > 1 and config.pace is None:
        return SharedProcessor(link.pid if config.autopilot.share_processor else None)
    return nullcontext()
