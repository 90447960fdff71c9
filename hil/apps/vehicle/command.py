"""Coefficients of a vehicle's panels: table, derivatives and polars, beside AeroSandbox's and the source's points."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hil.apps.vehicle.coefficients import QUANTITIES, Coefficients, FlightPoint, PanelAircraft
from hil.apps.vehicle.lattice import INSTALL, LatticeAircraft, inviscid
from hil.apps.vehicle.polars import Polars
from signals.errors import ConfigError, HilError
from sim.physics.forces.panels import Panels
from sim.physics.vehicle import VEHICLE_DIR, load_vehicle

ALPHAS_DEG = (*range(-180, -30, 10), *range(-30, 31, 1), *range(40, 181, 10))
LATTICE_DEG = tuple(range(-8, 15, 2))  # attached: the lattice knows no stall


@dataclass(frozen=True)
class AeroFiles:
    """Files that were written."""

    table: Path
    picture: Path


def vehicle_aero(
    name_or_path: str, console: Console, *, airspeed_mps: float, out: Path, lattice: bool | None, points: Path | None
) -> AeroFiles:
    """Write NAME_aero.csv and NAME_aero.png to `out`, print the derivatives.

    `lattice`: with AeroSandbox; None: if it is installed. Raises HilError, OSError.
    """
    vehicle = load_vehicle(name_or_path)
    panels = next((force for force in vehicle.forces if isinstance(force, Panels)), None)
    if panels is None:
        problem = "has no entry of `kind: panels` in its `forces`"
        raise ConfigError.at(name_or_path, problem, "name an aircraft, such as trainer")
    own = PanelAircraft(panels)
    at = FlightPoint(airspeed_mps)
    other = _lattice(panels, console, wanted=lattice)
    points = points or VEHICLE_DIR / "polars" / f"{vehicle.name}.csv"
    polars = Polars(
        own=_polar(own, at, ALPHAS_DEG),
        lattice=_polar(other, at, LATTICE_DEG) if other else {},
        points=read_points(points) if points.exists() else {},
    )
    _print(console, own, other, panels, at)
    out.mkdir(parents=True, exist_ok=True)
    files = AeroFiles(out / f"{vehicle.name}_aero.csv", out / f"{vehicle.name}_aero.png")
    _write(polars, files.table)
    from hil.apps.vehicle.picture import draw_polars  # imports matplotlib, which is slow

    draw_polars(polars, vehicle.description, files.picture)
    return files


def read_points(path: Path) -> dict[float, Coefficients]:
    """Read points of a CSV with a column alpha_deg and any of CL, CD, CY, Cl, Cm, Cn; lines with # are comments."""
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and not line.startswith("#")
    ]
    found: dict[float, Coefficients] = {}
    for row in csv.DictReader(lines):
        try:
            values = {key: float(value) for key, value in row.items() if key in QUANTITIES and value}
            found[float(row["alpha_deg"])] = values
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError.at(
                str(path), f"{row}: each row needs a number in alpha_deg and in its other columns"
            ) from error
    return found


def _lattice(panels: Panels, console: Console, *, wanted: bool | None) -> LatticeAircraft | None:
    if wanted is False:
        return None
    try:
        return LatticeAircraft(panels)
    except HilError:
        if wanted:
            raise
        console.print(f"Without AeroSandbox: {INSTALL} puts its coefficients beside these.", markup=False)
        return None


def _polar(aircraft: PanelAircraft, at: FlightPoint, alphas_deg: tuple[int, ...]) -> dict[float, Coefficients]:
    return {float(a): aircraft.coefficients(replace(at, alpha_rad=math.radians(a))) for a in alphas_deg}


def _print(
    console: Console, own: PanelAircraft, other: LatticeAircraft | None, panels: Panels, at: FlightPoint
) -> None:
    table = Table(title=f"Derivatives at {at.airspeed_mps:g} m/s and alpha = 0, per rad")
    table.add_column("by")
    for name in QUANTITIES:
        table.add_column(name, justify="right")
    rows = [("", own.derivatives(at))]
    if other is not None:
        rows.append((" (inviscid)", PanelAircraft(inviscid(panels)).derivatives(at)))
        rows.append((" (AeroSandbox)", other.derivatives(at)))
    for key in rows[0][1]:
        for label, found in rows:
            table.add_row(key + label, *(f"{found[key][name]:.4f}" for name in QUANTITIES))
    console.print(table)


def _write(polars: Polars, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["source", "alpha_deg", *QUANTITIES])
        for source in ("own", "lattice", "points"):
            for alpha_deg, values in getattr(polars, source).items():
                writer.writerow(
                    [source, f"{alpha_deg:g}", *(f"{values[q]:.6g}" if q in values else "" for q in QUANTITIES)]
                )
