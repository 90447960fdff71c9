"""`hil airsim`: serves AirSim's API."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import ConfigArgument, DashHostOption, DashPortOption, OutOption, SceneOption, options_of, takes


class ClockName(StrEnum):
    WALL = "wall"
    CALLS = "calls"


@dataclass(frozen=True)
class AirSimOptions:
    config: ConfigArgument = None
    settings: Annotated[
        str | None,
        typer.Option(
            help="AirSim's settings.json, or its text; default where AirSim looks for it.", metavar="FILE|JSON"
        ),
    ] = None
    clock: Annotated[
        ClockName,
        typer.Option(
            help="wall: time follows the wall clock; calls: it moves only while a client waits, as fast as it goes."
        ),
    ] = ClockName.WALL
    port: Annotated[
        int | None, typer.Option(help="Port; 0: any free one; default 41451 or ApiServerPort.", min=0, max=65535)
    ] = None
    host: Annotated[
        str | None, typer.Option(help="Address to serve on; default LocalHostIp or loopback. There are no keys.")
    ] = None
    scene: SceneOption = None
    out: OutOption = None
    files: Annotated[
        Path | None,
        typer.Option(
            help="Folder below which clients may have files written (voxel grids); default: that of the results.",
            metavar="FOLDER",
        ),
    ] = None
    dash: Annotated[
        bool, typer.Option("--dash", help="Serve a page in the browser: scene, vehicles, cameras, drawings.")
    ] = False
    dash_host: DashHostOption = "127.0.0.1"
    dash_port: DashPortOption = 8710


@takes(AirSimOptions)
def airsim(o: AirSimOptions) -> None:
    """Serve AirSim's API: scripts written for AirSim fly here unchanged."""
    from hil.apps.airsim.command import Choice, serve_airsim

    choice = options_of(Choice, o, clock=o.clock.value, page=_page(o) if o.dash else None)
    with exit_on_error():
        serve_airsim(choice, console)


def _page(o: AirSimOptions) -> Any:
    """Return what serves the dashboard's page for runs of a folder."""
    from hil.apps.dash.command import dashboard_beside

    return partial(dashboard_beside, o.config, console, host=o.dash_host, port=o.dash_port, lingers=False)
