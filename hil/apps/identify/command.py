"""`hil identify`: from flight logs to a vehicle file, a result page, and a judgement on held-out flight."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console
from rich.table import Table

from hil.apps.identify.excitation import Excitation
from hil.apps.identify.excite import MANOEUVRES, ExciteFiles, Limits, write_excitation
from hil.apps.identify.fit_result import Fit
from hil.apps.identify.fixed_values import read_fixed, with_fixed
from hil.apps.identify.judgement import QUANTITIES, error_ratio, judged_pairs, mean_by_horizon
from hil.apps.identify.preparation import Prepared, prepare
from hil.apps.identify.vehicle_text import vehicle_text
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.report.run_folder import locked_folder
from hil.run.report.run_json import run_json_text
from hil.run.runs.progress import CountProgress
from hil.run_files import MCAP_NAME
from signals.errors import ConfigError, RecordingError
from sim.physics.vehicle import Vehicle, load_vehicle

PROGRESS_STEPS = 1000
_READING_SHARE = 0.1  # of the bar


@dataclass(frozen=True)
class IdentifyOptions:
    """Options of the command, as typed."""

    vehicle: str
    fix: Sequence[str] = ()
    columns: Path | None = None
    out: Path | None = None
    of: str = ""
    horizons_s: Sequence[float] = ()
    quiet: bool = False


@dataclass(frozen=True)
class Identified:
    """Outcome of the command. `worse`: the fitted vehicle predicts held-out flight worse than the given one."""

    folder: Path
    fit: Fit
    ratio: float

    @property
    def worse(self) -> bool:
        return not self.ratio <= 1.0


class Estimate(Protocol):
    """The estimator; `hil.apps.identify.fit.estimate`."""

    def __call__(
        self,
        flights: Sequence[FlightLog],
        vehicle: Vehicle,
        *,
        fixed: Mapping[str, float],
        progress: Callable[[float, str], None],
    ) -> Fit: ...


class _Progress(CountProgress):
    """Share done and what is being done."""

    def __init__(self, *, quiet: bool) -> None:
        super().__init__("identify", PROGRESS_STEPS, quiet=quiet)
        self._what = ""

    def text(self, done: int, now_s: float) -> str:
        del now_s
        return f"{done / PROGRESS_STEPS:4.0%}  {self._what}"

    def at(self, share: float, what: str) -> None:
        self._what = what
        self.show(round(PROGRESS_STEPS * min(max(share, 0.0), 1.0)))


def identify(
    logs: Sequence[Path], options: IdentifyOptions, console: Console, *, estimate: Estimate | None = None
) -> Identified:
    """Fit a vehicle to logs and write `vehicle.yaml`, `identify.json` and `report.html`.

    Raises ConfigError for logs and options that no fit can use; then nothing is written.
    """
    vehicle = load_vehicle(options.vehicle)
    fixed = read_fixed(options.fix, vehicle)
    began = with_fixed(vehicle, fixed)
    with _Progress(quiet=options.quiet) as progress:
        prepared = prepare(
            logs,
            began,
            columns=options.columns,
            of=options.of,
            progress=lambda share, what: progress.at(_READING_SHARE * share, what),
        )
        fit = (estimate or _estimator())(
            prepared.flights,
            began,
            fixed=fixed,
            progress=lambda share, what: progress.at(_READING_SHARE + (1.0 - _READING_SHARE) * share, what),
        )
    ratio = error_ratio(judged_pairs(fit, options.horizons_s))
    folder = options.out or Path(f"identify-{vehicle.name}")
    found = Identified(folder, fit, ratio)
    with locked_folder(folder):
        _write(found, prepared, options, fixed)
    _print(console, found, prepared)
    return found


def _estimator() -> Estimate:
    from hil.apps.identify.fit import estimate  # imported late: CasADi takes a third of a second

    return estimate


def excite(
    logs: Sequence[Path],
    options: IdentifyOptions,
    console: Console,
    *,
    limits: Limits,
    home_deg: tuple[float, float],
) -> ExciteFiles:
    """Write a mission that shows what the logs do not; without logs, everything. Raises ConfigError."""
    vehicle = load_vehicle(options.vehicle)
    names, why = list(MANOEUVRES), ["no logs were given: every manoeuvre"]
    if logs:
        with _Progress(quiet=options.quiet) as progress:
            prepared = prepare(logs, vehicle, columns=options.columns, of=options.of, progress=progress.at)
        names, why = _missing(prepared.excitation)
        if not names:
            hint = "there is nothing left to fly for; hil identify without --excite fits them"
            raise ConfigError.at("--excite", "the logs show every parameter within 10 %", hint)
    folder = options.out or Path(f"excite-{vehicle.name}")
    with locked_folder(folder):
        try:
            files = write_excitation(folder, vehicle, names, limits=limits, home_deg=home_deg, why=why)
        except OSError as error:
            raise _unwritable(folder, error) from error
    for line in files.derivation:
        console.print(line)
    return files


def named_logs(logs: Sequence[Path] | None) -> Sequence[Path]:
    """Return the logs of a command line. Raises ConfigError if there is none."""
    if not logs:
        raise ConfigError.at("LOG", "is missing", "name one or more flight logs, or write a mission: --excite")
    return logs


def read_home(text: str) -> tuple[float, float]:
    """Return latitude and longitude [deg] of "LAT,LON". Raises ConfigError."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        latitude = longitude = math.nan
    if not (abs(latitude) <= 85.0 and abs(longitude) <= 180.0):
        raise ConfigError.at("--home", f"must be LAT,LON in degrees, such as 47.397742,8.545594, not {text!r}")
    return latitude, longitude


