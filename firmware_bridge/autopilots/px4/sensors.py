"""Sensors that PX4 takes, from HIL_SENSOR, HIL_GPS, DISTANCE_SENSOR, HIL_OPTICAL_FLOW and ODOMETRY.

The temperature in HIL_SENSOR is the pitot's, if there is one: PX4 takes it for that of the air. Else it is the
barometer's. No message has the angles of vanes.

PX4 stamps a sample when it arrives, and its estimator takes it as `EKF2_*_DELAY` old. Its start script for simulators
that send MAVLink has 10 ms for the GPS (px4-rc.mavlinksim): with a receiver of 100 ms the estimate lags behind the
vehicle by 90 ms. In 2026 EKF2_GPS_DELAY became SENS_GPS0_DELAY and SENS_GPS1_DELAY, and those SENS_GNSS0_DELAY and
SENS_GNSS1_DELAY; of a parameter that a build does not have, its start script says so in the log, and goes on.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_bridge.autopilots.intake import Delay, Intake, Samples

_DEFAULT_DELAY_MAX_MS = 200.0
_OF_GPS = ("EKF2_GPS_DELAY", *(f"SENS_{kind}{number}_DELAY" for kind in ("GPS", "GNSS") for number in (0, 1)))


def _delay(*names: str) -> Delay:
    return Delay(names, 300.0)  # the maximum in PX4's documentation, of each of them


SENSORS: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps")),
    "magnetometer": Samples(("field_tesla",), delay=_delay("EKF2_MAG_DELAY")),
    "barometer": Samples(
        ("pressure_pa", "temperature_degc"), delay=_delay("EKF2_BARO_DELAY"), replaced={"temperature_degc": "pitot"}
    ),
    "gps": Samples(
        ("altitude_m", "latitude_deg", "longitude_deg", "v_W"),
        whole=("dropout", "freeze", "jammer", "spoofer"),
        delay=_delay(*_OF_GPS),
    ),
    "range_finder": Samples(("distance_m",), delay=_delay("EKF2_RNG_DELAY")),
    "optical_flow": Samples(("flow_rad", "gyro_rad", "distance_m"), delay=_delay("EKF2_OF_DELAY")),
    "external_vision": Samples(("p_OB", "v_OB_B"), delay=_delay("EKF2_EV_DELAY")),
    "pitot": Samples(
        ("differential_pressure_pa", "temperature_degc"),
        whole=("dropout", "freeze", "blocked"),
        delay=_delay("EKF2_ASP_DELAY"),
    ),
}


def with_horizon(told: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of sensors with the EKF2_DELAY_MAX [ms] that the longest of their delays needs.

    The estimator works on the oldest of its steps, of which it keeps one for every 10 ms of EKF2_DELAY_MAX, the newest
    being now. With an IMU of 250 Hz a step is of 8 ms: at the default of 200 ms it is 152 ms behind. A sample from
    before the oldest step is taken for as old as that, or left out.
    """
    longest_ms = max((value for name, value in told.items() if name.endswith("_DELAY")), default=0.0)
    needed_ms = 1.25 * longest_ms + 20.0
    return dict(told) | ({"EKF2_DELAY_MAX": needed_ms} if needed_ms > _DEFAULT_DELAY_MAX_MS else {})
