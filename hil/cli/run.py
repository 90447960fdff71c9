"""`hil run`."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from hil.cli.options import (
    ConfigArgument,
    DashHostOption,
    DashPortOption,
    MissionOption,
    OutOption,
    QuietOption,
    RigOption,
    SceneOption,
    SeedOption,
    SetOption,
    complain,
    console,
    error_console,
)
from hil.entry import CONFIG_STATUS, ERROR_STATUS
from hil.run_folder import leave_config_error, new_run_dir
from hil.signals.errors import ConfigError, HilError

if TYPE_CHECKING:
    from hil.bench import RunResult
    from hil.dashboard.live_run import LiveRun


def run(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    settings: SetOption = None,
    quiet: QuietOption = False,
    dash: Annotated[bool, typer.Option("--dash", help="With a page in the browser that follows the flight.")] = False,
    dash_host: DashHostOption = "127.0.0.1",
    dash_port: DashPortOption = 8710,
    dash_fd: Annotated[int | None, typer.Option("--dash-fd", hidden=True)] = None,
    dash_pace: Annotated[float | None, typer.Option("--dash-pace", hidden=True, min=0.01, max=1000.0)] = None,
    dash_paused: Annotated[bool, typer.Option("--dash-paused", hidden=True)] = False,
    dash_runs: Annotated[Path, typer.Option("--dash-runs", hidden=True)] = Path("runs"),
) -> None:
    """Fly a mission on a rig and judge the flight."""
    began_s = time.monotonic()
    from hil.config import load_bench

    try:
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, seed=seed, settings=settings or ())
    except ConfigError as error:
        complain(error)
        with contextlib.suppress(HilError):  # the message is out; no folder to leave run.json in is no second one
            leave_config_error(error, new_run_dir(out, rig or "unknown", dash_runs), rig=rig, scene=scene, seed=seed)
        raise typer.Exit(CONFIG_STATUS) from None
    from hil.bench import run_bench

    result: RunResult | None = None
    try:
        folder = new_run_dir(out, bench.config.rig, dash_runs)
        with contextlib.ExitStack() as stack:
            live: LiveRun | None = None
            if dash:
                from hil.dash_command import dashboard_beside

                runs = folder.resolve().parent
                live = stack.enter_context(dashboard_beside(config, console, host=dash_host, port=dash_port, runs=runs))
            elif dash_fd is not None:
                from hil.dash_command import live_on_fd

                live = live_on_fd(dash_fd, paused=dash_paused, pace=dash_pace)
                stack.callback(live.close)
            result = run_bench(bench, folder, quiet=quiet, live=live)
            with contextlib.suppress(OSError, ValueError):
                _print_result(result.run, folder, time.monotonic() - began_s)
    except HilError as error:  # not even the folder could be written, or the page not be served
        complain(error)
        raise typer.Exit(ERROR_STATUS) from None
    except KeyboardInterrupt:
        if result is None:
            raise
    assert result is not None
    raise typer.Exit(result.exit_status)


def _print_result(run: dict[str, object], folder: Path, took_s: float) -> None:
    """The headline of a run, as a person wants to read it."""
    colour = {"PASS": "green", "FAIL": "yellow"}.get(str(run["status"]), "red")
    table = Table.grid(padding=(0, 2))
    mission: dict[str, object] = run["mission"]  # type: ignore[assignment]
    verdict: dict[str, list[dict[str, object]]] = run["verdict"]  # type: ignore[assignment]
    if mission["waypoints"]:
        table.add_row("waypoints", f"{mission['reached']} of {mission['waypoints']}")
    for row in verdict["rows"]:
        if row["value"] is not None:
            limit = f"(limit {row['limit']:g})" if row["limit"] is not None else "(not judged)"
            table.add_row(
                str(row["name"]).rsplit("_", 1)[0].replace("_", " "), f"{row['value']:.3f} {row['unit']} {limit}"
            )
    table.add_row(
        "speed", f"{run['sim_s']:.1f} s simulated in {run['wall_s']:.1f} s: {run['realtime_factor']:.1f}x real time"
    )
    companion: dict[str, object] | None = run.get("companion")  # type: ignore[assignment]
    if companion:
        from hil.report.page import console_rows

        for label, text in console_rows(companion):
            table.add_row(label, text)
    same = "" if run["deterministic"] else "  (not deterministic)"
    console.print(f"[bold {colour}]{run['status']}[/]")
    error: dict[str, str] | None = run["error"]  # type: ignore[assignment]
    if error:
        error_console.print(f"[bold red]error:[/] {escape(error['type'])}: {escape(error['message'])}")
    for reason in verdict["reasons"] if run["status"] == "FAIL" else []:
        console.print(f"  {reason}", markup=False)
    console.print(table)
    # Unbroken lines, so that they can be copied, compared and searched for.
    console.print(f"digest   {run['digest']}{same}", markup=False)
    console.print(f"results  {folder}/  (report.html, run.json; {took_s:.1f} s in all)", markup=False)
