"""An estimator for tests of what surrounds the real one: it scales the thrust and says what it is told to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from hil.apps.identify.fit_result import Estimated, Fit, Prediction, Residual
from hil.run.flight_logs.flight_log import FlightLog
from sim.physics.vehicle import Vehicle

THRUST = "rotor_constants.thrust_coefficient_n_per_radps2"


class StandIn:
    """Call it as the estimator; `flights` and `fixed` are what it was given."""

    def __init__(self, *, error_factor: float = 0.5) -> None:
        self.error_factor = error_factor
        self.flights: Sequence[FlightLog] = ()
        self.fixed: Mapping[str, float] = {}

    def __call__(
        self,
        flights: Sequence[FlightLog],
        vehicle: Vehicle,
        *,
        fixed: Mapping[str, float],
        progress: Callable[[float, str], None],
    ) -> Fit:
        self.flights, self.fixed = flights, fixed
        progress(0.5, "fitting")
        c = vehicle.rotor_constants
        thrust = 1.1 * c.thrust_coefficient_n_per_radps2
        inertia = (1.05 * vehicle.inertia_kgm2[0], *vehicle.inertia_kgm2[1:])
        constants = c.model_copy(update={"thrust_coefficient_n_per_radps2": thrust})
        fitted = vehicle.model_copy(update={"rotor_constants": constants, "inertia_kgm2": inertia})
        parameters = [
            Estimated(THRUST, thrust, 0.01 * thrust, "N/(rad/s)2", identified=True),
            Estimated("inertia_kgm2.0", inertia[0], 3e-4, "kg m2", identified=True),
            Estimated("inertia_kgm2.2", inertia[2], math.inf, "kg m2", identified=False, why="no turns about z"),
            Estimated("log.motor_delay_s", 0.012, 0.001, "s", identified=True),
        ]
        before = [
            Prediction(flight.name, h, 0.1 * h, 0.5 * h, math.nan, 0.3 * h) for flight in flights for h in (0.1, 0.5)
        ]
        k = self.error_factor
        after = [
            Prediction(p.log, p.horizon_s, k * p.position_m, k * p.velocity_mps, math.nan, p.rate_radps) for p in before
        ]
        residuals = [
            Residual(quantity, axis, speed, 0.01, 0.2, 100)
            for quantity in ("force", "turn")
            for axis in "xyz"
            for speed in (None, 1.0, 3.0)
        ]
        return Fit(parameters, fitted, before, after, residuals)
