"""From the mixer's motor commands to the 16 control slots of HIL_ACTUATOR_CONTROLS."""

from __future__ import annotations

from typing import Any

from firmware_bridge.mock_pixhawk.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle

CHANNELS = 16
_FIRST_MOTOR = 101  # HIL_ACT_FUNCn: 101 is motor 1
_CONSTANT_MAX = 2


class HitlOutputs:
    """HIL_ACT_FUNC1..16: which function each slot carries. As in PX4 a change takes effect while disarmed."""

    def __init__(self, params: ParamTable, vehicle: Vehicle, core: Any, rotors: int) -> None:
        self._params, self._vehicle = params, vehicle
        self._core, self._rotors = core, rotors
        self._functions = [0] * CHANNELS

    def controls(self) -> list[float]:
        """The 16 values of this instant, 0..1. Disarmed and terminated: all zero."""
        vehicle = self._vehicle
        if not vehicle.armed:
            self._functions = [int(self._params[f"HIL_ACT_FUNC{slot}"]) for slot in range(1, CHANNELS + 1)]
            return [0.0] * CHANNELS
        if vehicle.terminated:
            return [0.0] * CHANNELS
        motors = self._core.motor_commands(self._rotors)
        return [self._value(function, motors) for function in self._functions]

    def _value(self, function: int, motors: list[float]) -> float:
        motor = function - _FIRST_MOTOR
        if 0 <= motor < self._rotors:
            return motors[motor]
        return 1.0 if function == _CONSTANT_MAX else 0.0
