"""Old module paths of this package: importing one raises an ImportError that names the new path.

A user's CUT may still hold such paths. Python asks the last finder in `sys.meta_path` only about modules that no other
finder knows, so modules that exist never come here.
"""

from __future__ import annotations

from typing import Any

_FOLDERS = {
    "link": ("barrier", "checks", "client", "connection", "protocol"),
    "navigation": ("explore.geodesy", "explore.inertial", "explore.rotation"),
    "explore.mapping": (
        "explore.maps",
        "explore.matcher",
        "explore.particles",
        "explore.scan",
        "explore.search",
        "explore.slam",
        "explore.slam_settings",
        "explore.sweep",
        "explore.true_pose",
    ),
    "explore.planning": ("explore.astar", "explore.moving", "explore.plan_map", "explore.route"),
}
MOVED = {
    f"hil_companion.{old}": f"hil_companion.{folder}.{old.rpartition('.')[2]}"
    for folder, modules in _FOLDERS.items()
    for old in modules
}
MOVED["hil_companion.explore.settings"] = "hil_companion.explore.planning.flight_settings"


class MovedModules:
    """A finder that finds no module and explains why."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> None:  # noqa: ARG002
        """Raise ImportError for an old path."""
        if fullname in MOVED:
            # A ModuleNotFoundError would be swallowed by `from hil_companion import client`, and the new path with it.
            raise ImportError(f"{fullname} is now {MOVED[fullname]}: change the import", name=fullname)
