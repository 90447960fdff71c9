"""Every key of a bench file with its type, unit, range and default.

`BenchConfig` is the whole file. A sensor has the keys of `SensorConfig` and, beside them, the parameters of its kind
from `sim.sensors.catalog`.
"""

from __future__ import annotations

import hashlib
import re
from ipaddress import ip_address
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.autopilots.profile import Profile
from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.ground_station.modes import WORDS as MODE_WORDS
from firmware_bridge.ground_station.modes import plain_word
from firmware_bridge.router.endpoint import Endpoint
from firmware_bridge.transports.loopback_host import is_loopback
from hil.config.group_schema import Formation, Group, Offset
from hil.config.limit_values import (
    AngleLimit,
    DistanceLimit,
    DistanceLimitOrZero,
    RollLimit,
    SpeedLimit,
    StallMargin,
    TimeLimit,
    TimeLimitOrZero,
)
from hil.data_set_files import LABEL_FORMATS
from signals.documents.validate import Section, nearest
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim.frame.quality import QualityName
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.launch import Launch
from sim.physics.surface_faults import SurfaceFault, VehicleFault
from sim.randomize.settings import Randomize
from sim.scene.weather import Weather
from sim.scene.wind import Wind
from sim.sensors.faults import SensorFault

MAX_SEED = 2**63 - 1


VEHICLE_NAME = r"[a-z][a-z0-9_]{0,31}"
VehicleName = Annotated[str, Field(pattern=f"^({VEHICLE_NAME})?$")]


def named_seed(seed: int, name: str) -> int:
    """Return a seed that depends on another and on a name, and on nothing else."""
    digest = hashlib.blake2b(f"{seed} {name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & MAX_SEED


class Autopilot(AutopilotSettings):
    """The flight controller and the link to it."""

    if not TYPE_CHECKING:
        kind: Literal[tuple(PROFILES)] = "mock"

    @property
    def profile(self) -> Profile:
        """Everything about this kind of autopilot."""
        return PROFILES[self.kind]

    @property
    def lockstep(self) -> bool:
        return self.profile.lockstep


def _endpoint(address: str) -> str:
    Endpoint.parse(address)
    return address


ClientAddress = Annotated[str, AfterValidator(_endpoint)]


class Router(Section):
    """Clients that the autopilot's MAVLink is forwarded to; null: none (docs/router.md).

    The bench sends to `udp:HOST:PORT` and listens at `udpin:HOST:PORT` and `tcp:HOST:PORT`.
    """

    gcs: ClientAddress | None = None  # a ground station such as QGroundControl, which listens on 14550
    sdk: ClientAddress | None = None  # an SDK such as MAVSDK, which listens on 14540
    companion: ClientAddress | None = None  # the companion computer
    more: tuple[ClientAddress, ...] = ()  # further clients
    # Repeats clients' heartbeats and OFFBOARD set-points in simulated time when the run is faster than real time.
    repeat_heartbeats: bool = True
    # Clients must sign their messages with the key in this file, and the bench signs its own; null: no signing.
    signing_key_file: str | None = None

    def endpoints(self) -> list[Endpoint]:
        """Return all addresses in the order of the keys."""
        named = [("gcs", self.gcs), ("sdk", self.sdk), ("companion", self.companion)]
        named += [("client", address) for address in self.more]
        return [Endpoint.parse(address, name) for name, address in named if address is not None]


class Manual(Section):
    """Manual control: the sticks are sent as MANUAL_CONTROL while the dead-man switch is held."""

    device: Literal["gamepad", "keyboard"] | None = None  # gamepad: the first on HID, which may be plugged in later
    rate_hz: Annotated[float, Field(ge=1, le=250)] = 25.0  # of simulated time
    neutral_s: Annotated[float, Field(ge=0, le=60)] = 0.5  # centred sticks are sent this long after release or loss
    needs_dead_man: bool = True  # false: accepts a gamepad mapping without a dead-man switch


def _address(host: str) -> str:
    if host != "localhost":
        ip_address(host)
    return host


def _origin(text: str) -> str:
    if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/\s*,]*", text.lower()):
        raise ValueError("must be the origin of a page as browsers name it, such as https://app.foxglove.dev")
    return text.lower()


