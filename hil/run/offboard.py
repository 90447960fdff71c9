"""The pilot that flies the set-points of a companion, of ROS 2 or of a followed log, as a run has it and judges it."""

from __future__ import annotations

from typing import Any

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from hil.config import Bench
from hil.run.autopilot import geodetic_from_W, grid_ns
from hil.run.part import Part, RunContext
from hil.run.recorder.recorder import record_texts

_ON_THE_GROUND = (Phase.CONNECTING, Phase.PREFLIGHT, Phase.ARMING)
_IN_THE_AIR = (Phase.FLYING, Phase.LANDING)


class PilotedPart(Part):
    """Part with such a pilot, from its `build` on if it flies at all. The flight ends with the pilot's."""

    _pilot: OffboardPilot | None = None

    def ended(self) -> bool:
        return self._pilot is not None and self._pilot.phase is Phase.DONE

    def finish(self, run: RunContext) -> None:
        record_texts(run.recorder, self.texts())

    def phase(self) -> str:
        return "" if self._pilot is None else self._pilot.phase.value

    def texts(self) -> list[tuple[int, int, str]]:
        return [] if self._pilot is None else self._pilot.statustexts


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


def why_unflown(pilot: OffboardPilot, bench: Bench, who: str) -> str:
    """Return how `who` left the vehicle on the ground; "": it flew, or a goal or a script judges that."""
    if pilot.phase not in _ON_THE_GROUND or bench.config.goal is not None or bench.script is not None:
        return ""
    waits = pilot.ready and pilot.phase is not Phase.ARMING
    why = "; they sent no desired state that moves the vehicle" if waits else ""
    return f"no {who} in control ever flew: the flight ended in the phase {pilot.phase.value}{why}"


def why_unlanded(pilot: OffboardPilot, bench: Bench, who: str, how: str) -> str:
    """Return why a flight that `duration_s` ended is no success where no mission, goal or search says how it ends.

    `how` the vehicle is told to land. The flight of a script is judged by what it expects.
    """
    config = bench.config
    if pilot.phase not in _IN_THE_AIR or any(v is not None for v in (config.mission, config.goal, config.search)):
        return ""
    where = f"the flight ended at duration_s ({config.duration_s:g} s) in the phase {pilot.phase.value}"
    return f"the {who} in control never landed: {where}; {how}, or raise duration_s"


def is_out_of_time(run: RunContext) -> bool:
    """Return True if a flight has reached `duration_s`; ask at its end."""
    config = run.bench.config
    return run.ticks >= round(config.duration_s * config.tick_hz)
