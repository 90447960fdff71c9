"""Sensors that ArduPilot takes, over the JSON link of its SITL and as External AHRS.

JSON carries the IMU, range finders, airspeed and the direction of a wind vane, MAVLink external vision. GPS, barometer
and compass are SITL's own, made from the vehicle's true pose; its parameters SIM_* have the meaning of some faults
(libraries/SITL/SITL.cpp, SITL_Baro.cpp, SIM_GPS.cpp):

    SIM_GPS1_ENABLE 0      the receiver sends messages without a fix. Before 4.7: SIM_GPS_DISABLE 1
    SIM_GPS1_GLTCH_X, ...  added to latitude [deg], longitude [deg] and altitude [m]. Before 4.7: SIM_GPS_GLITCH_X, ...
    SIM_BARO_DISABLE 1     no measurement and not healthy
    SIM_BARO_FREEZE 1      the altitude stays
    SIM_BARO_GLITCH        added to the altitude [m] of which it makes the pressure
    SIM_MAG1_FAIL 1        no measurement
    SIM_MAG1_OFS_X, ...    subtracted from the measurement [mG, FRD]

SITL has two barometers (SIM_BARO_COUNT) and three compasses, and changes to another one where one fails. The bench's
sensor is all of them.

Not used, because they mean something else than the bench's fault: SIM_BARO_DRIFT (what it has added stays when it is 0
again), and SIM_MAG1_FAIL 2 ("frozen": in 4.7-dev each sample corrects the last one again, and the field runs away).

In both links a missing sample leaves the last one standing where no message is left out with it: such a dropout would
be a freeze. A VectorNav's IMU packet carries compass and barometer, the JSON state IMU, range and airspeed. A VectorNav
has no airspeed and no vane: on a board ArduPilot reads those from drivers of their own.

SITL makes the pressure of its airspeed sensor from the true airspeed in the JSON state (sitl_airspeed.cpp); the
vane is the wind vane of boats, read with WNDVN_TYPE 11, which a plane does not have.
"""

from __future__ import annotations

from firmware_bridge.autopilots.intake import Added, Change, Held, Intake, Samples, Simulated

_MILLIGAUSS_PER_TESLA = 1e7
_FRD_FROM_FLU = (1.0, -1.0, -1.0)
_BAROMETERS = ("SIM_BARO", "SIM_BAR2", "SIM_BAR3")
_COMPASSES = ("SIM_MAG1", "SIM_MAG2", "SIM_MAG3")

# International Standard Atmosphere below 11 km (ISO 2533).
_SEA_LEVEL_PA, _SEA_LEVEL_K, _LAPSE_KPM = 101_325.0, 288.15, 0.0065
_EXPONENT = 9.80665 / (287.05287 * _LAPSE_KPM)


def _unchanged(offset: float, altitude_m: float) -> float:  # noqa: ARG001 (one signature for all)
    return offset


def altitude_offset_m(offset_pa: float, altitude_m: float) -> float:
    """Return the change of the pressure altitude [m] that a change of the pressure at an altitude is."""
    pressure_pa = _SEA_LEVEL_PA * (1.0 - _LAPSE_KPM * altitude_m / _SEA_LEVEL_K) ** _EXPONENT
    changed = max(pressure_pa + offset_pa, 1.0) / _SEA_LEVEL_PA
    return _SEA_LEVEL_K / _LAPSE_KPM * (1.0 - changed ** (1.0 / _EXPONENT)) - altitude_m


def _glitch(axis: str) -> tuple[Change, ...]:
    return ((Added(f"SIM_GPS1_GLTCH_{axis}", _unchanged), Added(f"SIM_GPS_GLITCH_{axis}", _unchanged)),)


def _compass_offset(compass: str, axis: int) -> Change:
    sign = _FRD_FROM_FLU[axis]
    # SITL subtracts its offset from the field.
    return (Added(f"{compass}_OFS_{'XYZ'[axis]}", lambda t, _: -sign * _MILLIGAUSS_PER_TESLA * t, axis),)


SITL: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps"), whole=("freeze",)),
    "range_finder": Samples(
        ("distance_m",),
        whole=("freeze",),
        parameters={"RNGFND1_TYPE": 100.0},
        direction="RNGFND1_ORIENT",
        limits=("RNGFND1_MIN", "RNGFND1_MAX"),  # before 4.7: RNGFND1_MIN_CM, _MAX_CM
    ),
    "external_vision": Samples(("p_OB", "v_OB_B"), parameters={"VISO_TYPE": 1.0}),
    "pitot": Samples(("differential_pressure_pa",), whole=("freeze", "blocked"), parameters={"ARSPD_TYPE": 100.0}),
    "vane": Samples(("sideslip_rad",), whole=("freeze",)),
    "gps": Simulated(
        dropout=((Held("SIM_GPS1_ENABLE", 0.0), Held("SIM_GPS_DISABLE", 1.0)),),
        offset={"latitude_deg": _glitch("X"), "longitude_deg": _glitch("Y"), "altitude_m": _glitch("Z")},
    ),
    "barometer": Simulated(
        dropout=tuple((Held(f"{name}_DISABLE", 1.0),) for name in _BAROMETERS),
        freeze=tuple((Held(f"{name}_FREEZE", 1.0),) for name in _BAROMETERS),
        offset={"pressure_pa": tuple((Added(f"{name}_GLITCH", altitude_offset_m),) for name in _BAROMETERS)},
    ),
    "magnetometer": Simulated(
        dropout=tuple((Held(f"{name}_FAIL", 1.0),) for name in _COMPASSES),
        offset={"field_tesla": tuple(_compass_offset(name, axis) for name in _COMPASSES for axis in range(3))},
    ),
}

EXTERNAL_AHRS: dict[str, Intake] = {
    "imu": Samples(("accel_mps2", "gyro_radps", "temperature_degc")),
    "magnetometer": Samples(("field_tesla",), whole=("freeze",)),
    "barometer": Samples(("pressure_pa",), whole=("freeze",)),
    "gps": Samples(
        ("altitude_m", "latitude_deg", "longitude_deg", "v_W"), whole=("dropout", "freeze", "jammer", "spoofer")
    ),
}
