"""`hil devices`."""

from __future__ import annotations

from typing import Annotated

import typer

from hil.cli.options import console, told


def devices(
    json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Then print every change until Ctrl-C.")] = False,
    check: Annotated[
        str | None,
        typer.Option("--check", help="Ask the board on this port whether it is set up for HITL.", metavar="PORT"),
    ] = None,
    fix: Annotated[bool, typer.Option("--fix", help="With --check: set what is wrong and restart the board.")] = False,
    baud: Annotated[int, typer.Option(help="With --check: of a real serial line.")] = 921_600,
) -> None:
    """Serial ports, USB autopilots, gamepads."""
    from hil.devices_command import check_board, print_devices

    if check is None:
        print_devices(console, as_json=json, watch=watch)
        return
    with told():
        ready = check_board(console, check, baud=baud, fix=fix)
    raise typer.Exit(0 if ready else 1)
