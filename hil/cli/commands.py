"""Commands are found by file: a module's command is its function, or its group of commands, of the module's name."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pkgutil import iter_modules

import typer


def add_commands(app: typer.Typer, packages: Sequence[str], first: Sequence[str] = ()) -> None:
    """Add the commands of all modules of `packages`: those of `first` in this order, then the others by name."""
    modules = {
        info.name: f"{package}.{info.name}"
        for package in packages
        for info in iter_modules(import_module(package).__path__)
    }
    for name in (*first, *sorted(modules.keys() - set(first))):
        command = getattr(import_module(modules[name]), name, None)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        elif command is not None:
            app.command()(command)
