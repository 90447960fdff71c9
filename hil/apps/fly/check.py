"""`hil check`: validates a bench without a flight."""

from __future__ import annotations

from hil.apps.fly.choice import BenchChoice
from hil.config import Bench
from hil.config.checks.flight_notes import flight_notes
from hil.config.checks.intake_checks import intake_notes
from hil.config.missions.path import waypoint_legs
from hil.run.loop.stages import plan_stages
from hil.run.parts.catalog import check_parts
from hil.run.sensors.frame_stages import stage_specs
from signals.words import counted
from sim.world_loader import load_world


def check_bench(choice: BenchChoice) -> str:
    """Load the bench, check the wiring of its stages, and return a line about each vehicle and each note on the map.

    Raises ConfigError or WiringError.
    """
    bench = choice.load()
    check_parts(bench)
    notes = [f"  note: {note}" for note in load_world(bench.scene).map.notes] if bench.scene.map is not None else []
    if not bench.vehicles:
        notes += [f"  note: {note}" for note in _notes(bench)]
        return "\n".join([f"ok: {_facts(bench)}", *notes])
    lines = [f"  {name}: {_facts(vehicle)}" for name, vehicle in bench.vehicles.items()]
    notes += [f"  note: {name}: {note}" for name, each in bench.vehicles.items() for note in _notes(each)]
    return "\n".join([f"ok: {counted(len(lines), 'vehicle')} in one world", *lines, *notes])


def _notes(bench: Bench) -> list[str]:
    """Return what is otherwise than the bench and the mission state: not taken, not judged, or in the way."""
    mission = bench.mission.notes if bench.mission is not None else ()
    return [*mission, *flight_notes(bench), *intake_notes(bench.config)]


def _facts(bench: Bench) -> str:
    plan_stages(stage_specs(bench.config))
    c = bench.config
    mission_text = "no mission"
    if bench.mission is not None:
        mission_text = counted(len(waypoint_legs(bench.legs)), "waypoint")
    if bench.script is not None:
        mission_text += f", {counted(len(bench.script.script.actions), 'action')}"
    return f"rig {c.rig}, scene {c.scene}, vehicle {c.vehicle}, {mission_text}, sensors {', '.join(c.sensors)}"
