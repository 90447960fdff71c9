"""The `hil` command. Exit status: 0 PASS, 1 FAIL (the vehicle), 2 wrong files or options, 3 ERROR (the bench).

Without logic: what a command does is loaded when it is called.
"""

from __future__ import annotations

from collections.abc import Sequence

import typer

from hil.cli import commands, detect, run

app = typer.Typer(
    name="hil",
    help="A hardware-in-the-loop bench for drones: simulated vehicle and sensors, real or mocked flight controllers.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for _command in (
    run.run, commands.check, commands.dataset, commands.replay, commands.bench, commands.devices, commands.view,
    commands.dash, commands.keys, commands.companion, commands.radar,
):  # fmt: skip
    app.command()(_command)
app.add_typer(commands.calibrate_app, name="calibrate")
app.add_typer(detect.detect_app, name="detect")

# The library's base of all usage errors; it has no public name in typer.
_ClickError: type[typer.BadParameter] = typer.BadParameter.__mro__[2]


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status. KeyboardInterrupt passes through."""
    try:
        outcome = app(args=list(arguments), prog_name="hil", standalone_mode=False)
    except typer.Exit as leaving:
        return leaving.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    except _ClickError as error:
        error.show()
        return error.exit_code
    return outcome if isinstance(outcome, int) else 0
