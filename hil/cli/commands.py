"""Commands are found by file: a module's command is its function, or its group of commands, of the module's name."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pkgutil import iter_modules

import typer

HELPERS = ("options",)  # modules beside the commands that hold none; so do those whose name begins with _


def add_commands(app: typer.Typer, packages: Sequence[str], first: Sequence[str] = ()) -> None:
    """Add the commands of all modules of `packages`: those of `first` in this order, then the others by name.

    Raises LookupError for a module without the command of its name, and a name of `first` without a module.
    """
    modules = {
        info.name: f"{package}.{info.name}"
        for package in packages
        for info in iter_modules(import_module(package).__path__)
        if info.name not in HELPERS and not info.name.startswith("_")
    }
    for name in (*first, *sorted(modules.keys() - set(first))):
        if name not in modules:
            raise LookupError(f"no module {name!r} in {' or '.join(packages)}, of which it is to be a first command")
        command = getattr(import_module(modules[name]), name, None)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        elif callable(command):
            app.command()(command)
        else:
            raise LookupError(f"{modules[name]} has no command {name!r}; a module without one is named in {__name__}")
