"""The dashboard as a part of a run: follows the flight, injects the page's faults and flies with the page's sticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from firmware_bridge.manual.manual_control import ManualControlSource
from hil.apps.dash.run_facts import run_description, slow_facts
from hil.run.feed.live_run import LiveRun
from hil.run.feed.live_vehicle import LiveVehicle, RunAccess
from hil.run.feed.page_sticks import page_buttons
from hil.run.part import Part, RunContext
from hil.run.parts.pilots.manual import ManualPart, manual_settings, mission_mode
from signals.samples import TruthState


class DashboardPart(Part):
    name = "dashboard"
    injects = True

    def __init__(self, live: LiveRun, name: str = "") -> None:
        """`name`: of the vehicle in a run of several; empty in a run of one."""
        self._live, self._vehicle = live, live.vehicle(name)
        self.sticks: ManualPart | None = None
        self.hand_control = live.control

    @property
    def paused_s(self) -> float:  # type: ignore[override]
        return self._vehicle.paused_s

    def tap(self) -> LiveVehicle:
        return self._vehicle

    def build(self, run: RunContext) -> None:
        if not run.bench.config.autopilot.profile.mavlink:
            return

        def page_source() -> ManualControlSource:
            settings = manual_settings(run.bench)
            # The page has a button that hands the vehicle back to the mission.
            settings["modes"] = settings["modes"] | {"mission": mission_mode(run.bench)}
            return ManualControlSource(self._vehicle.sticks, buttons=page_buttons(settings["modes"]), **settings)

        self.sticks = ManualPart(page_source)
        self.sticks.build(run)

    def command_sources(self) -> list[ManualControlSource]:
        return [] if self.sticks is None else self.sticks.command_sources()

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [] if self.sticks is None else self.sticks.observers()

    def begin(self, run: RunContext) -> None:
        physics, companion = run.physics, run.part("companion")
        self._live.attach(
            self._vehicle,
            RunAccess(
                # "wire": True if the page may offer faults of the link to the autopilot.
                description=run_description(run) | {"wire": run.part("faults").can_have_faults},
                scheduler=run.scheduler,
                status=run.status,
                texts=run.texts,
                wind_W_mps=lambda: physics.wind_W_mps,
                slow_facts=lambda: slow_facts(run),
                inject=lambda fault: run.inject(fault, declared=False),
                set_turbulence=physics.set_turbulence,
                event=run.recorder.event,
                lockstep=run.link.caps.lockstep,
                views=lambda: {} if companion is None else companion.link.views.newest,
            ),
        )

    def before_tick(self) -> None:
        self._live.before_tick(self._vehicle)

    def repeatable(self) -> bool:
        return not self._vehicle.altered and (self.sticks is None or self.sticks.repeatable())

    def run_keys(self) -> dict[str, Any]:
        return {"by_hand": self._vehicle.commands} if self._vehicle.commands else {}

    def after_run(self, run: Mapping[str, Any]) -> None:
        if not self._vehicle.name:
            self._live.finish(run)

    def after_group(self, run: Mapping[str, Any]) -> None:
        self._live.finish(run)
