"""`hil campaign compare`: two campaigns on the console, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hil.apps.campaign.results.compare import Change, Comparison, axes_text, compare_campaigns
from hil.apps.campaign.results.groups import shortened
from hil.run.report.run_json import write_run_json
from signals.errors import ConfigError
from signals.words import counted

_MOST_SHOWN = 20


def run_compare(first: Path, second: Path, json_file: Path | None, console: Console, *, partial: bool) -> int:
    """Print how two campaigns differ and return the exit status. Raises HilError.

    It is 0 if no case became worse, else 1; also 1 for cases without a partner or a verdict, unless `partial`.
    """
    if first.resolve() == second.resolve():
        raise ConfigError.at(str(second), "is named twice: no case can be worse than itself")
    comparison = compare_campaigns(first, second, partial=partial)
    if json_file is not None:
        write_run_json(json_file, comparison.data())
    _print_pairs(comparison, console)
    _print_changes("worse", comparison.worse, console)
    _print_changes("better", comparison.better, console)
    _print_margins(comparison, console)
    if comparison.unanswered:
        end = "accepted by --partial" if partial else "so the exit status is 1; --partial accepts them"
        console.print(f"not compared: {comparison.unanswered}; {end}")
    return comparison.exit_status


def _print_pairs(comparison: Comparison, console: Console) -> None:
    one, two = comparison.alone
    console.print(
        f"{counted(comparison.pairs, 'pair')} of cases; without a partner: {one} of the first, {two} of the second"
    )
    if comparison.same_cases:
        console.print(
            f"the same identity in {counted(comparison.same_cases, 'pair')}: nothing that makes a flight differs"
        )
    if comparison.left_out:
        console.print(f"axes left out, because they have no value in common: {', '.join(comparison.left_out)}")
    for key, (ours, theirs) in comparison.differences.items():
        console.print(f"  {key}: {shortened(ours)} -> {shortened(theirs)}")
    for name, tally in zip(("first", "second"), comparison.tallies, strict=True):
        low, rate, high = tally.interval()
        share = f"{rate:.3f}, between {low:.3f} and {high:.3f} (95 %)" if tally.judged else "not known"
        console.print(f"{name + ':':8}{tally.passed} PASS, {tally.failed} FAIL; pass rate {share}")
    broken = comparison.pairs - min(tally.judged for tally in comparison.tallies)
    if broken:
        console.print(f"ERROR or FLAKE: {' and '.join(str(t.errors + t.flakes) for t in comparison.tallies)}")
    worse, better = comparison.discordant
    console.print(f"PASS to FAIL: {worse}, FAIL to PASS: {better}; exact McNemar test p = {comparison.p_value:.3g}")


def _print_changes(name: str, changes: Sequence[Change], console: Console) -> None:
    if changes:
        console.print(f"{name}: {len(changes)}")
    for change in changes[:_MOST_SHOWN]:
        first, second = change
        console.print(f"  {first.status} -> {second.status}  {first.id} -> {second.id}  {axes_text(first)}")
    if len(changes) > _MOST_SHOWN:
        console.print(f"  and {len(changes) - _MOST_SHOWN} more; --json FILE lists all")


def _print_margins(comparison: Comparison, console: Console) -> None:
    if not comparison.margins:
        return
    head = ("margin to", "pairs", "first [%]", "second [%]", "mean change, 95 % [%]")
    table = Table(*head, box=None, pad_edge=False)
    for name, count, first, second, low, high in comparison.margin_rows():
        table.add_row(
            name, str(count), f"{100 * first:.2f}", f"{100 * second:.2f}", f"{100 * low:+.2f} to {100 * high:+.2f}"
        )
    console.print(table)
