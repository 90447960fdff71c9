"""`hil detect`: a group of commands, each one file of this folder."""

from __future__ import annotations

import typer

from hil.cli.commands import add_commands

detect = typer.Typer(help="The detector: train it on data sets, evaluate it, and make the data.", no_args_is_help=True)
add_commands(detect, [__name__], first=("train", "evaluate"))
