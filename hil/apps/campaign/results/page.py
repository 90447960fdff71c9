"""report.html of a campaign: one self-contained file of bounded size, whatever the number of cases."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from hil.apps.campaign.flight import Limit
from hil.apps.campaign.results.again import replay_command, run_command
from hil.apps.campaign.results.groups import shortened, value_text
from hil.apps.campaign.results.statistics import Tally
from hil.apps.campaign.results.summary import FEW, SAMPLE, PairRates, Rates, Summary, separation
from hil.apps.campaign.results.tables import KEPT
from hil.apps.campaign.store import Case
from hil.run.report.html import table
from hil.run.report.page import CSS
from hil.run.report.row_search import SCRIPT
from hil.run.runs.progress import minutes
from hil.run_files import PAGE_NAME
from signals.errors import file_errors
from signals.words import counted

_MOST_PAIRS = 12
_MOST_PICTURES = 9
_MOST_GROUPS_OF_A_PAIR = 14
_ORANGE_BELOW = 0.8  # rate; lower if a cell is


@dataclass(frozen=True)
class Facts:
    """Facts about a campaign beside its results. `bench`: file of the base bench."""

    name: str
    description: str
    folder: Path
    bench: Path | None
    points: int
    stopped: str
    complete: bool
    flown: int
    wall_s: float


def write_page(facts: Facts, summary: Summary) -> None:
    """Write report.html and its pictures into the folder of the campaign. Raises RecordingError."""
    with file_errors(facts.folder, "the report cannot be written", hint=KEPT):
        (facts.folder / PAGE_NAME).write_text(_page(facts, summary), encoding="utf-8", errors="replace")


def _page(facts: Facts, summary: Summary) -> str:
    tally = summary.tally
    status = {0: "PASS", 1: "FAIL", 3: "ERROR"}[tally.exit_status]
    low, rate, high = tally.interval()
    line = f"{tally.passed:,} of {counted(tally.judged, 'flight')} passed" if tally.judged else "no flight was judged"
    if tally.judged:
        line += f": {100 * rate:.1f} %, between {100 * low:.1f} % and {100 * high:.1f} %"
    broken, worst = summary.broken, summary.worst
    failed = sum(case.status == "FAIL" for case in worst)
    sections = [
        ("Pass rate by axis", _axes(summary)),
        ("Pass rate by pair of axes", _pairs(summary)),
        ("Margins", _margins(facts, summary)),
        ("Worst cases", _pictures(facts, summary)),
        ("ERROR and FLAKE", _list(facts, broken, tally.errors + tally.flakes - len(broken))),
        ("Failures, and the passes nearest to a limit", _list(facts, worst, tally.failed - failed)),
    ]
    body = "".join(f"<section><h2>{heading}</h2>{html}</section>" for heading, html in sections if html)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{status} {escape(facts.name)}</title><link rel="icon" href="data:,"><style>{CSS}{_CSS}</style></head><body>
<header class="{status.lower()}"><b>{status}</b> {escape(facts.name)}: {line}</header>
<p>{escape(facts.description)}</p>
{_facts(facts, summary)}
{body}
<footer>Every case is a row of <a href="results.csv">results.csv</a>, with all limits in results.jsonl. Intervals are
Wilson's at 95 %. A margin is the distance to the limit in per cent of the limit; below 0 the limit was missed.</footer>
<script>{SCRIPT}</script></body></html>
"""


def _facts(facts: Facts, summary: Summary) -> str:
    tally = summary.tally
    chips = [("PASS", tally.passed), ("FAIL", tally.failed), ("ERROR", tally.errors), ("FLAKE", tally.flakes)]
    counts = "".join(
        f"<li class='{name.lower() if count else 'none'}'><b>{count:,}</b> {name}</li>" for name, count in chips
    )
    notes = [
        f"{counted(tally.cases, 'case')} of {counted(facts.points, 'point')}, {summary.sim_s / 3600:.1f} h of flight; "
        f"this call made {counted(facts.flown, 'flight')} in {minutes(facts.wall_s)}."
    ]
    if facts.stopped:
        notes.append(
            f"Stopped early: {facts.stopped}. The rule looked after every case, so the interval is narrower than it "
            "should be."
        )
    elif not facts.complete:
        notes.append("Interrupted: the campaign continues with --resume.")
    if tally.errors or tally.flakes:
        notes.append("ERROR and FLAKE say nothing about the vehicle and are in no rate.")
    return f"<ul class='counts'>{counts}</ul>" + "".join(f"<p>{escape(note)}</p>" for note in notes)


