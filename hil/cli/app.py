"""The command line of `hil`: each command is one file of `live/` or `offline/`."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import Annotated

import typer
from rich.markup import escape

from hil.cli.commands import add_commands
from hil.cli.console import error_console
from hil.cli.status import CONFIG_STATUS

_COMPLETE = "_HIL_COMPLETE"  # variable that the completion scripts of `--install-completion` set

app = typer.Typer(
    name="hil",
    help="A hardware-in-the-loop bench for drones: simulated vehicle and sensors, real or mocked flight controllers.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

add_commands(
    app, ["hil.cli.live", "hil.cli.offline"], first=("run", "check", "dataset", "replay", "bench", "devices", "view")
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"hil-bench {metadata.version('hil-bench')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


_EMPTY = re.compile(r"\s*|--[a-z-]+=\s*")
_WRITTEN = ("--out", "--json")  # options that name what is written
_MOST_BYTES = 255  # of a file's name, on every file system of Linux

# The base class of all usage errors; it has no public name in typer.
_ClickError: type[typer.BadParameter] = typer.BadParameter.__mro__[2]


def _refusal(arguments: Sequence[str]) -> str:
    """Return what is wrong with arguments that no command can use: empty, not UTF-8, or too long for a file's name."""
    for before, argument in zip(("", *arguments), arguments, strict=False):
        try:
            argument.encode()
        except UnicodeEncodeError:
            shown = argument.encode(errors="surrogateescape").decode(errors="backslashreplace")
            return f"{shown} is not UTF-8; rename the file, or choose the locale in which it was named"
        if _EMPTY.fullmatch(argument):
            option = argument.rstrip("=") or (before if before.startswith("-") else "an argument")
            return f"{option} is empty; give it a value or leave it out"
        option, _, path = argument.partition("=") if argument.startswith("-") else (before, "", argument)
        names_file = option in _WRITTEN or not option.startswith("-")
        longest = max(len(name.encode()) for name in path.split(os.sep)) if names_file else 0
        if longest > _MOST_BYTES:
            what = option if option.startswith("-") else "an argument"
            return f"{what} has a name of {longest} bytes; a file system takes {_MOST_BYTES}: choose a shorter one"
    return ""


def _show_map_progress() -> None:
    """Show the progress of maps whose import takes long. Loaded only for a terminal."""
    from hil.run.runs.progress import map_progress
    from sim.scene.work_progress import progress

    progress.display = map_progress


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status. KeyboardInterrupt passes through."""
    refusal = _refusal(arguments)
    if refusal:
        error_console.print(f"[bold red]error:[/] {escape(refusal)}", markup=True)
        return CONFIG_STATUS
    if sys.stdout is not None and sys.stdout.isatty():
        _show_map_progress()
    command = typer.main.get_command(app)
    try:
        if _COMPLETE in os.environ:  # a shell asks for completions
            command.main([], prog_name="hil")
        # Not `command.main`, which turns a KeyboardInterrupt into exit status 130 without a message.
        with command.make_context("hil", list(arguments)) as context:
            outcome = command.invoke(context)
    except typer.Exit as error:
        return error.exit_code
    except SystemExit as ended:  # of completions alone
        return ended.code if isinstance(ended.code, int) else 0
    except typer.Abort:
        raise KeyboardInterrupt from None
    except _ClickError as error:
        error.show()
        return error.exit_code
    return outcome if isinstance(outcome, int) else 0
