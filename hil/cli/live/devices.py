"""`hil devices`: lists serial ports, autopilots and gamepads, or checks the setup of a board."""

from __future__ import annotations

from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.streams import nobody_reads
from signals.errors import ConfigError


def devices(
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Print every change until Ctrl-C.")] = False,
    check: Annotated[
        str | None,
        typer.Option("--check", help="Check that the board on this port is set up for HITL.", metavar="PORT"),
    ] = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="With --check: correct its parameters and restart the board.")
    ] = False,
    timing: Annotated[
        str | None,
        typer.Option("--timing", help="Measure for a minute whether this computer can fly HITL now.", metavar="PORT"),
    ] = None,
    seconds: Annotated[float, typer.Option(help="With --timing: duration.", min=1.0, max=3600.0)] = 60.0,
    baud: Annotated[int, typer.Option(help="With --check and --timing: baud rate of a UART.")] = 921_600,
) -> None:
    """List serial ports, USB autopilots and gamepads."""
    with exit_on_error():
        if timing is not None and check is not None:
            raise ConfigError.at("--timing", "cannot go with --check", "run one after the other")
        if fix and check is None:
            raise ConfigError.at("--fix", "corrects the board that --check names", "give its port: --check PORT")
    if timing is not None:
        from hil.apps.devices.timing_test import check_timing

        with exit_on_error():
            good = check_timing(console, timing, baud=baud, seconds=seconds)
        raise typer.Exit(0 if good else 1)
    from hil.apps.devices.command import check_board, print_devices

    if check is None:
        print_devices(console, as_json=json, watch=watch, ended=nobody_reads)
        return
    with exit_on_error():
        ready = check_board(console, check, baud=baud, fix=fix)
    raise typer.Exit(0 if ready else 1)
