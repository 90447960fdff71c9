"""The pilot that flies what a companion desires, made for a bench."""

from __future__ import annotations

from collections.abc import Callable

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.config import Bench
from hil.home import State, geodetic_from_W
from hil.signals._kernel import tangent_ned

# A companion that has desired nothing new for so long, simulated time, is stale: the vehicle holds its position.
_STALE_S, _STALE_FRAMES = 1.0, 2.5


def make_pilot(
    bench: Bench, state: State, on_event: Callable[[int, str, str], None], *, grid_ns: int = 0
) -> OffboardPilot:
    """`state`: of the vehicle before take-off. `grid_ns`: times at which it may ask the autopilot, 0 for any."""
    config = bench.config
    return OffboardPilot(
        geodetic_from_W(config.autopilot.kind, bench.scene.site, state),
        tick_ns=config.tick_ns,
        setpoint_hz=config.companion.setpoint_hz,
        stale_s=max(_STALE_S, _STALE_FRAMES / config.companion.rate_hz),
        projection=tangent_ned if config.autopilot.is_mock else None,
        target_sysid=None,
        grid_ns=grid_ns,
        on_event=on_event,
    )
