"""`hil bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import console, error_console, told
from hil.entry import CONFIG_STATUS


def bench(
    name: Annotated[str, typer.Argument(help="Which benchmark.", metavar="NAME")],
    json: Annotated[Path | None, typer.Option(help="Write rows and checks to this file, the plot beside it.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="At most 60 s; says which checks it leaves out.")] = False,
) -> None:
    """Measure run time against error; exit 1 if a check is not met."""
    from hil.bench_suite.suite import BENCHMARKS, run_benchmark

    if name not in BENCHMARKS:
        error_console.print(f"[bold red]error:[/] no benchmark {name!r}; there are: {', '.join(BENCHMARKS)}")
        raise typer.Exit(CONFIG_STATUS)
    with told():
        met = run_benchmark(name, json=json, quick=quick, console=console)
    raise typer.Exit(0 if met else 1)