def _axes(summary: Summary) -> str:
    ordered = sorted(summary.rates.items(), key=lambda item: (item[0] == "seed", -separation(item[1].values())))
    shown = [(axis, rates) for axis, rates in ordered if any(tally.judged for tally in rates.values())]
    if not shown:
        return ""
    tallies = [tally for _, rates in shown for tally in rates.values() if tally.judged]
    least = int(10 * min(tally.interval()[0] for tally in tallies)) / 10
    text = f"Mark: the rate. Bar: its interval, on a scale from {100 * least:.0f} to 100 %. "
    text += "Axes whose values differ most come first."
    cards = "".join(_axis(axis, rates, least) for axis, rates in shown)
    return f"<p class='soft'>{text}</p><div class='cards'>{cards}</div>"


def _axis(axis: str, rates: Rates, least: float) -> str:
    """Return the rates of an axis. `least`: the rate at the left end of the bars."""

    def place(rate: float) -> float:
        return 100.0 * (rate - least) / (1.0 - least)

    rows = []
    for name, tally in rates.items():
        if not tally.judged:
            continue
        low, rate, high = tally.interval()
        title = f"{tally.passed:,} of {tally.judged:,} passed: {100 * low:.1f} % to {100 * high:.1f} %"
        rows.append(
            f"<tr title='{title}'><td class='value'>{escape(shortened(name))}</td><td class='bar'><div>"
            f"<i style='left:{place(low):.1f}%;width:{place(high) - place(low):.1f}%'></i>"
            f"<b style='left:{place(rate):.1f}%'></b></div></td>"
            f"<td class='num'>{100 * rate:.1f} %</td><td class='num soft'>{tally.judged:,}</td></tr>"
        )
    return f"<div class='card'><h3>{escape(axis)}</h3><table>{''.join(rows)}</table></div>"


def _pairs(summary: Summary) -> str:
    def varies(pair: tuple[str, str]) -> bool:
        return all(1 < len(summary.groups[axis].names) <= _MOST_GROUPS_OF_A_PAIR for axis in pair)

    pairs = [(pair, rates) for pair, rates in summary.pairs.items() if varies(pair) and rates]
    shown = sorted(pairs, key=lambda item: -separation(item[1].values()))[:_MOST_PAIRS]
    if not shown:
        return ""
    certain = [tally.interval()[1] for _, rates in shown for tally in rates.values() if tally.judged >= FEW]
    least = min([_ORANGE_BELOW, *certain])
    note = f"Pass rate in per cent: {100 * least:.0f} is orange, 100 is blue, pale cells have few flights. "
    if len(pairs) > len(shown):
        note += f"These are the {len(shown)} of {len(pairs)} pairs whose cells differ most."
    maps = "".join(_heat_map(summary, pair, rates, least) for pair, rates in shown)
    return f"<p class='soft'>{note}</p><div class='cards wide'>{maps}</div>"


def _heat_map(summary: Summary, pair: tuple[str, str], rates: PairRates, least: float) -> str:
    down, across = sorted(pair, key=lambda axis: -max(map(len, summary.groups[axis].names)))  # long names: rows
    columns = "".join(
        f"<th title='{escape(name)}'>{escape(shortened(name, 30))}</th>" for name in summary.groups[across].names
    )
    rows = ""
    for row in summary.groups[down].names:
        keys = [(row, column) if down == pair[0] else (column, row) for column in summary.groups[across].names]
        cells = "".join(_cell(rates.get(key), least) for key in keys)
        rows += f"<tr><th title='{escape(row)}'>{escape(shortened(row))}</th>{cells}</tr>"
    heading = f"{escape(down)} <span class='soft'>down,</span> {escape(across)} <span class='soft'>across</span>"
    return f"<div class='card'><h3>{heading}</h3><table class='heat'><tr><th></th>{columns}</tr>{rows}</table></div>"


