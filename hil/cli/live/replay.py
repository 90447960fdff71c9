"""`hil replay`: repeats a recorded run and compares the two."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, error_console, exit_on_error


def replay(
    run_dir: Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN_DIR")],
    out: Annotated[Path | None, typer.Option(help="Folder for the new run; default RUN_DIR/replay.")] = None,
) -> None:
    """Repeat a recorded run. If the runs differ, print the first different tick and port, and exit with status 1."""
    from hil.run.replay import fly_and_compare

    with exit_on_error():
        result = fly_and_compare(run_dir, out, error_console)
    console.print(str(result))
    raise typer.Exit(0 if result.identical else 1)
