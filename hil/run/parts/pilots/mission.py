"""The ground station of the bench: uploads the mission, arms, follows the flight, and records status texts."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation
from hil.config import Bench
from hil.run.autopilot import grid_ns
from hil.run.part import Part, RunContext
from hil.run.recorder.recorder import record_texts
from hil.run.verdict.verdict import REST_SPEED_MPS
from signals.rotation import norm


class MissionPart(Part):
    name = "mission"

    def __init__(self, station: GroundStation | None, *, flies: bool, notes: Sequence[str] = ()) -> None:
        """`flies`: the station follows the flight and ends the run; False: it only sends heartbeats.

        `notes`: what the mission's file holds and the autopilot does not get.
        """
        self._station, self._flies, self._notes = station, flies, notes
        self._run: RunContext | None = None  # from `begin` on

    def begin(self, run: RunContext) -> None:
        self._run = run
        for note in self._notes:
            run.say("warning", note)

    def build(self, run: RunContext) -> None:
        if self._station is not None:
            self._station.may_arm = run.may_arm

    def command_sources(self) -> list[GroundStation]:
        return [] if self._station is None else [self._station]

    @property
    def reached(self) -> int:
        """Mission items that the autopilot reports as reached, so far."""
        return 0 if self._station is None or not self._flies else self._station.reached

    def phase(self) -> str:
        return self._station.phase.value if self._station is not None and self._flies else ""

    def texts(self) -> list[tuple[int, int, str]]:
        return self._station.statustexts if self._station is not None and self._flies else []

    def ended(self) -> bool:
        done = self._station is not None and self._flies and self._station.phase is Phase.DONE
        return done and not is_falling(self._run)

    def finish(self, run: RunContext) -> None:
        record_texts(run.recorder, self.texts())


def is_falling(run: RunContext | None) -> bool:
    """Return True while the vehicle moves in the air, by ground truth.

    An autopilot that has disarmed says that it is on the ground, also high above it. A flight that ended there would
    never see the crash.
    """
    truth = None if run is None else run.scheduler.truth
    return truth is not None and not truth.in_contact and norm(truth.v_WB_W) > REST_SPEED_MPS


def _expecting(bench: Bench, station: GroundStation) -> GroundStation:
    """Have the station refuse a program that flies other vehicles than that of the bench."""
    station.expected = bench.firmware
    return station


def make(bench: Bench) -> Part:
    autopilot = bench.config.autopilot
    profile = autopilot.profile
    if bench.mission is not None:
        station = GroundStation(
            bench.mission.items,
            target_sysid=None,
            grid_ns=grid_ns(bench),
            needs_estimator=profile.needs_estimator,
        )
        return MissionPart(_expecting(bench, station), flies=True, notes=bench.mission.notes)
    if bench.script is not None:
        # The script arms and flies; the station uploads nothing, but follows the flight until the vehicle disarms.
        return MissionPart(_expecting(bench, GroundStation((), target_sysid=None, fly=False)), flies=True)
    if not profile.expects_station or autopilot.on_restart != "error" or autopilot.mavlink_port == "none":
        return MissionPart(None, flies=False)
    # Real firmware expects the heartbeat of a ground station once a second.
    return MissionPart(GroundStation((), target_sysid=None, fly=False), flies=False)
