"""The settings file, in the places where AirSim looks for it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from hil.apps.airsim.settings.settings import AirSimSettings, read_settings
from signals.documents.document import read_text, shown_path

_LIMIT_BYTES = 4_000_000


def find_settings() -> Path | None:
    """Return settings.json of the working directory, else that of ~/Documents/AirSim, else None."""
    places = [Path("settings.json")]
    with suppress(RuntimeError):  # a user without a home directory
        places.append(Path.home() / "Documents" / "AirSim" / "settings.json")
    return next((path for path in places if path.exists()), None)


def load_settings(option: str | None = None) -> tuple[AirSimSettings, str]:
    """Return the settings and where they come from, for people. Raises ConfigError with all problems.

    `option`: a file, or the JSON text itself, which starts with a brace; None: the file is looked for.
    """
    if option is not None and option.lstrip().startswith("{"):
        return read_settings(option, "--settings"), "the option --settings"
    path = find_settings() if option is None else Path(os.path.expanduser(option))
    if path is None:
        return read_settings("{}", "settings.json"), "AirSim's default values"
    return read_settings(read_text(path, limit_bytes=_LIMIT_BYTES), shown_path(path)), shown_path(path)
