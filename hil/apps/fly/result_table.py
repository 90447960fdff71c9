"""The result of a run on the console."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hil.run_files import PAGE_NAME, RUN_JSON_NAME

_WARNINGS_SHOWN = 12  # different ones


def print_result(run: dict[str, Any], folder: Path, took_s: float, console: Console, errors: Console) -> None:
    """Print the results of a run: status, measurements with their limits, digest, folder. `run` is its run.json."""
    colour = {"PASS": "green", "FAIL": "yellow"}.get(str(run["status"]), "red")
    table = Table.grid(padding=(0, 2))
    mission, verdict = run["mission"], run["verdict"]
    if mission["waypoints"]:
        table.add_row("waypoints", f"{mission['reached']} of {mission['waypoints']}")
    for row in verdict["rows"]:
        if row["value"] is not None:
            limit = "(not judged)" if row["ok"] else "(failed)"
            if row["limit"] is not None:
                limit = f"(limit {row['limit']:g})"
            table.add_row(
                str(row["name"]).rsplit("_", 1)[0].replace("_", " "), f"{row['value']:.3f} {row['unit']} {limit}"
            )
    table.add_row(
        "speed", f"{run['sim_s']:.1f} s simulated in {run['wall_s']:.1f} s: {run['realtime_factor']:.1f}x real time"
    )
    for name, vehicle in run.get("vehicles", {}).items():
        reached = f"{vehicle['mission']['reached']} of {vehicle['mission']['waypoints']} waypoints"
        table.add_row(name, f"{vehicle['status']}{' (lost)' if vehicle['lost'] else ''}, {reached}")
    if companion := run.get("companion"):
        from hil.run.report.companion_section import console_rows

        for label, text in console_rows(companion):
            table.add_row(label, text)
    digest_note = "" if run["deterministic"] else "  (not deterministic)"
    console.print(f"[bold {colour}]{run['status']}[/]", markup=True)
    if error := run["error"]:
        errors.print(f"[bold red]error:[/] {escape(error['type'])}: {escape(error['message'])}", markup=True)
    for reason in verdict["reasons"] if run["status"] == "FAIL" else []:
        console.print(f"  {reason}", markup=False)
    for failsafe in run.get("failsafes", ()):
        if failsafe["expected"] or run["status"] != "FAIL":  # else it is a reason
            console.print(f"  {failsafe['line']}{' (expected)' if failsafe['expected'] else ''}", markup=False)
    print_warnings(run, console)
    console.print(table, markup=False)
    # Unbroken lines, so that they can be copied, compared and searched for.
    console.print(f"digest   {run['digest']}{digest_note}", markup=False)
    names = ", ".join(name for name in (PAGE_NAME, RUN_JSON_NAME) if (folder / name).exists())
    console.print(f"results  {folder}/  ({names}; {took_s:.1f} s in all)", markup=False)


def print_warnings(run: dict[str, Any], console: Console) -> None:
    """Print the warnings of a run, each text once: any may be the cause of a FAIL."""
    texts: dict[tuple[str, str], list[float]] = {}
    for row in run["warnings"]:
        owner = f"{row['vehicle']}: " if "vehicle" in row else ""
        texts.setdefault((row["level"], f"{owner}{row['text']}"), []).append(row["t_s"])
    for (level, text), times_s in list(texts.items())[:_WARNINGS_SHOWN]:
        colour = "red" if level == "error" else "yellow"
        more = f", {len(times_s)} times" if len(times_s) > 1 else ""
        console.print(f"  [{colour}]{level}:[/] {escape(text)} (at {times_s[0]:.1f} s{more})", markup=True)
    if len(texts) > _WARNINGS_SHOWN:
        console.print(f"  and {len(texts) - _WARNINGS_SHOWN} more warnings, in run.json", markup=False)