def _cell(tally: Tally | None, least: float) -> str:
    if tally is None or not tally.judged:
        return "<td></td>"
    low, rate, high = tally.interval()
    blue = max(0.0, 100.0 * (rate - least) / (1.0 - least))
    title = f"{tally.passed:,} of {tally.judged:,} passed: {100 * low:.0f} % to {100 * high:.0f} %"
    strength = 75.0 * (1.0 - (high - low))
    colour = f"color-mix(in oklab,color-mix(in oklab,#0072b2 {blue:.0f}%,#e66a00) {strength:.0f}%,transparent)"
    return f"<td style='background:{colour}' title='{title}'>{100 * rate:.0f}</td>"


def _margins(facts: Facts, summary: Summary) -> str:
    if not summary.margins:
        return ""
    from hil.apps.campaign.results import figures

    pictures = [("histogram of the margins to each limit", figures.margins_picture(facts.folder, summary.margins))]
    first = summary.points[:1]
    axes = [a for a, value in (first[0].axes if first else {}).items() if _is_number(value) and _varies(summary, a)]
    if axes:
        caption = "smallest margin of each flight over every numeric axis"
        pictures.append((caption, figures.axes_picture(facts.folder, summary.points, axes)))
    rows = []
    for name, of in sorted(summary.margins.items(), key=lambda item: item[1].least):
        data = of.data()
        numbers = (data[key] for key in ("min", "p05", "p50", "p95"))
        rows.append(
            (figures.short_name(name), f"{of.count:,}", f"{of.missed:,}", *(f"{100 * x:.1f} %" for x in numbers))
        )
    head = ("limit", "flights", "missed", "least", "5 %", "median", "95 %")
    most = max(of.count for of in summary.margins.values())
    wide = f"<div class='scroll'>{table(rows, head)}</div>"
    note = f"<p class='soft'>Quantiles and histograms: of {SAMPLE:,} random flights.</p>" if most > SAMPLE else ""
    return "".join(_figure(caption, path) for caption, path in pictures) + wide + note


