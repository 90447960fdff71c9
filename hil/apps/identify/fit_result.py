"""The estimator's result: fitted parameters with their deviations, and predictions of flights that it did not see.

The command calls the estimator as

    hil.apps.identify.fit.estimate(flights: Sequence[FlightLog], vehicle: Vehicle, *,
                                   fixed: Mapping[str, float], progress: Callable[[float, str], None]) -> Fit

`fixed` holds keys as in `Estimated.key`, `progress` takes the share done, 0 to 1, and a word on what is being done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sim.physics.vehicle import Vehicle


@dataclass(frozen=True)
class Estimated:
    """One fitted number with its standard deviation.

    `key` is its path in the vehicle file, as `--fix` takes it: `mass_kg`, `inertia_kgm2.0`,
    `rotor_constants.time_constant_up_s`. A number that belongs to the logs and not to the vehicle begins with `log.`:
    `log.motor_delay_s`, `log.NAME.wind_x_mps`, `log.NAME.gyro_bias_x_radps`.
    `identified` is False where the flights do not determine the number; then `value` is the one that the estimator
    kept, and `why` says what was missing. `sigma` is infinite or larger than the value there. `why` may be empty else.
    """

    key: str
    value: float
    sigma: float
    unit: str
    identified: bool
    why: str = ""

    @property
    def of_vehicle(self) -> bool:
        return not self.key.startswith("log.")


@dataclass(frozen=True)
class Prediction:
    """Mean norms of the errors of open-loop predictions over `horizon_s`, begun all along the held-out part of a log.

    A quantity that the log does not contain is NaN.
    """

    log: str
    horizon_s: float
    position_m: float
    velocity_mps: float
    rotation_rad: float
    rate_radps: float


@dataclass(frozen=True)
class Residual:
    """Deviation of measured from modelled specific force or angular acceleration along one axis of B.

    `speed_mps` is the middle of a bin of air speed, or None for all of them together; `samples` counts what lies in it.
    """

    quantity: str  # "force" in m/s2, or "turn" in rad/s2
    axis: str  # "x", "y" or "z" of B
    speed_mps: float | None
    mean: float
    rms: float
    samples: int


@dataclass(frozen=True)
class Fit:
    """Result of `estimate`. `vehicle` is the given one with the fitted numbers in place.

    `before` and `after` are the predictions of the same held-out parts with the vehicle it began with and with the
    fitted one, in the same order.
    """

    parameters: Sequence[Estimated]
    vehicle: Vehicle
    before: Sequence[Prediction]
    after: Sequence[Prediction]
    residuals: Sequence[Residual]
