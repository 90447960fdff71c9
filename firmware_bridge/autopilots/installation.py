"""Facts about a bench and a run from which the profile of an autopilot makes its link: plain values, no bench file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.links.autopilot_link import LinkTimeouts
from firmware_bridge.links.child_process import FirmwareBuild
from firmware_bridge.transports.transport import Transport
from signals.samples import Vec3

LOG_NAME = "autopilot.log"
WORK_FOLDER = "autopilot"  # working folder of firmware that the bench starts: parameters, missions, its logs
Home = tuple[float, float, float, float]  # latitude, longitude [deg], altitude [m MSL], heading [deg from north]


@dataclass(frozen=True)
class Rotor:
    """One rotor, in B."""

    position_m: Vec3
    axis: Vec3  # unit vector of its thrust
    spin: float  # +1 counter-clockwise seen from above
    thrust_share: float  # of the thrust that it would have alone; below 1 in a coaxial pair
    moment_ratio_m: float  # its torque over its thrust


@dataclass(frozen=True)
class Multirotor:
    """Facts about a vehicle that a multirotor's controller is tuned to."""

    name: str
    mass_kg: float
    inertia_kgm2: Vec3
    rotors: Sequence[Rotor]
    moment_ratio_m: float  # torque over thrust of the first rotors that lift; sets differ: that of each is in `rotors`
    time_constant_s: float  # of the rotors' speed, up or down, the longer one
    thrust_model_factor: float
    hover_control: float  # command of each rotor, 0..1
    full_effect: NDArray[np.float64]  # roll, pitch, yaw [N m] and thrust [N] of each rotor at full speed: (4, rotors)


@dataclass(frozen=True)
class Surface:
    """One control surface of a plane."""

    name: str
    torque_nm: Vec3  # about the axes of B (FLU), per unit command at the cruise airspeed
    trim: float  # command of steady cruise


@dataclass(frozen=True)
class FixedWing:
    """Facts about a vehicle that a plane's controller is tuned to. Airspeeds are true, at the site."""

    name: str
    mass_kg: float
    inertia_kgm2: Vec3
    rotors: Sequence[Rotor]  # its engines
    surfaces: Sequence[Surface]
    stall_mps: float  # airspeed of straight flight at the greatest lift
    cruise_mps: float
    fastest_mps: float  # of level flight
    glide_mps: float  # airspeed of the best glide
    idle_sink_mps: float  # sink rate at the cruise airspeed, engines at 0
    climb_mps: float  # at full throttle and cruise airspeed
    pitch_rad: float  # of steady cruise
    throttle: float  # of steady cruise
    damping_nms: Vec3  # torque per rate about each axis of B, below 0
    pull_up: float  # share of a full pitch demand per rate of pitch [s/rad] in a steady turn
    wheels: bool  # it can roll on a runway
    ground_pitch_rad: float = 0.0  # of the vehicle that stands on its wheels, nose up above 0
    steering: int | None = None  # index of the command that steers its wheels, -1..1, to the left at +1
    brake: int | None = None  # index of the command that brakes them, 0..1
    density_kgpm3: float = 1.225  # of the air at the site

    @property
    def least_mps(self) -> float:
        """Slowest airspeed that a controller should fly: 1.2 times the stall."""
        return 1.2 * self.stall_mps


@dataclass(frozen=True)
class Tilt:
    """One servo that turns rotors. Its command is -1..1, linear from `min_rad` to `max_rad`; 0 rad is hover."""

    name: str
    rotors: Sequence[int]  # of the vehicle, those that it turns
    axis: Vec3  # of the hinge in B (FLU): a positive angle is a right-handed turn
    min_rad: float  # at command -1
    max_rad: float  # at command +1
    hover_command: float  # of the angle 0
    ahead_command: float  # at which its rotors point most ahead
    ahead_rad: float


@dataclass(frozen=True)
class Vtol:
    """Facts about a vehicle that hovers on its lifters as a multirotor and flies on its wings as a plane.

    Its commands are those of all rotors in the order of its file, then those of `tilts`, then those of `wing.surfaces`.
    """

    hover: Multirotor  # its rotors are the lifters
    wing: FixedWing  # its rotors are those that pull ahead in flight, at their places there
    lifters: Sequence[int]  # which of the vehicle's rotors they are, in the order of `hover.rotors`
    pushers: Sequence[int]  # rotors that pull ahead and do not lift: without tilts the rotors of `wing`
    engines: Sequence[int] = ()  # which of the vehicle's rotors those of `wing` are
    tilts: Sequence[Tilt] = ()
    # Body pitch in hover over that in level flight: 0, or of a tailsitter pi / 2. `hover` is then in a frame of its
    # own, level in hover and with the heading of the flight ahead: z along the nose, x out of the belly, y to the left.
    hover_pitch_rad: float = 0.0

    @property
    def kind(self) -> str:
        """Kind of its change between hover and flight: "standard" (pushers), "tiltrotor" or "tailsitter"."""
        if self.hover_pitch_rad > 0.0:
            return "tailsitter"
        return "tiltrotor" if self.tilts else "standard"

    @property
    def name(self) -> str:
        """Name of the vehicle."""
        return self.hover.name


Aircraft: TypeAlias = Multirotor | FixedWing | Vtol


@dataclass(frozen=True)
class Installation:
    """An autopilot in the vehicle of a bench."""

    settings: AutopilotSettings
    vehicle: Aircraft
    tick_hz: int
    home: Home  # start of the vehicle
    geodetic: Callable[[Vec3], tuple[float, float, float]]  # W [m] to latitude, longitude [deg], altitude [m MSL]
    gravity_mps2: float
    windy: bool  # the bench or the scene has wind
    noise_seed: int
    sensor_parameters: Mapping[str, float]  # that tell the firmware of the bench's sensors
    link_faults: bool  # faults of the link are declared
    signed_controls: frozenset[int] = frozenset()  # controls of the vehicle that are -1..1: its surfaces

    @property
    def timeouts(self) -> LinkTimeouts:
        """Timeouts of the bench file."""
        s = self.settings
        return LinkTimeouts(s.reply_timeout_s, s.connect_timeout_s, s.reconnect_s)


@dataclass(frozen=True)
class Surroundings:
    """Facts about the run that a link is part of."""

    out: Path  # folder of the run; processes that the link starts write their logs here
    wrap: Callable[[Transport], Transport]  # wraps the transport, for declared faults
    on_event: Callable[[str, str], None]  # (kind, text), at the present simulated time
    say: Callable[[str, str], None]  # the same, also printed on the console

    def build(self, settings: AutopilotSettings, log: str = LOG_NAME) -> FirmwareBuild:
        """Return the user's build, `autopilot.binary`, set to run in this run's folder and to write this log."""
        binary, out = Path(str(settings.binary)), self.out
        return FirmwareBuild(binary, out / WORK_FOLDER, out / log, arguments=settings.arguments, env=settings.env)

    def free_running(self, installation: Installation) -> dict[str, Any]:
        """Return the settings of links to autopilots that run on wall-clock time and do not wait for the bench."""
        return {
            "period_ns": 1_000_000_000 // installation.tick_hz,
            "on_event": self.on_event,
            "say": self.say,
            "timeouts": installation.timeouts,
        }
