"""The section `parts` of a bench: parts of a run by name, each with settings of its own.

A name without a dot is a module of `hil.run.parts`; one with a dot is a module of the user, importable from
the working directory. The module has a model `Settings` (a `Section`) and a function `make(bench, settings) -> Part`.
With `JUDGES_ALONE = True` in it, limits and a section `crash` that the bench does not set itself are none.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from hil.config.layers import Settings as MergedSettings
from hil.config.schema import BenchConfig, Limits
from signals.documents.validate import at, nearest, validate
from signals.errors import Problem

_FOLDER = Path(__file__).resolve().parents[2] / "run" / "parts"
_FILES = {"test_suite": "suite"}  # parts whose file has another name: test_*.py are files of tests


def part_module(name: str) -> Any:
    """Import the module of a part. Raises ImportError, and whatever the user's own module raises."""
    if "." not in name:
        return import_module(f"hil.run.parts.{_FILES.get(name, name)}")
    if "" not in sys.path:
        sys.path.insert(0, "")  # the working directory, which a console script does not search by default
    return import_module(name)


def resolve_parts(parts: dict[str, Any], settings: MergedSettings) -> tuple[dict[str, Any], list[Problem]]:
    """Return each part's validated settings, by its name in the section `parts`, and all problems."""
    models: dict[str, Any] = {}
    problems: list[Problem] = []
    for name, data in parts.items():
        place = ("parts", name)
        try:
            module = part_module(name)
        except ModuleNotFoundError as error:
            names = {file: name for name, file in _FILES.items()}
            files = [path.stem for path in _FOLDER.glob("[a-z]*.py") if "\nclass Settings(" in path.read_text()]
            known = [names.get(file, file) for file in files]
            hint = nearest(name, known) if "." not in name else "it must be importable from the working directory"
            problems.append(at(settings, place, f"names a part that cannot be imported ({error})", hint))
            continue
        if not hasattr(module, "Settings"):
            hint = "a part with settings has a model `Settings`; see CONTRIBUTING.md"
            problems.append(at(settings, place, "names a part that has no settings", hint))
            continue
        model, part_problems = validate(module.Settings, {} if data is None else data, settings, below=place)
        problems += part_problems
        if model is not None:
            models[name] = model
    return models, problems


def without_unset_limits(config: BenchConfig) -> BenchConfig:
    """Return the bench without limits that it does not set itself, if one of its parts judges the flight alone.

    The parts must have been resolved.
    """
    if not any(getattr(part_module(name), "JUDGES_ALONE", False) for name in config.parts):
        return config
    unset = dict.fromkeys(set(Limits.model_fields) - config.limits.model_fields_set)
    crash = config.crash if "crash" in config.model_fields_set else None
    return config.model_copy(update={"limits": config.limits.model_copy(update=unset), "crash": crash})
