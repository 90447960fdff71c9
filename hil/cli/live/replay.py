"""`hil replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, error_console, exit_on_error


def replay(
    run_dir: Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN_DIR")],
    out: Annotated[Path | None, typer.Option(help="Folder for the fresh run; default RUN_DIR/replay.")] = None,
) -> None:
    """Run a recorded configuration again; exit 1 and name the first differing tick and port if not identical."""
    from hil.run.replay import fly_and_compare

    with exit_on_error():
        result = fly_and_compare(run_dir, out, error_console)
    console.print(str(result))
    raise typer.Exit(0 if result.identical else 1)
