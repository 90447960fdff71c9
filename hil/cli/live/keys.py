"""`hil keys`: makes key pairs for the companion link."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error


def keys(
    folder: Annotated[Path, typer.Argument(help="Folder of the keys; made if it does not exist.", metavar="DIR")],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Clients that get a key pair; the pair of the bench is made once.", metavar="NAME"),
    ] = None,
) -> None:
    """Make key pairs for the companion link: for the bench and for its clients. Overwrites nothing."""
    from firmware_bridge.companion.keys import BENCH, make_keys

    with exit_on_error():
        for file in make_keys(folder, names or ()):
            console.print(str(file), markup=False)
    for name in names or ():
        console.print(
            f"{name}: copy {name}.key and {BENCH}.pub to its machine, then remove {name}.key here; "
            f"clients whose .pub stays here may connect",
            markup=False,
        )
