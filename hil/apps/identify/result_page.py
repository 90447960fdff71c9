"""The result page of a fit: one self-contained HTML file in the look of a run's report."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from hil.apps.identify.excitation import Excitation
from hil.apps.identify.excite import manoeuvre_text
from hil.apps.identify.fit_result import Estimated, Fit, Prediction, Residual
from hil.apps.identify.judgement import QUANTITIES, mean_by_horizon
from hil.apps.identify.preparation import Prepared
from hil.run.report.html import table, text
from hil.run.report.page import CSS
from hil.run_files import PAGE_NAME


def write_page(
    out: Path, fit: Fit, prepared: Prepared, *, ratio: float, headline: str, pictures: Mapping[str, Path]
) -> Path:
    """Write `report.html` into `out` and return its path. Raises OSError."""
    better = ratio <= 1.0
    status = "BETTER" if better else "WORSE"
    judged = f"held-out errors are {ratio:.3g} times those of the file that it began with"
    figures = "".join(
        f"<figure><img alt='{escape(alt)}' src='data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}'>"
        "</figure>"
        for alt, path in pictures.items()
    )
    sections = "".join(
        f"<section><h2>{escape(heading)}</h2>{html}</section>"
        for heading, html in (
            ("Parameters", parameter_table([e for e in fit.parameters if e.identified])),
            ("Not identified", not_identified(fit, prepared.excitation)),
            ("Prediction of held-out flight", prediction_table(fit.before, fit.after)),
            ("Residuals", residual_table(fit.residuals)),
            ("Flights and their delays", _flights(prepared)),
            ("What the flights show", _excitation(prepared.excitation)),
            ("Notes on the logs", _notes(prepared)),
        )
    )
    page = out / PAGE_NAME
    page.write_text(
        f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{status} {escape(headline)}</title>
<style>{CSS}</style></head><body>
<header class="{"pass" if better else "fail"}"><b>{status}</b> {escape(headline)}: {escape(judged)}</header>
{figures}
{sections}
</body></html>
""",
        encoding="utf-8",
    )
    return page


def parameter_table(estimates: Sequence[Estimated]) -> str:
    rows = [(e.key, text(float(e.value), e.unit), f"{e.sigma:.2g}", _percent(e)) for e in estimates]
    return table(rows, ("parameter", "value", "1 sigma", "relative")) if rows else "<p>None.</p>"


def _percent(e: Estimated) -> str:
    return f"{abs(e.sigma / e.value):.1%}" if e.value and math.isfinite(e.sigma) else ""


def not_identified(fit: Fit, excitation: Excitation) -> str:
    """Return what could not be identified, why, and which manoeuvre would show it."""
    shown_by = {key: item.manoeuvre for item in (e.parameter for e in excitation.parameters) for key in item.keys}
    rows = [
        (e.key, e.why or "the flights do not show it", manoeuvre_text(shown_by.get(e.key, "")))
        for e in fit.parameters
        if not e.identified
    ]
    mass = (
        "<p>Motion shows forces and moments per mass, never the mass itself: weigh the vehicle and name its mass, "
        "<code>--fix mass_kg=...</code></p>"
    )
    return (table(rows, ("parameter", "why", "manoeuvre that shows it")) if rows else "<p>Nothing else.</p>") + mass


def prediction_table(before: Sequence[Prediction], after: Sequence[Prediction]) -> str:
    """Return mean errors by horizon, before and after."""
    rows = []
    for was, now in zip(mean_by_horizon(before), mean_by_horizon(after), strict=True):
        cells = [f"{was.horizon_s:g}"]
        for name in QUANTITIES:
            a, b = getattr(was, name), getattr(now, name)
            cells.append("not measured" if math.isnan(a) else f"{a:.4g} \N{RIGHTWARDS ARROW} {b:.4g}")
        rows.append(cells)
    head = ["horizon [s]", *(f"{title} [{unit}]" for title, unit in QUANTITIES.values())]
    return table(rows, head) if rows else "<p>Nothing was held out.</p>"


def residual_table(residuals: Sequence[Residual]) -> str:
    rows = [
        (
            "specific force [m/s2]" if r.quantity == "force" else "angular acceleration [rad/s2]",
            r.axis,
            "all" if r.speed_mps is None else f"{r.speed_mps:g}",
            f"{r.mean:+.3g}",
            f"{r.rms:.3g}",
            str(r.samples),
        )
        for r in residuals
    ]
    head = ("residual", "axis of the body", "air speed [m/s]", "mean", "rms", "samples")
    return table(rows, head) if rows else "<p>None.</p>"


def _flights(prepared: Prepared) -> str:
    rows = [
        (
            flight.name,
            str(flight.source),
            f"{flight.start_s:.2f} to {flight.end_s:.2f}",
            _ms(delays.motors_to_gyro_s),
            _ms(delays.gyro_to_pose_s),
        )
        for flight, delays in zip(prepared.flights, prepared.delays, strict=True)
    ]
    head = ("flight", "log", "used [s]", "motors to gyro, with their lag [ms]", "gyro to pose [ms]")
    return table(rows, head) + "<p>First guesses by cross-correlation; fitted delays stand among the parameters.</p>"


def _ms(delay_s: float | None) -> str:
    return "not shown" if delay_s is None else f"{1e3 * delay_s:.1f}"


def _excitation(excitation: Excitation) -> str:
    rows = [
        (
            item.parameter.name,
            "nothing" if math.isinf(item.relative_sigma) else f"{item.relative_sigma:.2g}",
            "yes" if item.excited else f"no: {item.parameter.missing}",
            "" if item.excited else manoeuvre_text(item.parameter.manoeuvre),
        )
        for item in excitation.parameters
    ]
    values = ", ".join(f"{x:.2g}" for x in excitation.eigenvalues)
    joint = "".join(
        f"<p>Open combination (eigenvalue {value:.1g}): {escape(' with '.join(shares))}.</p>"
        for value, shares in excitation.combinations
    )
    head = ("parameter", "relative 1 sigma to expect", "excited", "manoeuvre")
    return table(rows, head) + f"<p>Eigenvalues of the scaled information matrix: {values}.</p>" + joint


def _notes(prepared: Prepared) -> str:
    return "".join(f"<p>{escape(str(note))}</p>" for note in prepared.notes) or "<p>None.</p>"
