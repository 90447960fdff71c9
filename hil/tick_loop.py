"""The loop over the ticks of a run: when it ends, and what it asks of the machine meanwhile."""

from __future__ import annotations

import gc
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from firmware_bridge.links.ardupilot_json import ArduPilotJsonLink, RestartRequested
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.lockstep import LockstepLink
from firmware_bridge.links.processor import RealtimeProducer, SharedProcessor
from hil.config import BenchConfig
from hil.progress import Progress
from hil.signals.time import NS_PER_S
from hil.summary import FREE_RUNNING

if TYPE_CHECKING:
    from hil.bench import BenchRun

# So long after the motors stopped [ns of simulated time] a flight that nobody scripted is over.
_AFTER_DISARM_NS = 3 * NS_PER_S


def fly_ticks(run: BenchRun) -> None:
    """Step until the run has had enough, or the time of the bench is up.

    Where nobody scripts the flight it ends a while after the vehicle was disarmed, too; not where the autopilot may
    reboot, for whoever reboots it decides.
    """
    scheduler, config, live = run.scheduler, run.config, run.live
    assert scheduler is not None
    end_tick = round(config.duration_s * config.tick_hz)
    until_disarmed = run.commanders.station is None and config.autopilot.on_restart != "reset"
    after_ticks, armed_tick = _AFTER_DISARM_NS // config.tick_ns, None
    progress = Progress(
        tick_ns=config.tick_ns,
        sim_limit_ns=end_tick * config.tick_ns,
        status=run.commanders.status,
        title=f"{config.rig}: {config.mission or 'no mission'}",
        quiet=run.quiet,
    )
    # Garbage is collected before and after, not during: a pause of the collector is jitter on the link, and
    # a tick makes no reference cycles.
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        with progress, _processor(run.link, config) as processor:
            shared_ticks = config.tick_hz if isinstance(processor, SharedProcessor) else 0
            while scheduler.tick < end_tick:
                if live is not None:
                    live.before_tick()
                try:
                    scheduler.step()
                except RestartRequested:
                    run.start_again()
                    continue
                progress.tick(scheduler.tick)
                if shared_ticks and scheduler.tick % shared_ticks == 0:
                    given_up = processor.watch(shared_ticks * scheduler.tick_ns)
                    if given_up is not None:
                        shared_ticks = 0
                        run.event("warning", given_up)
                if run.enough():
                    break
                if scheduler.actuators.armed:
                    armed_tick = scheduler.tick
                elif until_disarmed and armed_tick is not None and scheduler.tick >= armed_tick + after_ticks:
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
