"""`hil campaign`: many flights under conditions that vary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from hil.cli.console import console, exit_on_error
from hil.cli.options import AddressOption, EngineOption, QuietOption, options_of, takes


class _FileOrCommand(TyperGroup):
    """Group whose command is `run` where the first argument names no command: `hil campaign FILE`."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        first = next((arg for arg in args if not arg.startswith("-")), None)
        if args and first not in self.commands and not {"-h", "--help"} & set(args[:1]):
            args = ["run", *args]
        return super().parse_args(ctx, args)


WorkersOption = Annotated[
    int | None, typer.Option(help="Flights at a time; default one per processor.", show_default=False, min=1)
]
campaign = typer.Typer(
    cls=_FileOrCommand, no_args_is_help=True, help="Fly a bench many times, under conditions that vary."
)


@dataclass(frozen=True)
class RunOptions:
    file: Annotated[Path, typer.Argument(help="File of the campaign (docs/campaigns.md).", metavar="FILE")]
    engine: EngineOption = "local"
    address: AddressOption = None
    workers: WorkersOption = None
    out: Annotated[Path | None, typer.Option(help="Folder of the campaign; default campaigns/<name>.")] = None
    resume: Annotated[bool, typer.Option("--resume", help="Continue or extend the campaign in --out.")] = False
    stop_after: Annotated[
        list[str] | None,
        typer.Option(help="failure, width=0.05, above=0.95, below=0.5, or a time: 90s, 30m, 2h. May be repeated."),
    ] = None
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check, count and estimate; one trial flight.")] = False
    yes: Annotated[bool, typer.Option("--yes", help="Fly more than 100,000 points.")] = False
    quiet: QuietOption = False


@campaign.command()
@takes(RunOptions)
def run(o: RunOptions) -> None:
    """Fly the campaign of a file: `hil campaign FILE`."""
    from hil.apps.campaign.command import CampaignOptions, run_campaign

    options = options_of(CampaignOptions, o, stop_after=tuple(o.stop_after or ()))
    with exit_on_error():
        status = run_campaign(o.file, options, console)
    raise typer.Exit(status)


@campaign.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a campaign.", metavar="A")],
    second: Annotated[Path, typer.Argument(help="Folder of another.", metavar="B")],
    json: Annotated[Path | None, typer.Option(help="File for the comparison as JSON.", metavar="FILE")] = None,
    partial: Annotated[bool, typer.Option("--partial", help="Accept cases without a partner or a verdict.")] = False,
) -> None:
    """Compare two campaigns, such as two firmwares; exit 1 if a case became worse or has no answer."""
    from hil.apps.campaign.results.compare_table import run_compare

    with exit_on_error():
        status = run_compare(first, second, json, console, partial=partial)
    raise typer.Exit(status)


@dataclass(frozen=True)
class ShrinkCommandOptions:
    case: Annotated[str, typer.Argument(help="A failing case, or the beginning of its name.", metavar="CASE")]
    out: Annotated[
        Path | None, typer.Option(help="Folder of the campaign; default the one in campaigns/ that has the case.")
    ] = None
    workers: WorkersOption = None
    tolerance: Annotated[
        float, typer.Option(help="Of numbers made smaller, as a share of the way to neutral.", min=1e-6, max=1.0)
    ] = 1 / 16
    quiet: QuietOption = False


@campaign.command()
@takes(ShrinkCommandOptions)
def shrink(o: ShrinkCommandOptions) -> None:
    """Make a failing case smaller while it fails in the same way, and print the `hil run` command that repeats it."""
    from hil.apps.campaign.find.command import ShrinkOptions, shrink_case

    with exit_on_error():
        shrink_case(o.case, options_of(ShrinkOptions, o), console)


@dataclass(frozen=True)
class SearchCommandOptions:
    file: Annotated[Path, typer.Argument(help="File of the campaign: its axes are searched.", metavar="FILE")]
    trials: Annotated[int, typer.Option(help="Most flights.", min=1, max=100_000)] = 200
    sampler: Annotated[str, typer.Option(help="tpe, gp (needs PyTorch) or random.")] = "tpe"
    batch: Annotated[int, typer.Option(help="Trials proposed at a time; part of the result.", min=1, max=1000)] = 8
    seed: Annotated[int | None, typer.Option(help="Of the sampler; default sampling_seed.", min=0)] = None
    every: Annotated[bool, typer.Option("--all", help="Go on after the first failure.")] = False
    out: Annotated[Path | None, typer.Option(help="Folder of the search; default campaigns/<name>-search.")] = None
    resume: Annotated[bool, typer.Option("--resume", help="Continue or extend the search in --out.")] = False
    workers: WorkersOption = None
    quiet: QuietOption = False


@campaign.command()
@takes(SearchCommandOptions)
def search(o: SearchCommandOptions) -> None:
    """Look for failures: an optimizer proposes flights with smaller and smaller margins."""
    from hil.apps.campaign.find.command import SearchOptions, search_failures

    with exit_on_error():
        status = search_failures(o.file, options_of(SearchOptions, o), console)
    raise typer.Exit(status)
