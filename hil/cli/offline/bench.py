"""`hil bench`: runs a benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error


def bench(
    name: Annotated[str, typer.Argument(help="Name of the benchmark, or all.", metavar="NAME")],
    json: Annotated[Path | None, typer.Option(help="Write rows and checks to this file, and a plot beside it.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Run for at most 60 s, and list the omitted checks.")] = False,
    errors_only: Annotated[
        bool, typer.Option("--errors-only", help="Leave out the checks of speed, which load on the machine moves.")
    ] = False,
    without: Annotated[
        list[str] | None, typer.Option(help="Benchmark that 'all' leaves out; may be repeated.", metavar="NAME")
    ] = None,
    logs: Annotated[Path | None, typer.Option(help="Folder of flight logs, of the benchmark 'flights'.")] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file that predicts them, of the benchmark 'flights'.", metavar="FILE")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Option of the benchmark 'realism', 'gym' or 'flights'; may be repeated.",
            metavar="KEY=VALUE,...",
        ),
    ] = None,
) -> None:
    """Measure speed together with error. Exit with status 1 if a check is not met."""
    from hil.apps.bench_suite.suite import run_benchmarks

    named = [f"{key}={value}" for key, value in (("logs", logs), ("vehicle", vehicle)) if value is not None]
    with exit_on_error():
        met = run_benchmarks(
            name,
            json=json,
            quick=quick,
            console=console,
            settings=[*(settings or ()), *named],
            errors_only=errors_only,
            without=without or (),
        )
    raise typer.Exit(0 if met else 1)
