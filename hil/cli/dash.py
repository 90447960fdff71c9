"""`hil dash`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import ConfigArgument, DashHostOption, DashPortOption, console, told


def dash(
    config: ConfigArgument = None,
    host: DashHostOption = "127.0.0.1",
    port: DashPortOption = 8710,
    runs: Annotated[Path, typer.Option(help="Folder of the runs that can be opened.")] = Path("runs"),
) -> None:
    """A page in the browser: start and follow runs, fly by hand, open past runs."""
    from hil.dash_command import serve_dashboard

    with told():
        serve_dashboard(config, console, host=host, port=port, runs=runs)
