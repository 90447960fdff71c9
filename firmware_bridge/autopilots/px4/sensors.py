"""Sensors that PX4 takes, from HIL_SENSOR, HIL_GPS, DISTANCE_SENSOR, HIL_OPTICAL_FLOW and ODOMETRY.

The temperature in HIL_SENSOR is the pitot's, if there is one: PX4 takes it for that of the air. Else it is the
barometer's. No message has the angles of vanes.
"""

from __future__ import annotations

from firmware_bridge.autopilots.intake import Intake, Samples

SENSORS: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps")),
    "magnetometer": Samples(("field_tesla",)),
    "barometer": Samples(("pressure_pa", "temperature_degc"), replaced={"temperature_degc": "pitot"}),
    "gps": Samples(
        ("altitude_m", "latitude_deg", "longitude_deg", "v_W"), whole=("dropout", "freeze", "jammer", "spoofer")
    ),
    "range_finder": Samples(("distance_m",)),
    "optical_flow": Samples(("flow_rad", "gyro_rad", "distance_m")),
    "external_vision": Samples(("p_OB", "v_OB_B")),
    "pitot": Samples(("differential_pressure_pa", "temperature_degc"), whole=("dropout", "freeze", "blocked")),
}
