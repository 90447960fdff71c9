"""`hil check`: validates a bench without a flight."""

from __future__ import annotations

from hil.cli.console import console, exit_on_error
from hil.cli.options import ConfigArgument, MissionOption, RigOption, SceneOption, SetOption
from hil.cli.status import CONFIG_STATUS


def check(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    settings: SetOption = None,
) -> None:
    """Validate a bench without running it: print every problem, exit 2 if there is any."""
    from hil.apps.fly.check import check_bench
    from hil.apps.fly.choice import BenchChoice

    with exit_on_error(CONFIG_STATUS):
        summary = check_bench(BenchChoice(config, rig, scene, mission, None, tuple(settings or ())))
    console.print(summary)
