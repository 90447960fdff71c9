"""The flight modes of one vehicle, by PX4's mode."""

from __future__ import annotations

from firmware_bridge.mock_pixhawk.flight.flight_modes import FlightMode, Hold, Land, Return, Takeoff
from firmware_bridge.mock_pixhawk.flight.guidance import Guidance
from firmware_bridge.mock_pixhawk.flight.manual_modes import ManualAttitude, ManualPosition
from firmware_bridge.mock_pixhawk.flight.navigator import Navigator
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle


class FlightModes:
    """Table of the flight modes. `navigator` flies missions, `offboard` streamed set-points."""

    def __init__(
        self, vehicle: Vehicle, params: ParamTable, guidance: Guidance, navigator: Navigator, offboard: Offboard
    ) -> None:
        self.guidance, self.navigator, self.offboard = guidance, navigator, offboard
        self.hold = Hold(guidance, vehicle)
        self.takeoff = Takeoff(guidance, vehicle, params)
        manual_attitude = ManualAttitude(guidance, vehicle, params, holds_altitude=False)
        self.by_mode: dict[Mode, FlightMode] = {
            Mode.MANUAL: manual_attitude,
            Mode.STABILIZED: manual_attitude,
            Mode.ALTCTL: ManualAttitude(guidance, vehicle, params, holds_altitude=True),
            Mode.POSCTL: ManualPosition(guidance, vehicle, params),
            Mode.TAKEOFF: self.takeoff,
            Mode.LOITER: self.hold,
            Mode.MISSION: navigator,
            Mode.RTL: Return(guidance, vehicle, params),
            Mode.LAND: Land(guidance, vehicle, params),
            Mode.OFFBOARD: offboard,
        }
