"""`hil keys`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import console, told


def keys(
    folder: Annotated[Path, typer.Argument(help="Where they are kept; made if it is not there.", metavar="DIR")],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Clients to make a pair for; the bench's own is made once.", metavar="NAME"),
    ] = None,
) -> None:
    """Key pairs for the companion link: of the bench and of its clients. Overwrites nothing."""
    from firmware_bridge.companion.keys import BENCH, make_keys

    with told():
        for file in make_keys(folder, names or ()):
            console.print(str(file), markup=False)
    for name in names or ():
        console.print(
            f"{name}: take {name}.key and {BENCH}.pub to its machine, then remove {name}.key here; "
            f"whoever's .pub stays here may connect",
            markup=False,
        )
