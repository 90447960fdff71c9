"""Campaigns on disk: the list with the counts of each, which change while it goes on."""

from __future__ import annotations

import time
from typing import Any

from hil.apps.dash.past.served_folders import ServedFolders
from hil.apps.dash.past.summary import read_campaign
from hil.run_files import PAGE_NAME, SUMMARY_NAME
from signals.errors import RecordingError

_FIELDS = ("cases", "pass", "fail", "error", "flake", "points", "pass_rate", "complete", "stopped", "doing")


class Campaigns(ServedFolders):
    """The campaigns in one folder. Its methods read files: call them in a thread."""

    def listed(self) -> list[dict[str, Any]]:
        """Return the campaigns, those written last first; `broken` says what is damaged."""
        campaigns: list[dict[str, Any]] = []
        for folder in self.folders():
            try:
                age_s = max(0.0, time.time() - (folder / SUMMARY_NAME).stat().st_mtime)
                summary = read_campaign(folder)
            except OSError:
                continue
            except RecordingError as error:
                campaigns.append({"name": folder.name, "age_s": age_s, "broken": str(error)})
                continue
            if summary is not None:
                facts = {name: summary.get(name) for name in _FIELDS}
                report = (folder / PAGE_NAME).is_file()
                campaigns.append({"name": folder.name, "age_s": age_s, "report": report, "broken": None, **facts})
        return sorted(campaigns, key=lambda campaign: campaign["age_s"])
