"""`hil vehicle aero`: signs, files, source points, and AeroSandbox's lattice where it is installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from rich.console import Console

from hil.apps.vehicle.coefficients import FlightPoint, PanelAircraft
from hil.apps.vehicle.command import read_points, vehicle_aero
from hil.apps.vehicle.lattice import LatticeAircraft, inviscid
from signals.errors import ConfigError, HilError
from sim.physics.vehicle import VEHICLE_DIR
from tests.reference.test_panels_reference import trainer_panels

_AT = FlightPoint(17.0)
_HAS_LATTICE = importlib.util.find_spec("aerosandbox") is not None


def test_signs_of_a_stable_aircraft() -> None:
    found = PanelAircraft(trainer_panels()).derivatives(_AT)
    assert found["alpha"]["CL"] > 0.0 > found["alpha"]["Cm"]
    assert found["beta"]["Cn"] > 0.0 > found["beta"]["CY"]
    assert max(found["p"]["Cl"], found["q"]["Cm"], found["r"]["Cn"]) < 0.0
    assert found["aileron"]["Cl"] > 0.0 > found["elevator"]["Cm"]


def test_lift_of_the_trainer_is_that_of_its_source() -> None:
    aircraft = PanelAircraft(trainer_panels())
    for alpha_deg, point in read_points(VEHICLE_DIR / "polars" / "trainer.csv").items():
        own = aircraft.coefficients(FlightPoint(17.2, alpha_rad=alpha_deg * 3.141592653589793 / 180.0))
        assert own["CL"] == pytest.approx(point["CL"], abs=0.05)


def test_roll_damping_of_the_trainer_is_that_of_its_source() -> None:
    """dCMl__dpHat_rps -0.394 at 2 degrees."""
    assert PanelAircraft(trainer_panels()).derivatives(_AT)["p"]["Cl"] == pytest.approx(-0.394, rel=0.05)


def test_files(tmp_path: Path) -> None:
    files = vehicle_aero("trainer", Console(quiet=True), airspeed_mps=15.0, out=tmp_path, lattice=False, points=None)
    assert files.picture.read_bytes().startswith(b"\x89PNG")
    assert files.table.read_text().count("\nown,") == 91
    assert files.table.read_text().count("\npoints,") == 6


def test_a_vehicle_without_panels(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="x500: has no entry of `kind: panels`"):
        vehicle_aero("x500", Console(quiet=True), airspeed_mps=15.0, out=tmp_path, lattice=False, points=None)


def test_points_that_are_no_numbers(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("alpha_deg,CL\nfive,0.3\n")
    with pytest.raises(ConfigError, match="needs a number"):
        read_points(tmp_path / "p.csv")


@pytest.mark.skipif(_HAS_LATTICE, reason="aerosandbox is installed")
def test_without_aerosandbox(tmp_path: Path) -> None:
    with pytest.raises(HilError, match=r"pip install 'hil-bench\[aero\]'"):
        vehicle_aero("trainer", Console(quiet=True), airspeed_mps=15.0, out=tmp_path, lattice=True, points=None)


@pytest.mark.skipif(not _HAS_LATTICE, reason="needs aerosandbox")
def test_derivatives_are_those_of_aerosandbox() -> None:
    """Within 10 %, also those of the fin on its tailplane, whose panels are closer where they meet."""
    panels = inviscid(trainer_panels())
    own, other = PanelAircraft(panels).derivatives(_AT), LatticeAircraft(panels).derivatives(_AT)
    for by, name in (
        ("alpha", "CL"), ("alpha", "Cm"), ("q", "CL"), ("q", "Cm"), ("p", "Cl"), ("aileron", "Cl"), ("elevator", "Cm"),
        ("beta", "Cn"), ("r", "Cn"),
    ):  # fmt: skip
        assert own[by][name] == pytest.approx(other[by][name], rel=0.1), (by, name)
    assert own["beta"]["CY"] == pytest.approx(other["beta"]["CY"], rel=0.2)


def test_few_panels_carry_over_from_the_fin_to_the_tailplane() -> None:
    """With two panels each, the fin on its tailplane has the derivatives of the same with ten."""
    panels = inviscid(trainer_panels())
    wings = tuple(
        w if w.name == "wing" else w.model_copy(update={"panels": 10 if w.symmetric else 9}) for w in panels.wings
    )
    few, many = (PanelAircraft(p).derivatives(_AT) for p in (panels, panels.model_copy(update={"wings": wings})))
    for by, name in (("beta", "CY"), ("beta", "Cn"), ("r", "Cn"), ("elevator", "Cm")):
        assert few[by][name] == pytest.approx(many[by][name], rel=0.06), (by, name)
