"""Sensors that the mock Pixhawk takes, from HIL_SENSOR and HIL_GPS, and its own faults.

It has no range finder and no flow sensor.
"""

from __future__ import annotations

from firmware_bridge.autopilots.intake import Intake, Samples

SENSORS: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps")),
    "magnetometer": Samples(("field_tesla",)),
    "barometer": Samples(("pressure_pa",)),
    "gps": Samples(
        ("altitude_m", "latitude_deg", "longitude_deg", "v_W"), whole=("dropout", "freeze", "jammer", "spoofer")
    ),
    "pitot": Samples(("differential_pressure_pa",), whole=("dropout", "freeze", "blocked")),
}

# Keys of autopilot.faults. A free-running link uses the newest command whatever its time: a wrong one changes nothing.
FAULTS_HITL = ("die_at_s", "stall_at_s", "garbage_at_s", "noise_at_s")
FAULTS = (*FAULTS_HITL, "wrong_time_at_s")
