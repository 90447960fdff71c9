"""The section `parts` of a bench: parts of a run by name, each with settings of its own.

A name without a dot is a module of `hil.run.parts`; one with a dot is a module of the user, importable from
the working directory. The module has a model `Settings` (a `Section`) and a function `make(bench, settings) -> Part`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from hil.config.merge.layers import Settings as MergedSettings
from signals.documents.validate import at, nearest, validate
from signals.errors import Problem

_FOLDER = Path(__file__).resolve().parents[2] / "run" / "parts"


def part_module(name: str) -> Any:
    """Import the module of a part. Raises ImportError, and whatever the user's own module raises."""
    if "." not in name:
        return import_module(f"hil.run.parts.{name}")
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
            known = [path.stem for path in _FOLDER.glob("[a-z]*.py") if "\nclass Settings(" in path.read_text()]
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