class Foxglove(Section):
    """A run that Foxglove follows live (docs/foxglove.md)."""

    port: Annotated[int, Field(ge=0, le=65535)] | None = None  # null: none is served; 0: any that is free
    host: Annotated[str, AfterValidator(_address)] = "127.0.0.1"  # 0.0.0.0: other machines too, without a password
    # Pages that may connect. Those of other sites are refused; programs that are not browsers name none.
    origins: tuple[Annotated[str, AfterValidator(_origin)], ...] = ("https://app.foxglove.dev",)
    control: bool | None = None  # clients may pause, set the wind and inject faults; null: on loopback
    paused: bool = False  # wait before the first tick until a client resumes
    rate_hz: Annotated[float, Field(ge=1, le=60)] = 20.0  # wall clock, of updates
    sensors: bool = False  # compute cameras, LiDARs and radars that only Foxglove shows
    jpeg_quality: Annotated[int, Field(ge=10, le=100)] = 80  # of compressed pictures

    @property
    def may_control(self) -> bool:
        """True if clients may pause, set the wind and inject faults."""
        return is_loopback(self.host) if self.control is None else self.control

    @model_validator(mode="after")
    def _somebody_resumes(self) -> Foxglove:
        if self.paused and not self.may_control:
            raise ValueError("is paused, and nobody could resume the run: its clients have no control")
        return self


def _client_by_name(value: Any) -> Any:
    """Allow the name alone for a client without settings of its own."""
    return {"name": value} if isinstance(value, str) else value


class StartedCut(Section):
    """A client under test that the bench starts on this machine."""

    name: str  # as in `hil companion NAME`
    settings: dict[str, Any] = Field(default_factory=dict)  # of this client; replace those of all clients


class Companion(Section):
    """The companion link: frames of sensor data out, desired states back (docs/companion.md)."""

    clients: Annotated[int, Field(ge=0, le=32)] = 0  # awaited before the flight; more may connect later
    start: Annotated[tuple[Annotated[StartedCut, BeforeValidator(_client_by_name)], ...], Field(max_length=8)] = ()
    settings: dict[str, Any] = Field(default_factory=dict)  # of all started clients, as in `hil companion --set`
    control: bool = False  # clients command the vehicle; they then fly the mission, which is judged as usual
    time: Literal["lockstep", "realtime", "latency_true"] = "lockstep"
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 10.0  # of frames
    arrangement: Literal["shared_memory", "one_port", "ports"] = "shared_memory"
    host: str = "127.0.0.1"  # of one_port and ports; any but loopback needs `keys`
    port: Annotated[int, Field(ge=0, le=65535)] = 5570  # 0: any that is free
    sensor_port: Annotated[int, Field(ge=1024, le=65535)] | None = None  # of `ports`: the sensors' first port
    ring_mb: Annotated[int, Field(ge=1, le=4096)] = 64  # of shared_memory: size of the ring buffer [MiB]
    keys: str | None = None  # folder made by `hil keys`
    connect_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 30.0  # wall clock, until all clients are connected
    reply_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 5.0  # wall clock, until the answer to a frame
    reconnect_s: Annotated[float, Field(ge=0, le=3600)] = (
        5.0  # wall clock; a lost client in control must be back within it
    )
    on_loss: Literal["error", "go_on"] = "error"  # if a client in control does not reconnect
    link_delay_s: Annotated[float, Field(ge=0, le=10)] | None = None  # of latency_true; null: as measured
    setpoint_hz: Annotated[float, Field(ge=3, le=250)] = 50.0  # simulated time
    trace: str | None = None  # recorded answers that replace the clients; set by `hil replay`

    @property
    def on(self) -> bool:
        """True if the bench has a companion link."""
        return self.clients > 0 or bool(self.start) or self.trace is not None

    @property
    def flies(self) -> bool:
        """True if clients command the vehicle."""
        return self.on and self.control

    @property
    def times_count(self) -> bool:
        """True if the measured compute time of clients changes the flight. A trace makes it repeatable."""
        return self.flies and self.time != "lockstep" and self.trace is None

    @property
    def expected(self) -> int:
        """Number of clients to wait for."""
        return max(self.clients, len(self.start))


