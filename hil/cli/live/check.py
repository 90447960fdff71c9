"""`hil check`: validates a bench or a campaign without a flight."""

from __future__ import annotations

from hil.cli.console import console, exit_on_error
from hil.cli.options import ConfigArgument, MissionOption, RigOption, SceneOption, SetOption
from hil.cli.status import CONFIG_STATUS
from signals.errors import ConfigError


def check(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    settings: SetOption = None,
) -> None:
    """Validate a bench or the file of a campaign without a flight: print every problem, exit 2 if there is any."""
    from hil.apps.campaign.cases.campaign_file import is_campaign_file
    from hil.apps.fly.check import check_bench
    from hil.apps.fly.choice import BenchChoice

    with exit_on_error(CONFIG_STATUS):
        if config is not None and is_campaign_file(config):
            if rig or scene or mission or settings:
                text = "is a campaign: --rig, --scene, --mission and --set belong to a bench"
                raise ConfigError.at(str(config), text, "write them in its section settings")
            from hil.apps.campaign.command import check_campaign

            summary = check_campaign(config)
        else:
            summary = check_bench(BenchChoice(config, rig, scene, mission, None, tuple(settings or ())))
    console.print(summary)
