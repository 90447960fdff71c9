"""Real flights of two Crazyflies are read by the book's maps. Skipped without the folder `HIL_FLIGHTS`."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from hil.apps.identify.plausibility import gain_of
from hil.apps.identify.preparation import flights_of
from hil.run.flight_logs.log_format import LogFile
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.docs_blocks import ROOT

FLIGHTS = Path(os.environ.get("HIL_FLIGHTS", ROOT.parent / "shared" / "flights"))
EXAMPLES = ROOT / "docs/examples/identify"

pytest.importorskip("pyarrow")
pytestmark = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="no real flights: HIL_FLIGHTS")


def log_file(folder: str, name: str, vehicle: str) -> LogFile:
    columns = EXAMPLES / f"{folder}.columns.yaml"
    return LogFile(FLIGHTS / folder / f"{name}.parquet", load_vehicle(EXAMPLES / f"{vehicle}.yaml"), columns)


@pytest.mark.parametrize(
    ("folder", "name", "vehicle", "kind"),
    [
        ("idsia", "random1_20251017_run1", "crazyflie_brushless", "speed_radps"),
        ("idsia", "square_20251017_run2", "crazyflie_brushless", "speed_radps"),
        ("nanobench", "B3_figure8_medium_rep1", "crazyflie", "command"),
    ],
)
def test_flight_is_found_and_plausible(folder: str, name: str, vehicle: str, kind: str) -> None:
    file = log_file(folder, name, vehicle)
    log, (flight,) = flights_of(file)
    assert log.motors_kind == kind
    assert flight.duration_s > 15.0
    assert gain_of(flight, file.vehicle) == pytest.approx(1.0, abs=0.1)
    assert flight.voltage is not None
    assert np.median(flight.voltage.values) == pytest.approx(3.7, abs=0.6)


def test_flight_on_an_empty_battery_is_refused() -> None:
    with pytest.raises(ConfigError, match="is at full command in 100% of the flight, first at"):
        flights_of(log_file("nanobench", "B6_linear_ramp_rep1", "crazyflie"))