class Ros2(Section):
    """The run as a node of a ROS 2 graph (docs/ros2.md)."""

    domain: Annotated[int, Field(ge=0, le=232)] | None = None  # ROS_DOMAIN_ID; null: no ROS 2
    interface: str | None = "lo"  # network interface; null: as the variable CYCLONEDDS_URI says
    topics: tuple[str, ...] = ("*",)  # names or patterns; their sensors are computed
    wait_for: tuple[str, ...] = ()  # topics whose subscribers must have received a message before the run goes on
    wait_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 10.0  # wall clock; then the run ends as ERROR
    control: bool = False  # set-points of ROS 2 nodes command the vehicle
    setpoint_hz: Annotated[float, Field(ge=3, le=250)] = 50.0  # simulated time
    takeoff_height_m: Annotated[float, Field(gt=0, le=500)] = 2.5  # of the service /takeoff, above the vehicle
    # Parent of base_link in /tf. `map`: map -> odom -> base_link (REP 105). `odom`: odom -> base_link alone, and
    # `none`: neither, for nodes that localise the vehicle.
    tf: Literal["world", "map", "odom", "none"] = "world"

    @property
    def flies(self) -> bool:
        """True if ROS 2 nodes command the vehicle."""
        return self.domain is not None and self.control


class Follow(Section):
    """A real flight, flown again by the set-points of its log (docs/follow.md)."""

    log: str | None = None  # .ulg, .bin, run.mcap or its run folder, .csv or .parquet; null: none is followed
    flight: Annotated[int, Field(ge=1)] | None = None  # of a log with several flights, from 1
    columns: str | None = None  # map of a table's columns (docs/identify.md)
    of: str = ""  # vehicle of a recording that has several
    set_points: Literal["log", "measured"] = "log"  # measured: the flown trajectory itself, whatever was commanded
    wind: Literal["bench", "log"] = "bench"  # log: the mean of the wind that the log's estimator saw
    # Limits of the differences between the real flight and the simulated one; null: measured but not judged.
    position_rms_m: DistanceLimit | None = None
    position_max_m: DistanceLimit | None = None
    velocity_rms_mps: SpeedLimit | None = None
    attitude_rms_deg: AngleLimit | None = None

    @property
    def flies(self) -> bool:
        """True if a log is flown."""
        return self.log is not None


class Record(Section):
    """Recordings of a run, besides run.json."""

    mcap: bool = True  # all topics, for Foxglove and `ros2 bag`
    images: bool = True  # with mcap: pictures and point clouds; false: rendered only for other consumers
    tlog: bool = True  # MAVLink, in the format of ground stations
    report: bool = True  # report.html with plots


CourseCoordinate = Annotated[float, Field(ge=-2000, le=2000)]
CoursePoint = tuple[CourseCoordinate, CourseCoordinate]


MAX_HEIGHT_M = 500.0  # of a course


class Trajectory(Section):
    """A course for `hil dataset`, flown repeatedly from the take-off place (hil/apps/dataset/trajectory.py)."""

    preset: Literal["square", "circle", "figure_eight", "survey", "points"] = "square"
    side_m: Annotated[float, Field(ge=2, le=2000)] = 20.0  # of the square around the course
    height_m: Annotated[float, Field(ge=1, le=MAX_HEIGHT_M)] = 8.0  # above the take-off place
    clear: bool = False  # raise the course by whole metres until nothing that stands still is in its way
    speed_mps: Annotated[float, Field(ge=0.2, le=15)] = 3.0
    # Used by the preset `points` alone: east and north of the take-off place, flown in this order, then from the first.
    points_m: Annotated[tuple[CoursePoint, ...], Field(max_length=200)] = ()

    @model_validator(mode="after")
    def _points_where_needed(self) -> Trajectory:
        if self.preset == "points" and len(self.points_m) < 2:
            raise ValueError(
                f"preset points needs points_m with at least 2 points [east, north], not {len(self.points_m)}"
            )
        return self


class DatasetSettings(Section):
    """Settings of `hil dataset` (docs/dataset.md)."""

    trajectory: Trajectory | None = None  # replaces the mission; null: the mission is flown
    record: Literal["trajectory", "flight"] = "trajectory"  # from the first waypoint to the last, or the whole flight
    depth_step_m: Annotated[float, Field(ge=1e-6, le=1.0)] = 0.001  # of depth pictures; range 65534 steps
    guard_frames: Annotated[int, Field(ge=0, le=1000)] = 2  # in no set, at the border of two sets
    lidar_csv: bool = False  # LiDAR sweeps as text too: slow and large
    # Forms of 3-D labels beside EuRoC, VOC and COCO, which are always written; all others include boxes.
    formats: tuple[Literal[LABEL_FORMATS], ...] = ()  # type: ignore[valid-type]


