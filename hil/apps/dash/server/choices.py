"""Lists of the page's start form. A page can only choose from them; other names and paths are refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rigs
from hil.config import BenchConfig
from hil.config.files import available, dashboard_bench, default_bench
from hil.run.feed.messages import is_number
from signals.documents.yaml_lines import read_yaml
from signals.errors import ConfigError

_PACKAGE = Path(rigs.__file__).resolve().parent
_MISSIONS = ("*.plan", "*.waypoints", "*.yaml")
_MAX_SEED = 2**63 - 1
_FIELDS = ("rig", "scene", "mission", "seed", "pace")


def choices(config: Path | None, own: Path | None = None, *, bench: str | None = None) -> dict[str, Any] | None:
    """Return the lists of the start form, and what a bench has in its fields.

    `config`: the bench file of `hil dash`. `own`: folder of the missions that pages have brought. `bench`: one of the
    list, by default the first; None is returned for another.
    """
    benches = sorted({*_files(Path("rigs/benches"), ("*.yaml",)), *_files(_PACKAGE / "benches", ("*.yaml",))})
    missions = sorted({*_files(Path("rigs/missions"), _MISSIONS), *_files(_PACKAGE / "missions", _MISSIONS)})
    missions = ([] if own is None else sorted(_files(own, _MISSIONS))) + missions
    default = config or dashboard_bench()
    first = [str(bench) for bench in (default, default_bench()) if bench is not None]
    listed = list(dict.fromkeys([*first, *benches]))
    if bench is not None and bench not in listed:
        return None
    return {
        "bench": listed,
        "rig": available("rig", ()),
        "scene": available("scene", ()),
        "mission": missions,
        "defaults": _defaults(default if bench is None else Path(bench)),
    }


def run_arguments(message: Mapping[str, Any], config: Path | None, own: Path | None = None) -> list[str]:
    """Return the arguments of `hil run` for a form. Raises ValueError for a value that is not on the lists."""
    lists = choices(config, own)
    assert lists is not None
    bench = message.get("bench") or (str(config) if config is not None else None)
    for name, value in (("bench", bench), *((name, message.get(name)) for name in ("rig", "scene", "mission"))):
        if value not in (None, "", *lists[name]):
            raise ValueError(f"the {name} {value!r} is not in the list; choose one from it")
    # An absolute path does not begin with a dash, and after "=" a value cannot be taken for an option.
    arguments = [] if bench is None else [str(Path(bench).absolute())]
    arguments += [f"--{name}={message[name]}" for name in ("rig", "scene", "mission") if message.get(name)]
    seed, pace = message.get("seed"), message.get("pace")
    if seed is not None:
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed <= _MAX_SEED:
            raise ValueError("the seed must be a whole number of at least 0")
        arguments.append(f"--seed={seed}")
    if pace is not None:
        if not is_number(pace) or not 0.01 <= pace <= 1000.0:
            raise ValueError("the pace must be 0.01 to 1000 times real time")
        arguments.append(f"--dash-pace={pace}")
    if message.get("paused") is True:
        arguments.append("--dash-paused")
    if message.get("gamepad") is True:
        arguments.append("--set=manual.device=gamepad")
    return arguments


def _files(folder: Path, patterns: tuple[str, ...]) -> list[str]:
    return [str(path) for pattern in patterns for path in folder.glob(pattern) if path.is_file()]


def _defaults(bench: Path | None) -> dict[str, Any]:
    """Return the values that the form's fields have in a bench, not validated: those of its file, else the schema's."""
    try:
        data = read_yaml(bench).data if bench is not None else {}
    except ConfigError:
        data = {}
    values = data if isinstance(data, dict) else {}
    return {name: values.get(name, BenchConfig.model_fields[name].default) for name in _FIELDS}
