"""Sensors that PX4 takes, from HIL_SENSOR, HIL_GPS, DISTANCE_SENSOR, HIL_OPTICAL_FLOW and ODOMETRY.

The temperature in HIL_SENSOR is the pitot's, if there is one: PX4 takes it for that of the air. Else it is the
barometer's. No message has the angles of vanes.

PX4 stamps a sample when it arrives, and its estimator takes it as `EKF2_*_DELAY` old. Its start script for simulators
that send MAVLink has 10 ms for the GPS (px4-rc.mavlinksim): with a receiver of 100 ms the estimate lags behind the
vehicle by 90 ms.
"""

from __future__ import annotations

from firmware_bridge.autopilots.intake import Intake, Samples

SENSORS: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps")),
    "magnetometer": Samples(("field_tesla",), delay="EKF2_MAG_DELAY"),
    "barometer": Samples(
        ("pressure_pa", "temperature_degc"), delay="EKF2_BARO_DELAY", replaced={"temperature_degc": "pitot"}
    ),
    "gps": Samples(
        ("altitude_m", "latitude_deg", "longitude_deg", "v_W"),
        whole=("dropout", "freeze", "jammer", "spoofer"),
        delay="EKF2_GPS_DELAY",
    ),
    "range_finder": Samples(("distance_m",), delay="EKF2_RNG_DELAY"),
    "optical_flow": Samples(("flow_rad", "gyro_rad", "distance_m"), delay="EKF2_OF_DELAY"),
    "external_vision": Samples(("p_OB", "v_OB_B"), delay="EKF2_EV_DELAY"),
    "pitot": Samples(
        ("differential_pressure_pa", "temperature_degc"), whole=("dropout", "freeze", "blocked"), delay="EKF2_ASP_DELAY"
    ),
}
