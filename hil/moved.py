"""Old module paths: importing one raises an ImportError that names the new one.

Scripts, companion clients and pytest options of users contain such paths. Python asks the last finder in
`sys.meta_path` only for a module that no other finder knows, so existing modules are not affected.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

MOVED = {
    "hil.apps.flown_run": "hil.apps.fly.flown_run",
    "hil.apps.timing_test": "hil.apps.devices.timing_test",
    "hil.bench": "hil.run.bench_run",
    "hil.bench_suite": "hil.apps.bench_suite",
    "hil.calibrate_command": "hil.apps.calibrate.command",
    "hil.cli.commands": "hil.cli.app",
    "hil.cli.detect": "hil.cli.offline.detect",
    "hil.cli.run": "hil.cli.live.run",
    "hil.commanders": "hil.run.parts",
    "hil.companion": "hil.run.companion",
    "hil.config.companion_clients": "hil.config.companion.clients",
    "hil.config.companion_checks": "hil.config.checks.companion_checks",
    "hil.config.cross_checks": "hil.config.checks.cross_checks",
    "hil.config.preset_values": "hil.config.sensors.preset_values",
    "hil.config.radar_checks": "hil.config.checks.radar_checks",
    "hil.dash_command": "hil.apps.dash.command",
    "hil.dashboard": "hil.apps.dash",
    "hil.dataset": "hil.apps.dataset",
    "hil.detect": "hil.apps.detect",
    "hil.devices_command": "hil.apps.devices.command",
    "hil.entry": "hil.cli.entry",
    "hil.flown_run": "hil.apps.fly.flown_run",
    "hil.frame_stages": "hil.run.sensors.frame_stages",
    "hil.goal": "hil.run.verdict.goal",
    "hil.judging": "hil.run.parts",
    "hil.measurements": "hil.run.verdict.measurements",
    "hil.missions": "hil.config.missions",
    "hil.progress": "hil.run.loop.progress",
    "hil.pytest_plugin": "hil.apps.pytest_plugin",
    "hil.radar_command": "hil.apps.radar.command",
    "hil.radar_offline": "hil.apps.radar",
    "hil.recorder": "hil.run.recorder",
    "hil.replay": "hil.run.runs.replay",
    "hil.report": "hil.run.report",
    "hil.restartable_physics": "hil.run.loop.restartable_physics",
    "hil.run.replay": "hil.run.runs.replay",
    "hil.run_folder": "hil.run.report.run_folder",
    "hil.scheduler": "hil.run.loop.scheduler",
    "hil.search": "hil.run.verdict.search",
    "hil.sensor_slots": "hil.run.sensors.sensor_slots",
    "hil.signals": "signals",
    "hil.simulated_sensors": "hil.run.sensors.simulated_sensors",
    "hil.stages": "hil.run.loop.stages",
    "hil.summary": "hil.run.parts.simulated.sensors",
    "hil.tick_loop": "hil.run.loop.tick_loop",
    "hil.verdict": "hil.run.verdict.verdict",
    "hil.view_command": "hil.apps.view.command",
    "hil.view_looks": "hil.apps.view.appearance",
    "hil.view_points": "hil.apps.view.points",
    "hil.view_variants": "hil.apps.view.variants",
}


class MovedModules:
    """Import finder that raises an error for an old path and finds nothing else."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:  # noqa: ARG002
        """Raise ImportError for an old path. A module inside an old package fails when its package is imported."""
        if fullname in MOVED:
            # Not a ModuleNotFoundError: `from hil import bench` would replace its message, which has the new name.
            raise ImportError(f"{fullname} is now {MOVED[fullname]}: change the import", name=fullname)
