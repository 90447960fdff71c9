"""What commands share: the consoles, errors with their exit status, and options that several have."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from hil.entry import CONFIG_STATUS, ERROR_STATUS
from hil.signals.errors import ConfigError, HilError

console = Console(highlight=False, soft_wrap=True)
error_console = Console(stderr=True, highlight=False, soft_wrap=True)

ConfigArgument = Annotated[Path | None, typer.Argument(help="Bench file; default ./hil.yaml.", metavar="[CONFIG]")]
RigOption = Annotated[str | None, typer.Option(help="Rig: which autopilot, over which wires (rigs/*.yaml).")]
SceneOption = Annotated[str | None, typer.Option(help="Scene (rigs/scenes/*.yaml).")]
MissionOption = Annotated[str | None, typer.Option(help="Mission: a .plan or .waypoints file, or a script (.yaml).")]
SeedOption = Annotated[int | None, typer.Option(help="Seed of all noise.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Override any key, e.g. --set sensors.gps.rate_hz=5. May be repeated.", metavar="KEY=VALUE"
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the results; default runs/<time>-<rig>.")]
DashHostOption = Annotated[
    str, typer.Option(help="Address to serve the page on; any but loopback needs the token that is printed.")
]
DashPortOption = Annotated[int, typer.Option(help="Port of the page; 0: any that is free.", min=0, max=65535)]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, only the result.")]


def complain(error: HilError) -> None:
    """Every problem on a line of its own, on standard error."""
    lines = [str(p) for p in error.problems] if isinstance(error, ConfigError) else [str(error)]
    with contextlib.suppress(OSError, ValueError):  # nobody may be there to read it; the status tells
        for line in lines:
            error_console.print(f"[bold red]error:[/] {escape(line)}")


@contextlib.contextmanager
def told(status: int = ERROR_STATUS) -> Iterator[None]:
    """Errors of the block on standard error, and the exit status that goes with them: `status` but for wrong files."""
    try:
        yield
    except HilError as error:
        complain(error)
        raise typer.Exit(CONFIG_STATUS if isinstance(error, ConfigError) else status) from None
