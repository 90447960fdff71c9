"""Predictions of real flights by the fitted vehicle that comes with the bench. Skips without the flights or pyarrow."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from hil.apps.identify.fit.prediction import Predictor, predictions
from hil.run.flight_logs.airborne import find_flights, motors_up
from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile, read_log
from sim.physics.vehicle import load_vehicle

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = Path(os.environ.get("HIL_FLIGHTS", ROOT.parent / "shared" / "flights"))
EXAMPLES = ROOT / "docs" / "examples" / "identify"
LIMITS = (0.104, 0.456, 0.2268, 0.598)  # m, m/s, rad, rad/s at 0.5 s: lab/flights.py


def flights(folder: str, name: str, vehicle: str) -> list[FlightLog]:
    pytest.importorskip("pyarrow")
    path = FLIGHTS / folder / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    file = LogFile(path, load_vehicle(EXAMPLES / vehicle), EXAMPLES / f"{folder}.columns.yaml")
    log = read_log(file)
    return find_flights(log, file, motors_up(log, file))


@pytest.mark.parametrize("kind", ["multisine", "random1", "random2"])
def test_flights_that_were_not_fitted_are_predicted_within_published_errors(kind: str) -> None:
    run = {"multisine": 2, "random1": 2, "random2": 3}[kind]
    vehicle = "crazyflie_brushless_fitted.yaml"
    logs = flights("idsia", f"{kind}_20251017_run{run}.parquet", vehicle)
    predictor = Predictor(load_vehicle(EXAMPLES / vehicle), "speed_radps")
    found = [p for p in predictions(predictor, logs, every=10) if p.horizon_s == 0.5]
    means = np.mean([(p.position_m, p.velocity_mps, p.rotation_rad, p.rate_radps) for p in found], axis=0)
    assert (means <= LIMITS).all(), means
