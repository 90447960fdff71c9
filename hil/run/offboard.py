"""The pilot that flies the set-points of a companion, of ROS 2 or of a followed log, as a run has it."""

from __future__ import annotations

from typing import Any

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.config import Bench
from hil.run.autopilot import geodetic_from_W, grid_ns
from hil.run.part import RunContext


def offboard_pilot(
    bench: Bench, run: RunContext, *, setpoint_hz: float, stale_s: float, **settings: Any
) -> OffboardPilot:
    """Return the pilot; `run` is at its build. `settings`: further ones of `OffboardPilot`, such as its take-off."""
    config = bench.config
    pilot = OffboardPilot(
        geodetic_from_W(bench, run.physics.state),
        tick_ns=config.tick_ns,
        setpoint_hz=setpoint_hz,
        stale_s=stale_s,
        projection=bench.firmware.project,
        target_sysid=None,
        grid_ns=grid_ns(bench),
        needs_estimator=config.autopilot.profile.needs_estimator,
        on_event=run.recorder.event,
        may_arm=run.may_arm,
        **settings,
    )
    pilot.expected = bench.firmware
    return pilot
