"""The two consoles of the command line, and the handler that prints a HilError."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import typer
from rich.console import Console
from rich.markup import escape

from hil.cli.status import CONFIG_STATUS, ERROR_STATUS
from signals.errors import ConfigError, HilError

# Markup is off by default: names of files and people's texts may contain brackets and :words:.
console = Console(highlight=False, soft_wrap=True, markup=False, emoji=False)
error_console = Console(stderr=True, highlight=False, soft_wrap=True, markup=False, emoji=False)


@contextlib.contextmanager
def exit_on_error(status: int = ERROR_STATUS) -> Iterator[None]:
    """Print a HilError of the block and exit: with 2 for a ConfigError, with `status` for any other."""
    try:
        yield
    except HilError as error:
        lines = [str(p) for p in error.problems] if isinstance(error, ConfigError) else [str(error)]
        for line in lines:
            error_console.print(f"[bold red]error:[/] {escape(line)}", markup=True)
        raise typer.Exit(CONFIG_STATUS if isinstance(error, ConfigError) else status) from None
