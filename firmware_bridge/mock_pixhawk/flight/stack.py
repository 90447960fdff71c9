"""Parts that fly the vehicle: everything of the firmware that depends on its kind: multirotor, plane or VTOL.

`MultirotorStack` is here, the others in `plane/plane_stack.py` and `vtol/vtol_stack.py`; the firmware takes one of them
by CA_AIRFRAME and never asks which.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from firmware_bridge.mock_pixhawk.flight.failsafe import Failsafe
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.flight_modes import FlightMode
from firmware_bridge.mock_pixhawk.flight.guidance import Guidance
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.flight.mode_table import FlightModes
from firmware_bridge.mock_pixhawk.flight.navigator import Navigator
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.services.telemetry import Telemetry

Handlers = Mapping[int, Callable[[Any, int], int]]  # (command, now_us) to the result, by MAV_CMD
MissionState = Callable[[], tuple[int, int, int]]
Say = Callable[[int, str], None]


class SetPoint(Protocol):
    """The moving set-point, as the commander uses it."""

    def take_over(self) -> None: ...

    def idle(self) -> None: ...

    def off(self) -> None: ...

    def descend_blind(self) -> None: ...

    def refresh_params(self) -> None: ...


class HoldMode(FlightMode, Protocol):
    """Mode that can be sent to a place."""

    def go_to(self, point: Point, speed_mps: float | None, yaw: float | None) -> None: ...


class TakeoffMode(FlightMode, Protocol):
    """Mode with a commanded altitude."""

    altitude_d_m: float | None


class Modes(Protocol):
    """Table of the flight modes."""

    @property
    def guidance(self) -> SetPoint: ...

    @property
    def navigator(self) -> MissionRunner: ...

    @property
    def offboard(self) -> Offboard: ...

    @property
    def hold(self) -> HoldMode: ...

    @property
    def takeoff(self) -> TakeoffMode: ...

    @property
    def by_mode(self) -> dict[Mode, FlightMode]: ...


class FlightStack(Protocol):
    """The parts that fly one vehicle."""

    @property
    def commands(self) -> Handlers:
        """Commands beside those of every vehicle."""

    @property
    def modes(self) -> Modes: ...

    def observe(self, now_us: int) -> None:
        """Look at the estimate of this guidance step, before failsafes and modes."""

    def outputs(self, now_us: int) -> list[float]:
        """Return the 16 commands of this instant."""

    def failsafe(self, say: Say, *, hitl: bool) -> Failsafe:
        """Make the failsafes."""

    def telemetry(self, mission: MissionState, *, system_type: int, hil: bool) -> Telemetry:
        """Make the telemetry."""


class MultirotorStack:
    """Parts that fly a multirotor: its inner loops and mixer are those of the flight core."""

    commands: ClassVar[Handlers] = {}

    def __init__(self, parts: FirmwareParts) -> None:
        core, vehicle, estimate, _, params, _ = self._parts = parts
        self._rotors = int(params["CA_ROTOR_COUNT"])
        guidance = Guidance(core, vehicle, params)
        self._offboard = Offboard(core, vehicle, estimate.ned)
        navigator = Navigator(guidance, parts)
        self.modes = FlightModes(vehicle, params, guidance, navigator, self._offboard)

    def observe(self, now_us: int) -> None: ...

    def outputs(self, now_us: int) -> list[float]:  # noqa: ARG002
        return self._parts.core.motor_commands(self._rotors)

    def failsafe(self, say: Say, *, hitl: bool) -> Failsafe:
        return Failsafe(self._parts, self._offboard, say, hitl=hitl)

    def telemetry(self, mission: MissionState, *, system_type: int, hil: bool) -> Telemetry:
        return Telemetry(self._parts, mission, system_type=system_type, hil=hil)