class Limits(Section):
    """Limits that a flight must meet to PASS; null: measured but not judged. Definitions: hil/run/verdict."""

    max_cross_track_m: DistanceLimit | None = 1.0
    final_error_m: DistanceLimit | None = 0.7
    altitude_error_m: DistanceLimit | None = 0.5
    landing_speed_mps: SpeedLimit | None = 2.0
    landed_tilt_deg: AngleLimit | None = 30.0


class PlaneLimits(Section):
    """Limits that the flight of a plane must meet to PASS, in place of `limits`; null: measured but not judged.

    Definitions: hil/run/verdict/plane_flight.py.
    """

    max_cross_track_m: DistanceLimit | None = 25.0  # from the path that a plane can fly
    altitude_error_m: DistanceLimit | None = 8.0  # on level legs
    airspeed_margin: StallMargin | None = 1.1  # least airspeed over the stall at the load of the bank
    stalled_s: TimeLimitOrZero | None = 0.5  # beyond the stall's angle of attack
    max_bank_deg: AngleLimit | None = 60.0
    loiter_error_m: DistanceLimit | None = 15.0
    touchdown_sink_mps: SpeedLimit | None = 2.0
    touchdown_bank_deg: AngleLimit | None = 10.0
    touchdown_offset_m: DistanceLimit | None = 6.0  # from the line of the approach
    touchdown_error_m: DistanceLimit | None = 100.0  # from the planned point along that line
    final_error_m: DistanceLimit | None = None
    takeoff_roll_m: RollLimit | None = None  # on wheels, on the runway of the scene, as the next
    landing_roll_m: RollLimit | None = None
    centre_line_m: DistanceLimit | None = 5.0  # from the centre line of the runway while it rolls
    off_runway_m: DistanceLimitOrZero | None = 0.0  # outside the runway while it touches the ground


class VtolLimits(Section):
    """Limits of a VTOL beside `limits`, of its hover, and `plane_limits`, of its flight; null: measured but not judged.

    Definition: hil/run/verdict/vtol_flight.py.
    """

    transition_loss_m: DistanceLimit | None = 5.0  # of height, in a transition


class Crash(Section):
    """A crash ends the flight as FAIL; null: not a sign of one. Definitions: hil/run/parts/judges/crash.py."""

    impact_mps: SpeedLimit | None = 6.0
    tilt_deg: AngleLimit | None = 60.0
    rest_s: TimeLimit | None = 10.0
    touch_m: DistanceLimit | None = 2.0  # the flight goes on, as FAIL: hil/run/parts/judges/touch.py


class FailsafeExpected(Section):
    """A failsafe that the flight is to have, or may have. Any other one makes the flight a FAIL."""

    required: bool = True  # false: it may come, and need not
    mode: str | None = None  # mode word of the vehicle after it (docs/mission-scripts.md); null: any
    from_s: Annotated[float, Field(ge=0, le=86_400)] | None = None  # earliest; null: at any time
    to_s: Annotated[float, Field(ge=0, le=86_400)] | None = None  # latest

    @field_validator("mode")
    @classmethod
    def _known_mode(cls, word: str | None) -> str | None:
        if word is not None and word not in MODE_WORDS:
            raise ValueError(f"no mode {word!r} ({nearest(word, MODE_WORDS)})")
        return word

    @model_validator(mode="after")
    def _window(self) -> FailsafeExpected:
        if self.from_s is not None and self.to_s is not None and not self.to_s > self.from_s:
            raise ValueError(f"to_s {self.to_s:g} must come after from_s {self.from_s:g}")
        return self

    def covers(self, t_s: float, mode: str) -> bool:
        """Return True if this declares a failsafe at `t_s` that entered the mode of this word."""
        in_time = (self.from_s is None or t_s >= self.from_s) and (self.to_s is None or t_s <= self.to_s)
        return in_time and (self.mode is None or plain_word(self.mode) == mode)

    @property
    def text(self) -> str:
        """The mode and the time for messages, such as " with mode LAND from 45 s to 60 s"."""
        words = [f" with mode {self.mode}"] if self.mode is not None else []
        words += [f" {word} {t:g} s" for word, t in (("from", self.from_s), ("to", self.to_s)) if t is not None]
        return "".join(words)


Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
AT_GOAL = "goal"  # outcome of a flight that reached it


