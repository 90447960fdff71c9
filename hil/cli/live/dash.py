"""`hil dash`: serves the dashboard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import ConfigArgument, DashHostOption, DashPortOption


def dash(
    config: ConfigArgument = None,
    host: DashHostOption = "127.0.0.1",
    port: DashPortOption = 8710,
    runs: Annotated[Path, typer.Option(help="Folder of past runs.")] = Path("runs"),
) -> None:
    """Serve a page in the browser: start and follow runs, fly by hand, open past runs."""
    from hil.apps.dash.command import serve_dashboard

    with exit_on_error():
        serve_dashboard(config, console, host=host, port=port, runs=runs)
