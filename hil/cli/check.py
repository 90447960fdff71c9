"""`hil check`."""

from __future__ import annotations

from hil.cli.options import ConfigArgument, MissionOption, RigOption, SceneOption, SetOption, console, told
from hil.entry import CONFIG_STATUS


def check(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    settings: SetOption = None,
) -> None:
    """Validate a bench without running it: print every problem, exit 2 if there is any."""
    from hil.config import load_bench
    from hil.frame_stages import stage_specs
    from hil.stages import plan_stages

    with told(CONFIG_STATUS):
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, settings=settings or ())
        plan_stages(stage_specs(bench.config))
    c = bench.config
    flown = f"{len(bench.mission.items)} mission items" if bench.mission else "no mission"
    if bench.script is not None:
        flown += f", {len(bench.script.script.actions)} actions"
    console.print(f"ok: rig {c.rig}, scene {c.scene}, vehicle {c.vehicle}, {flown}, sensors {', '.join(c.sensors)}")