def _figure(caption: str, path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    text = f"<figcaption class='soft'>{escape(caption)}</figcaption>"
    return f"<figure><img alt='{escape(caption)}' src='data:image/png;base64,{data}'>{text}</figure>"


def _pictures(facts: Facts, summary: Summary) -> str:
    from hil.apps.campaign.results import figures

    shown: list[str] = []
    for case in (*summary.worst, *summary.broken):
        picture = figures.small_picture(_folder(facts, case))
        if picture:
            text = f"<b>{case.status}</b> {_link(facts, case)} {_margin(case)}"
            shown.append(
                f"<figure><img alt='' src='data:image/jpeg;base64,{picture}'><figcaption>{text}</figcaption></figure>"
            )
        if len(shown) == _MOST_PICTURES:
            break
    return f"<div class='small'>{''.join(shown)}</div>" if shown else ""


def _list(facts: Facts, cases: Sequence[Case], more: int) -> str:
    if not cases:
        return ""
    note = f"<p class='soft'>{more:,} more are in results.csv.</p>" if more > 0 else ""
    search = "<p><input type='search' hidden placeholder='search' aria-label='search'> <span class='soft'></span></p>"
    rows = "".join(_row(facts, case) for case in cases)
    head = "<tr><th></th><th>case</th><th>margin</th><th>axes and reason</th></tr>"
    return f"<div class='list'>{search}<table>{head}{rows}</table>{note}</div>"


def _row(facts: Facts, case: Case) -> str:
    axes = ", ".join(f"<span>{escape(axis)}</span>={escape(value_text(v))}" for axis, v in case.axes.items())
    reason = f"<p class='why'>{escape(_reason(case))}</p>" if case.reason else ""
    commands = [run_command(facts.bench, case.texts)]
    if _folder(facts, case).is_dir():
        commands.insert(0, replay_command(_folder(facts, case)))
    lines = "".join(f"<code>{escape(line)}</code>" for line in commands)
    again = f"<details><summary>fly it again</summary>{lines}</details>"
    return (
        f"<tr><td><b class='mark {case.status.lower()}'>{case.status}</b></td><td>{_link(facts, case)}</td>"
        f"<td class='num'>{_margin(case)}</td><td>{axes}{reason}{again}</td></tr>"
    )


def _reason(case: Case) -> str:
    return f"{case.reason}: {case.outcome.error}" if case.outcome.error else case.reason


def _link(facts: Facts, case: Case) -> str:
    if not (_folder(facts, case) / PAGE_NAME).is_file():
        return f"<code>{escape(case.id)}</code>"
    return f"<a href='cases/{escape(case.id)}/{PAGE_NAME}'><code>{escape(case.id)}</code></a>"


def _folder(facts: Facts, case: Case) -> Path:
    return facts.folder / "cases" / case.id


def _margin(case: Case) -> str:
    worst: Limit | None = case.outcome.worst
    if worst is None or worst.margin is None:
        return ""
    return f"<span title='{escape(worst.name)}'>{100 * worst.margin:.0f} %</span>"


def _varies(summary: Summary, axis: str) -> bool:
    return axis != "seed" and axis in summary.groups and len(summary.groups[axis].names) > 1


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_CSS = """
.soft{color:var(--soft)}
.scroll{overflow-x:auto}
.num{text-align:right;white-space:nowrap}
h3{font-size:.92rem;margin:0 0 .4rem;overflow-wrap:anywhere}
.counts{display:flex;flex-wrap:wrap;gap:.6rem;list-style:none;padding:0;margin:1rem 0}
.counts li{padding:.35rem .9rem;border-radius:8px;color:#fff}
.counts b{font-size:1.15rem;margin-right:.2rem}
.counts .none{background:var(--card);color:var(--soft)}
.flake{background:#6a3d9a}
.cards{display:grid;grid-template-columns:repeat(auto-fill,minmax(350px,1fr));gap:.8rem}
.cards.wide{grid-template-columns:repeat(auto-fill,minmax(500px,1fr))}
.card{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.7rem .9rem;overflow-x:auto}
.bar{width:45%;min-width:90px;vertical-align:middle}
.bar div{position:relative;height:14px;background:linear-gradient(var(--line),var(--line)) center/100% 1px no-repeat}
.bar i{position:absolute;top:3px;height:8px;background:#0072b2;opacity:.4;border-radius:4px}
.bar b{position:absolute;top:0;height:14px;width:3px;margin-left:-2px;background:#0072b2}
.value{min-width:7.5rem}.card td{vertical-align:middle}.card td:last-child{padding-right:0}
.heat{font-size:.82rem;width:auto}
.heat td{text-align:center;padding:.35rem .5rem;min-width:3.2rem;border:1px solid var(--card)}
.heat th{font-weight:500;border:0;min-width:5rem;max-width:13rem}
.heat tr:first-child th{text-align:center;padding:.2rem .3rem;min-width:0;max-width:8rem}
figcaption{font-size:.85rem;padding:.3rem .2rem 0;overflow-wrap:anywhere}
figure .soft{color:#5b636e}
.small{display:grid;grid-template-columns:repeat(auto-fill,minmax(340px,1fr));gap:.8rem}
.small figure{margin:0}.small figcaption,.small a{color:#20262e}
.mark{color:#fff;border-radius:5px;padding:.1rem .45rem;font-size:.78rem}
.list td{font-size:.88rem}.list td:last-child{overflow-wrap:anywhere}
.list td span{color:var(--soft)}
.why{margin:.2rem 0}
details code{display:block;user-select:all;background:var(--card);padding:.4rem .6rem;margin:.3rem 0;border-radius:5px}
summary{color:var(--soft);cursor:pointer;width:max-content}
input[type=search]{font:inherit;padding:.35rem .6rem;width:min(100%,24rem)}
a{color:inherit}
@media(max-width:640px){
.list table,.list tbody,.list tr,.list td:last-child{display:block}
.list tr{padding:.5rem 0;border-bottom:1px solid var(--line)}
.list tr:first-child{display:none}
.list td{display:inline-block;border:0;padding:.1rem .5rem .1rem 0}
}
tr[hidden]{display:none}
"""
