"""`hil campaign`: many flights under conditions that vary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from hil.cli.console import console, exit_on_error
from hil.cli.options import QuietOption, takes


class _FileOrCommand(TyperGroup):
    """Group whose command is `run` where the first argument names no command: `hil campaign FILE`."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        first = next((arg for arg in args if not arg.startswith("-")), None)
        if args and first not in self.commands and not {"-h", "--help"} & set(args[:1]):
            args = ["run", *args]
        return super().parse_args(ctx, args)


campaign_app = typer.Typer(
    cls=_FileOrCommand, no_args_is_help=True, help="Fly a bench many times, under conditions that vary."
)


@dataclass(frozen=True)
class RunOptions:
    file: Annotated[Path, typer.Argument(help="File of the campaign (docs/campaigns.md).", metavar="FILE")]
    engine: Annotated[str, typer.Option(help="local: processes on this machine. ray: a Ray cluster.")] = "local"
    address: Annotated[
        str | None, typer.Option(help="Address of the Ray cluster; default one on this machine.", show_default=False)
    ] = None
    workers: Annotated[
        int | None, typer.Option(help="Flights at a time; default one per processor.", show_default=False, min=1)
    ] = None
    out: Annotated[Path | None, typer.Option(help="Folder of the campaign; default campaigns/<name>.")] = None
    resume: Annotated[bool, typer.Option("--resume", help="Continue or extend the campaign in --out.")] = False
    stop_after: Annotated[
        list[str] | None,
        typer.Option(help="failure, width=0.05, above=0.95, below=0.5, or a time: 90s, 30m, 2h. May be repeated."),
    ] = None
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check, count and estimate; one trial flight.")] = False
    yes: Annotated[bool, typer.Option("--yes", help="Fly more than 100,000 points.")] = False
    quiet: QuietOption = False


@campaign_app.command()
@takes(RunOptions)
def run(o: RunOptions) -> None:
    """Fly the campaign of a file: `hil campaign FILE`."""
    from hil.apps.campaign.command import CampaignOptions, run_campaign

    options = CampaignOptions(
        engine=o.engine,
        address=o.address,
        workers=o.workers,
        out=o.out,
        resume=o.resume,
        stop_after=tuple(o.stop_after or ()),
        dry_run=o.dry_run,
        yes=o.yes,
        quiet=o.quiet,
    )
    with exit_on_error():
        status = run_campaign(o.file, options, console)
    raise typer.Exit(status)


@campaign_app.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a campaign.", metavar="A")],
    second: Annotated[Path, typer.Argument(help="Folder of another.", metavar="B")],
    json: Annotated[Path | None, typer.Option(help="File for the comparison as JSON.", metavar="FILE")] = None,
) -> None:
    """Compare the cases of two campaigns, such as two firmwares; exit 1 if a case of B is worse than in A."""
    from hil.apps.campaign.results.compare_table import run_compare

    with exit_on_error():
        status = run_compare(first, second, json, console)
    raise typer.Exit(status)
