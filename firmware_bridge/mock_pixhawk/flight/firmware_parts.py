"""The parts of the firmware that every stack and navigator uses, whatever flies."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from firmware_bridge._native import FlightCore
from firmware_bridge.mock_pixhawk.estimate.sensors import SensorIntake
from firmware_bridge.mock_pixhawk.estimate.state import Estimate
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle


class MissionCallbacks(Protocol):
    """Reports of a mission to the firmware."""

    def on_reached(self, seq: int) -> None: ...

    def info(self, text: str) -> None: ...

    def set_mission_home(self, position: Point | None) -> None: ...


class FirmwareParts(NamedTuple):
    """Parts of one autopilot."""

    core: FlightCore
    vehicle: Vehicle
    estimate: Estimate
    sensors: SensorIntake
    params: ParamTable
    callbacks: MissionCallbacks