def _missing(excitation: Excitation) -> tuple[list[str], list[str]]:
    """Return the manoeuvres for what is not excited, in the order of a flight, and why each is needed."""
    wanted = {item.manoeuvre for item in excitation.missing}
    why = [
        f"{item.parameter.name}: relative sigma {item.relative_sigma:.2g}, so {item.parameter.manoeuvre}"
        for item in excitation.parameters
        if not item.excited
    ]
    return [name for name in MANOEUVRES if name in wanted], why


def _unwritable(folder: Path, error: OSError) -> RecordingError:
    return RecordingError(f"{error.filename or folder}: cannot be written ({error.strerror or error})")


@contextmanager
def _replaced(path: Path) -> Iterator[Path]:
    """Yield a temporary file that takes the place of `path` in the end: a full disk destroys no earlier result."""
    temporary = path.with_suffix(path.suffix + ".part")
    yield temporary
    os.replace(temporary, path)


def _write(found: Identified, prepared: Prepared, options: IdentifyOptions, fixed: Mapping[str, float]) -> None:
    from hil.apps.identify.pictures import draw_flights, draw_predictions, draw_residuals  # matplotlib takes its time
    from hil.apps.identify.result_page import write_page

    out, fit = found.folder, found.fit
    names = [log.source.name if log.source.name != MCAP_NAME else f"{log.name}/{MCAP_NAME}" for log in prepared.whole]
    try:
        with _replaced(out / "vehicle.yaml") as path:
            text = vehicle_text(fit, began_with=Path(options.vehicle).name, logs=names, fixed=fixed)
            path.write_text(text, encoding="utf-8")
        with _replaced(out / "identify.json") as path:
            path.write_text(run_json_text(_facts(found, prepared, options, fixed)), encoding="utf-8")
        pictures = {
            "held-out prediction": out / "prediction.png",
            "residuals": out / "residuals.png",
            "flights": out / "flights.png",
        }
        draw_predictions(fit, pictures["held-out prediction"])
        draw_residuals(fit.residuals, pictures["residuals"])
        draw_flights(prepared.whole, prepared.flights, pictures["flights"])
        headline = f"{fit.vehicle.name} from {', '.join(names)}"
        write_page(out, fit, prepared, ratio=found.ratio, headline=headline, pictures=pictures)
    except OSError as error:
        raise _unwritable(out, error) from error


def _facts(
    found: Identified, prepared: Prepared, options: IdentifyOptions, fixed: Mapping[str, float]
) -> dict[str, Any]:
    """Return the content of identify.json."""
    fit = found.fit
    return {
        "schema": 1,
        "vehicle": {"name": fit.vehicle.name, "began_with": str(options.vehicle), "fixed": dict(fixed)},
        "better": not found.worse,
        "error_ratio": found.ratio,
        "flights": [
            {
                "name": flight.name, "log": str(flight.source), "start_s": flight.start_s, "end_s": flight.end_s,
                "motors": flight.motors_kind, "estimated": flight.estimated, **asdict(delays),
            }
            for flight, delays in zip(prepared.flights, prepared.delays, strict=True)
        ],
        "parameters": [asdict(e) for e in fit.parameters],
        "predictions": [
            {"log": was.log, "horizon_s": was.horizon_s, "before": _errors(was), "after": _errors(now)}
            for was, now in zip(fit.before, fit.after, strict=True)
        ],
        "residuals": [asdict(r) for r in fit.residuals],
        "excitation": {
            "parameters": [
                {"name": e.parameter.name, "keys": list(e.parameter.keys), "relative_sigma": e.relative_sigma,
                 "excited": e.excited, "missing": "" if e.excited else e.parameter.missing,
                 "manoeuvre": "" if e.excited else e.parameter.manoeuvre}
                for e in prepared.excitation.parameters
            ],
            "eigenvalues": list(prepared.excitation.eigenvalues),
            "combinations": [
                {"eigenvalue": value, "parameters": dict(shares)}
                for value, shares in prepared.excitation.combinations
            ],
        },
        "notes": [str(note) for note in prepared.notes],
    }  # fmt: skip


def _errors(prediction: Any) -> dict[str, float]:
    return {name: float(getattr(prediction, name)) for name in QUANTITIES}


def _print(console: Console, found: Identified, prepared: Prepared) -> None:
    fit = found.fit
    for note in prepared.notes:
        console.print(f"note: {note}")
    table = Table("parameter", box=None, padding=(0, 2, 0, 0))
    for head in ("value", "1 sigma", "unit"):
        table.add_column(head, justify="right")
    for e in fit.parameters:
        if e.of_vehicle:
            table.add_row(e.key, f"{e.value:.5g}", f"{e.sigma:.2g}" if e.identified else "not identified", e.unit)
    console.print(table)
    for was, now in zip(mean_by_horizon(fit.before), mean_by_horizon(fit.after), strict=True):
        errors = ", ".join(
            f"{title} {getattr(was, name):.4g} -> {getattr(now, name):.4g} {unit}"
            for name, (title, unit) in QUANTITIES.items()
            if getattr(was, name) == getattr(was, name)
        )
        console.print(f"held out, {was.horizon_s:g} s ahead: {errors}")
    verdict = "worse" if found.worse else "no worse"
    console.print(f"held-out errors are {found.ratio:.3g} times those of the file it began with: {verdict}")
