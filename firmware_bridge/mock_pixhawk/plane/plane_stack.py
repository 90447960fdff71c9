"""The parts that fly a plane: air data, land detector, pilot, modes, navigator, failsafes, telemetry."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, ClassVar

from firmware_bridge._native import PARAM_NAMES, STATE_FIELDS, FlightCore
from firmware_bridge.mock_pixhawk.flight.failsafe import Action, Failsafe
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.flight_modes import FlightMode
from firmware_bridge.mock_pixhawk.flight.guidance import ATTITUDE, POSITION
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.flight.stack import Handlers, MissionState, Say
from firmware_bridge.mock_pixhawk.ids import Severity
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.air_data import AirData
from firmware_bridge.mock_pixhawk.plane.engine_watch import EngineWatch
from firmware_bridge.mock_pixhawk.plane.land_detector import PlaneLandDetector
from firmware_bridge.mock_pixhawk.plane.landing import PlaneLanding
from firmware_bridge.mock_pixhawk.plane.manual_modes import PlaneAltitude, PlaneDirect, PlaneStabilized
from firmware_bridge.mock_pixhawk.plane.path import Circle
from firmware_bridge.mock_pixhawk.plane.pilot import PlanePilot
from firmware_bridge.mock_pixhawk.plane.plane_modes import PlaneHold, PlaneLand, PlaneReturn
from firmware_bridge.mock_pixhawk.plane.plane_navigator import PlaneNavigator
from firmware_bridge.mock_pixhawk.plane.takeoff import PlaneTakeoff
from firmware_bridge.mock_pixhawk.services.telemetry import Telemetry
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.units import DEG_PER_RAD

_ACCEL = STATE_FIELDS["a_NF_N"][0]
_ACCEL_NOISE = PARAM_NAMES.index("EKF_ACC_NOISE")
_FLIES = 0.7  # airspeed over the stall below which a plane does not fly
_LANDS = (Mode.MISSION, Mode.RTL, Mode.LAND)
_RUNNING = 0.05  # throttle above which the land detector may see a take-off


class PlaneModes:
    """Table of the flight modes of a plane."""

    def __init__(
        self,
        pilot: PlanePilot,
        navigator: PlaneNavigator,
        offboard: PlaneOffboard,
        takeoff: PlaneTakeoff,
        by_mode: dict[Mode, FlightMode],
    ) -> None:
        self.guidance, self.navigator, self.offboard, self.takeoff = pilot, navigator, offboard, takeoff
        self.by_mode = by_mode
        hold = by_mode[Mode.LOITER]
        assert isinstance(hold, PlaneHold)
        self.hold = hold


class PlaneOffboard(Offboard):
    """OFFBOARD of a plane: a position is circled, an attitude is flown with its thrust. Body rates are not."""

    def __init__(
        self, core: FlightCore, vehicle: Vehicle, project: Callable[[float, float, float], Any], pilot: PlanePilot,
        params: ParamTable,
    ) -> None:  # fmt: skip
        super().__init__(core, vehicle, project)
        self._pilot, self._params = pilot, params

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        if self._setpoint is None:
            return None
        kind, (x, y, z, *_) = self._setpoint
        if kind == ATTITUDE:
            self._pilot.attitude(x, y, z)
        elif kind == POSITION and x == x and y == y:
            radius = self._params["NAV_LOITER_RAD"]
            self._pilot.path = Circle(x, y, abs(radius), radius >= 0.0)
            self._pilot.fly(d_m=z if z == z else self._vehicle.pos_d)
        else:
            self._pilot.fly(d_m=self._vehicle.pos_d)
        return None


class PlaneFailsafe(Failsafe):
    """The failsafes of every vehicle, and an engine that no longer pulls."""

    def __init__(self, stack: PlaneStack, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._stack = stack

    def armed(self, now_us: int) -> None:
        super().armed(now_us)
        self._stack.engine.reset()
        self._stack.landing.flaring = False

    def check(self, now_us: int) -> Action | None:
        if self._edge("blown", self._stack.detector.blown):
            self._say(Severity.WARNING, "Landing not detected: airspeed at rest above LNDFW_AIRSPD_MAX")
        return super().check(now_us) or self._engine(now_us)

    def _position(self, now_us: int) -> Action | None:
        """From the flare on, and once too slow to fly, it lands: a position that is back must not end in a take-off."""
        stack = self._stack
        if self.descending_blind:
            slow = stack.air.airspeed_mps < _FLIES * self._params["FW_AIRSPD_STALL"]
            return None if slow else super()._position(now_us)
        if stack.landing.flaring and self._vehicle.mode in _LANDS:
            return None
        return super()._position(now_us)

    def _engine(self, now_us: int) -> Action | None:
        stack = self._stack
        if stack.rolls:
            if not stack.engine.roll_step(now_us, ground_mps=stack.pilot.ground_speed_mps):
                return None
            self._say(Severity.EMERGENCY, "Failsafe activated: engine failed, takeoff aborted")
            return Action.LAND
        if self._vehicle.landed or stack.landing.flaring or not stack.engine_failed(now_us):
            return None
        self._say(Severity.EMERGENCY, "Failsafe activated: engine failure, gliding")
        stack.landing.engine_lost()
        return Action.LAND


class PlaneTelemetry(Telemetry):
    """Telemetry with airspeed; SERVO_OUTPUT_RAW has surfaces about 1500 us."""

    def __init__(self, air: AirData, rotors: int, *args: Any, **settings: Any) -> None:
        self._air, self._rotors = air, rotors
        super().__init__(*args, **settings)

    def _vfr_hud(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        e = self._estimate
        vn, ve, vd = e.v_NF_N
        heading = round(e.euler[2] * DEG_PER_RAD) % 360
        throttle = round(100.0 * max(self._throttle(), 0.0))
        return cls(self._air.airspeed_mps, sqrt(vn * vn + ve * ve), heading, throttle, self._altitude_amsl(), -vd)

    def _throttle(self) -> float:
        return self.controls[0]

    def _servo_output_raw(self, cls: Any, now_us: int) -> Any:
        pulses = []
        for i, u in enumerate(self.controls[:8]):
            pulse = 1000.0 + 1000.0 * u if i < self._rotors else 1500.0 + 500.0 * u
            pulses.append(round(pulse) if self._v.armed else 900)
        return cls(now_us & 0xFFFFFFFF, 0, *pulses)


class PlaneStack:
    """Parts that fly a plane."""

    commands: ClassVar[Handlers] = {}

    def __init__(self, parts: FirmwareParts) -> None:
        core, vehicle, estimate, sensors, params, callbacks = self._parts = parts
        self._state = core.state
        sensors.doubt_clipped(_ACCEL_NOISE, lambda: params["EKF_ACC_NOISE"])
        air = self.air = AirData(pitot=bool(params["FW_USE_AIRSPD"]) and bool(params["SYS_HAS_NUM_ASPD"]))
        pilot = self.pilot = PlanePilot(core, vehicle, params, air)
        self.engine = EngineWatch(params)
        landing = self.landing = PlaneLanding(pilot, vehicle, params, callbacks.info)
        self._takeoff = PlaneTakeoff(pilot, vehicle, params, callbacks.info)
        self.detector = PlaneLandDetector(params)
        navigator = PlaneNavigator(pilot, parts, self._takeoff, landing)
        offboard = self._offboard = PlaneOffboard(core, vehicle, estimate.ned, pilot, params)
        by_mode: dict[Mode, FlightMode] = {
            Mode.MANUAL: PlaneDirect(pilot, vehicle),
            Mode.STABILIZED: PlaneStabilized(pilot, vehicle, params),
            Mode.ALTCTL: PlaneAltitude(pilot, vehicle, params, holds_course=False),
            Mode.POSCTL: PlaneAltitude(pilot, vehicle, params, holds_course=True),
            Mode.TAKEOFF: self._takeoff,
            Mode.LOITER: PlaneHold(pilot, vehicle, params),
            Mode.MISSION: navigator,
            Mode.RTL: PlaneReturn(pilot, vehicle, params, landing, navigator.go_to_landing),
            Mode.LAND: PlaneLand(pilot, vehicle, params, landing, self.engine),
            Mode.OFFBOARD: offboard,
        }
        self.modes = PlaneModes(pilot, navigator, offboard, self._takeoff, by_mode)

    @property
    def rolls(self) -> bool:
        """True during a take-off roll."""
        vehicle = self._parts.vehicle
        return vehicle.armed and vehicle.mode in (Mode.TAKEOFF, Mode.MISSION) and self._takeoff.rolling

    def engine_failed(self, now_us: int) -> bool:
        """Watch the engine in flight. Return True at the moment in which it is found to have failed."""
        return self.engine.step(
            now_us,
            climb_mps=-self._parts.vehicle.v_d,
            true_airspeed_mps=self.air.true_mps,
            airspeed_rate_mps2=self.air.rate_mps2,
            throttle=self.pilot.throttle,
        )

    def observe(self, now_us: int) -> None:
        """Update air data and land detector from the estimate."""
        _, v, estimate, sensors, _, _ = self._parts
        s = self._state
        self.air.pitot.take(sensors.differential_us, sensors.differential_hpa)
        altitude = estimate.origin_alt_m - v.pos_d if estimate.has_origin else 0.0
        velocity = (v.v_n, v.v_e, v.v_d)
        self.air.step(
            now_us,
            ground_NED_mps=velocity,
            acceleration_NED_mps2=(float(s[_ACCEL]), float(s[_ACCEL + 1]), float(s[_ACCEL + 2])),
            yaw_rad=v.yaw,
            altitude_m=altitude,
            flying=self.flies(),
        )
        if not v.armed:
            self.detector.at_rest(v.pos_d)
            self._takeoff.launched = False
        moves = v.armed and (self.pilot.throttle > _RUNNING or self._takeoff.launched)
        self._parts.core.set_landed(self.detector.step(now_us, velocity, v.pos_d, self.air.airspeed_mps, moves=moves))

    def flies(self) -> bool:
        """Return True while the nose tells where the air comes from."""
        return not self._parts.vehicle.landed

    def outputs(self, now_us: int) -> list[float]:
        """Run the inner loops."""
        return self.pilot.commands(now_us)

    def failsafe(self, say: Say, *, hitl: bool) -> Failsafe:
        """Make the failsafes."""
        return PlaneFailsafe(self, self._parts, self._offboard, say, hitl=hitl)

    def telemetry(self, mission: MissionState, *, system_type: int, hil: bool) -> Telemetry:
        """Make the telemetry."""
        return PlaneTelemetry(self.air, self.pilot.rotors, self._parts, mission, system_type=system_type, hil=hil)
