"""The loop over the ticks of a run."""

from __future__ import annotations

import gc
from contextlib import ExitStack
from typing import Any

from firmware_bridge.links.ardupilot.json_link import RestartRequested
from hil.config import Bench
from hil.run.loop.progress import Progress
from hil.run.part import FlightEnded, Part, RunContext
from signals.time import NS_PER_S

# Without a part that flies the vehicle, the flight ends this long after disarming [ns of simulated time].
_AFTER_DISARM_NS = 3 * NS_PER_S


def fly_ticks(run: RunContext, *, quiet: bool) -> None:
    """Run ticks until a part ends the flight or the bench's `duration_s` has passed.

    If no part flies the vehicle, the flight also ends a few seconds after it was disarmed, unless the autopilot may
    reboot (`autopilot.on_restart: reset`): then the user decides when the run ends. A run that flies no mission of the
    bench ends without an error when it is stopped by Ctrl-C or a signal, or by a part while the autopilot is silent.
    """
    scheduler, config = run.scheduler, run.bench.config
    end_tick = round(config.duration_s * config.tick_hz)
    until_disarmed = config.autopilot.on_restart != "reset" and not any(part.phase() for part in run.parts)
    after_ticks, armed_tick = _AFTER_DISARM_NS // config.tick_ns, None
    before_hooks, after_hooks, end_checks = (_overridden(run, name) for name in ("before_tick", "after_tick", "ended"))
    progress = Progress(
        tick_ns=config.tick_ns,
        sim_limit_ns=end_tick * config.tick_ns,
        status=run.status,
        title=f"{config.rig}: {config.mission or 'no mission'}",
        quiet=quiet,
    )
    # The garbage collector is off during the flight: its pauses are jitter on the link, and a tick makes no
    # reference cycles.
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        with progress, ExitStack() as stack:
            for part in run.parts:
                stack.enter_context(part.around_flight())
            while scheduler.tick < end_tick:
                for before_tick in before_hooks:
                    before_tick()
                try:
                    scheduler.step()
                except RestartRequested:
                    _restart_vehicle(run)
                    continue
                progress.tick(scheduler.tick)
                for after_tick in after_hooks:
                    after_tick(scheduler.tick)
                if any(ended() for ended in end_checks):
                    break
                if scheduler.actuators.armed:
                    armed_tick = scheduler.tick
                elif until_disarmed and armed_tick is not None and scheduler.tick >= armed_tick + after_ticks:
                    break
    except (KeyboardInterrupt, FlightEnded) as stop:
        if isinstance(stop, KeyboardInterrupt) and not _serves(run.bench):
            raise
        run.stopped_by_hand = True
        run.event("status", str(stop) or "stopped from the keyboard")
    finally:
        gc.enable()
        gc.unfreeze()


def _serves(bench: Bench) -> bool:
    """Return True for a run that only serves an autopilot: nothing of the bench flies, and no goal is judged."""
    config = bench.config
    judged = config.goal is not None or config.search is not None
    return bench.mission is None and bench.script is None and not judged and not config.companion.control


def _restart_vehicle(run: RunContext) -> None:
    """Put the vehicle back to its start after the autopilot has rebooted; simulated time goes on."""
    physics: Any = run.physics
    physics.restart()
    run.scheduler.skip_tick()


def _overridden(run: RunContext, name: str) -> list[Any]:
    """Return this method of each part that overrides it, so that other parts cost no time in a tick."""
    return [getattr(part, name) for part in run.parts if getattr(type(part), name) is not getattr(Part, name)]