class Goal(Section):
    """A position to which the companion must find a path. It is sent to the companion as the only waypoint."""

    p_W: tuple[Coordinate, Coordinate, Coordinate]  # [m]; z is the height of the flight
    outcome: str = AT_GOAL  # expected report of the client; another one if the goal cannot be reached
    within_m: DistanceLimit | None = 1.5
    max_height_error_m: DistanceLimit | None = 2.0  # on the way, from its height
    min_clearance_m: Annotated[float, Field(gt=0, le=4)] | None = 0.5  # between the vehicle and any geometry
    # Flown length over that of the shortest path on the full map.
    max_path_ratio: Annotated[float, Field(ge=1, lt=100)] | None = 1.35


class Search(Section):
    """Objects of a class that a companion must find and locate, judged by ground truth; null limits: not judged."""

    label: str = "person"
    camera: str = "front"  # sensor that decides which objects were visible
    visible_px: Annotated[int, Field(ge=1)] = 64  # pixels of an object that make it visible in a sample
    visible_samples: Annotated[int, Field(ge=1)] = 4  # with that many pixels, of four samples a second
    gate_m: Annotated[float, Field(gt=0, le=100)] = 4.0  # a report farther from every object is false
    min_found_share: Annotated[float, Field(gt=0, le=1)] | None = 0.9  # of the visible objects
    max_error_m: DistanceLimit | None = 2.0  # median, horizontal
    max_worst_error_m: DistanceLimit | None = None
    max_false: Annotated[int, Field(ge=0)] | None = 1
    max_doubles: Annotated[int, Field(ge=0)] | None = 1  # further reports of objects that already have one
    count_duplicates: bool = False  # a second report of one object is false too


StartCoordinate = Annotated[float, Field(ge=-25_000, le=25_000)]  # the model of the vehicle ends 50 km from the site


class Start(Section):
    """Pose of the vehicle at the start of the run: it stands level on its feet."""

    p_W: tuple[StartCoordinate, StartCoordinate, StartCoordinate] = (0.0, 0.0, 0.0)  # [m] on the ground, amid its feet
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0  # counter-clockwise from east; 90: north

    launch: Launch | None = None  # a plane is thrown from above p_W; null: it starts on its feet or wheels

    def flight_start(self) -> FlightStart:
        """Return the start for the physics."""
        return FlightStart(ground_W=self.p_W, yaw_rad=self.yaw_deg * RAD_PER_DEG, launch=self.launch)


class Physics(Section):
    """Options of the dynamics."""

    contact_skipping: bool = True  # no contact work while nothing can touch
    effects: Effects = Effects()  # optional parts of the vehicle's model
    # Longest step of the free-flight integrator, a divisor of the tick; null: the tick.
    step_us: Annotated[int, Field(ge=10, le=10_000)] | None = None


class Faults(Section):
    """Injected faults, each at a simulated time."""

    rotors: tuple[RotorFault, ...] = ()
    surfaces: tuple[SurfaceFault, ...] = ()
    sensors: tuple[SensorFault, ...] = ()
    links: tuple[LinkFault, ...] = ()  # on the link to the autopilot

    @property
    def of_vehicle(self) -> tuple[VehicleFault, ...]:
        """Faults of rotors and control surfaces."""
        return (*self.rotors, *self.surfaces)


class SensorConfig(BaseModel):
    """One sensor, with the keys of the bench file merged over its preset.

    In a file the keys of `parameters` are written beside the others.
    """

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)

    kind: str
    preset: str | None
    autopilot: bool  # feeds the flight controller
    rate_hz: float
    parameters: Any  # the parameter model of this kind


class BenchConfig(Section):
    """The whole bench."""

    rig: str = "mock"
    description: str = ""
    features: tuple[str, ...] = ()  # hardware of the rig, for tests that need it
    scene: str = "airfield"
    map_seed: Annotated[int, Field(ge=0, le=MAX_SEED)] | None = None  # of a generated map; null: the scene's own
    vehicle: str = "x500"
    vehicle_settings: dict[str, Any] = Field(default_factory=dict)  # over the vehicle's file: {mass_kg: 2.3}
    mission: str | None = None  # .plan, .waypoints or script; null: only clients of the router command
    mission_offset_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)  # the mission is flown shifted by this [m in W]
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 1
    tick_hz: Annotated[int, Field(ge=100, le=1000)] = 250
    duration_s: Annotated[float, Field(gt=0, le=86_400)] = 600.0  # simulated time after which the run ends
    # Level of cameras without a `quality` of their own (sim/frame/quality.py); null: their own settings.
    quality: QualityName | None = None
    pace: Annotated[float, Field(gt=0, le=1000)] | None = None  # times real time; null: as fast as possible
    autopilot: Autopilot = Autopilot()
    router: Router = Router()
    manual: Manual = Manual()
    companion: Companion = Companion()
    ros2: Ros2 = Ros2()
    follow: Follow = Follow()
    foxglove: Foxglove = Foxglove()
    sensors: dict[str, SensorConfig] = Field(default_factory=dict)
    start: Start = Start()
    physics: Physics = Physics()
    vibration: Literal["off", "estimated"] = "off"  # of the rotors, as the IMU feels it (docs/sensors.md)
    wind: Wind | None = None  # null: the scene's steady wind
    weather: Weather | None = None  # null: the scene's
    randomize: Randomize = Randomize()
    faults: Faults = Faults()
    record: Record = Record()
    dataset: DatasetSettings = DatasetSettings()
    limits: Limits = Limits()
    plane_limits: PlaneLimits = PlaneLimits()  # of a plane, in place of `limits`
    vtol_limits: VtolLimits = VtolLimits()  # of a VTOL, beside both
    crash: Crash | None = Crash()  # null: a crash does not end the flight
    # Distance from start, plan and goal at which the flight ends as FAIL; null: it never does.
    fly_away_m: Annotated[float, Field(gt=0, le=1e6)] | None = 500.0
    failsafe: FailsafeExpected | None = None  # null: the flight is to have none
    goal: Goal | None = None  # null: not judged
    search: Search | None = None  # null: not judged
    parts: dict[str, Any] = Field(default_factory=dict)  # further parts of a run, each with settings of its own
    name: VehicleName = ""  # of a vehicle in a bench with several; its noise depends on it
    # Several vehicles in one world: name -> settings of this vehicle that differ from those of the bench
    # (docs/vehicles.md). A name with {n} stands for `count` vehicles, numbered from 1.
    vehicles: dict[str, Any] = Field(default_factory=dict)
    count: Annotated[int, Field(ge=1, le=1000)] | None = None
    formation: Formation | None = None  # null: none is flown
    group: Group = Group()

    @property
    def flown_by_set_points(self) -> bool:
        """True if a companion, ROS 2 nodes or a followed log command the vehicle: no mission is uploaded."""
        return self.companion.flies or self.ros2.flies or self.follow.flies

    @property
    def noise_seed(self) -> int:
        """Seed of the noise of this vehicle's sensors, wind and links: that of the bench and the vehicle's name."""
        return self.seed if not self.name else named_seed(self.seed, self.name)

    @property
    def tick_ns(self) -> int:
        """One tick [ns], exact."""
        return NS_PER_S // self.tick_hz

    def autopilot_sensors(self) -> dict[str, str]:
        """Return the sensor that feeds the flight controller for each kind, as kind -> name."""
        return {sensor.kind: name for name, sensor in self.sensors.items() if sensor.autopilot}

    def missing_sensors(self) -> list[str]:
        """Return the kinds of sensors that the flight controller needs to fly a course and that nothing feeds it."""
        fed = self.autopilot_sensors()
        return [kind for kind in self.autopilot.profile.flight_sensors if kind not in fed]

    @field_validator("tick_hz")
    @classmethod
    def _whole_nanoseconds(cls, tick_hz: int) -> int:
        if NS_PER_S % tick_hz:
            fitting = [hz for hz in range(100, 1001) if NS_PER_S % hz == 0]
            nearest = min(fitting, key=lambda hz: abs(hz - tick_hz))
            raise ValueError(
                f"{tick_hz} Hz is not a whole number of nanoseconds per tick; the nearest that is: {nearest} Hz"
            )
        return tick_hz


# The sensors of a bench without a section `sensors`.
STANDARD_SENSORS: dict[str, dict[str, Any]] = {
    "imu": {"preset": "icm20689"},
    "gps": {"preset": "here_plus", "rate_hz": 10},
    "baro": {"preset": "ms5611", "rate_hz": 50},
    "mag": {"preset": "ist8310", "rate_hz": 50},
}
