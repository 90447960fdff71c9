"""What a bench file may say: every key, its type, unit, range and default.

A bench is `BenchConfig`. The keys of one sensor are those of `SensorConfig` plus the parameters of its kind, which
`sim.sensors.catalog` declares; they stand side by side in the file.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.router_endpoint import Endpoint
from hil.signals.documents.validate import Section
from hil.signals.time import NS_PER_S
from sim.frame.quality import QualityName
from sim.physics.faults import RotorFault
from sim.physics.vehicle import Effects
from sim.randomize.settings import Randomize
from sim.scene.weather import Weather
from sim.scene.wind import Wind
from sim.sensors.faults import SensorFault

MAX_SEED = 2**63 - 1


FaultTime = Annotated[float, Field(ge=0)] | None


class MockFaults(Section):
    """Ways in which the mock Pixhawk misbehaves on purpose, each from a given simulated time on."""

    die_at_s: FaultTime = None  # its process ends
    stall_at_s: FaultTime = None  # it stops answering
    wrong_time_at_s: FaultTime = None  # it answers with the time of another tick
    garbage_at_s: FaultTime = None  # random bytes in place of each answer
    noise_at_s: FaultTime = None  # random bytes between the frames, which survive

    def texts(self) -> tuple[str, ...]:
        """The faults as the mock's command line takes them: 'die@12.5'."""
        times = {name.removesuffix("_at_s"): getattr(self, name) for name in type(self).model_fields}
        return tuple(f"{kind}@{t_s!r}" for kind, t_s in times.items() if t_s is not None)


MOCK_AIRFRAMES = ("x500", "iris")
# Whose answers the bench waits for at every tick; the others run on wall-clock time.
LOCKSTEP_KINDS = frozenset({"mock", "px4_sitl", "ardupilot_sitl"})
# Those that are the user's own firmware, and those among them that are a program on this machine.
FIRMWARE_KINDS = frozenset({"px4_sitl", "px4_hitl", "ardupilot_sitl", "ardupilot_eahrs"})
PROGRAM_KINDS = frozenset({"px4_sitl", "ardupilot_sitl"})
ENV_NAME = r"[A-Za-z_][A-Za-z0-9_]*"


def _number_as_text(value: Any) -> Any:
    """An airframe's number need not stand in quotes."""
    return str(value) if type(value) is int else value


class Autopilot(Section):
    """The flight controller and the wire to it."""

    kind: Literal["mock", "mock_hitl", "px4_sitl", "px4_hitl", "ardupilot_sitl", "ardupilot_eahrs"] = "mock"
    transport: Literal["pty", "loopback"] = "pty"  # mock only; loopback: in this process, same bytes, no serial line
    airframe: Annotated[str, BeforeValidator(_number_as_text)] = (
        "x500"  # what the flight controller takes the vehicle for; PX4: name or number of an airframe
    )
    # HIL_SENSORs at the start that get no reply. null: unknown, so the bench free-runs until the first reply.
    boot_sensors: Annotated[int, Field(ge=0, le=300)] | None = 20
    reply_timeout_s: Annotated[float, Field(gt=0, le=600)] = 5.0  # wall clock; past it the run ends as ERROR
    connect_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 20.0  # wall clock, for the first sign of life
    start: bool = True  # false: the user starts it
    port: str | None = None  # serial device, used instead of `transport`, e.g. /dev/ttyACM0
    # MAVLink where it has a wire of its own: a second serial device (ardupilot_eahrs); udp:PORT, tcp:PORT or none
    # (ardupilot_sitl that somebody else starts).
    mavlink_port: str | None = None
    baud: Annotated[int, Field(ge=1200, le=12_000_000)] = 921_600  # of a real serial line; USB takes any
    binary: str | None = None  # the user's own firmware build, for rigs that need one
    instance: Annotated[int, Field(ge=0, le=99)] = 0  # of a simulated autopilot: its network ports count up with it
    arguments: tuple[str, ...] = ()  # further command-line arguments for `binary`
    env: dict[str, str] = Field(default_factory=dict)  # environment of `binary`
    params: dict[str, float] = Field(default_factory=dict)  # flight-controller parameters by name
    reconnect_s: Annotated[float, Field(ge=0, le=600)] = (
        10.0  # free-running links: how long an unplugged board may stay
    )
    # Firmware started by the bench: both on one processor, the autopilot first. More repeatable and no slower on a
    # machine with nothing else to do; given up by itself on a busy one.
    share_processor: bool = True
    # ArduPilot SITL that reboots in the run: an error, or the vehicle goes back to its start and the run goes on.
    on_restart: Literal["error", "reset"] = "error"
    signing_key_file: str | None = None  # what the bench itself says is signed with this key; null: unsigned
    faults: MockFaults = MockFaults()

    @property
    def lockstep(self) -> bool:
        return self.kind in LOCKSTEP_KINDS

    @property
    def is_mock(self) -> bool:
        return self.kind not in FIRMWARE_KINDS

    @field_validator("env")
    @classmethod
    def _names_of_variables(cls, env: dict[str, str]) -> dict[str, str]:
        for name, value in env.items():
            if not re.fullmatch(ENV_NAME, name) or "\0" in value:
                raise ValueError(f"{name!r} cannot be an environment variable")
        return env

    @field_validator("params")
    @classmethod
    def _names_fit_mavlink(cls, params: dict[str, float]) -> dict[str, float]:
        for name in params:
            if not re.fullmatch(r"[A-Z0-9_]{1,16}", name):
                raise ValueError(f"{name!r} cannot be a parameter: 1 to 16 of A-Z, 0-9 and _")
        return params


def _endpoint(address: str) -> str:
    Endpoint.parse(address)
    return address


ClientAddress = Annotated[str, AfterValidator(_endpoint)]


class Router(Section):
    """Where the autopilot's MAVLink is passed on to; null: nobody.

    `udp:HOST:PORT` clients listen there; `udpin:HOST:PORT`, `tcp:HOST:PORT` they come to us there (docs/router.md).
    """

    gcs: ClientAddress | None = None  # a ground station such as QGroundControl, which listens on 14550
    sdk: ClientAddress | None = None  # an SDK such as MAVSDK, which listens on 14540
    companion: ClientAddress | None = None  # the companion computer
    more: tuple[ClientAddress, ...] = ()  # further ones
    # Repeat clients' heartbeats and OFFBOARD set-points in simulated time when the run is faster than real time.
    hold_heartbeats: bool = True
    # What clients say must be signed with the key in this file, and what they hear is; null: as it comes.
    signing_key_file: str | None = None

    def endpoints(self) -> list[Endpoint]:
        """In the order of the keys."""
        named = [("gcs", self.gcs), ("sdk", self.sdk), ("companion", self.companion)]
        named += [("client", address) for address in self.more]
        return [Endpoint.parse(address, name) for name, address in named if address is not None]


class Manual(Section):
    """Flying by hand: sticks become MANUAL_CONTROL. They count only while the dead-man switch is held."""

    device: Literal["gamepad", "keyboard"] | None = None  # gamepad: the first on HID, also one plugged in later
    rate_hz: Annotated[float, Field(ge=1, le=250)] = 25.0  # of simulated time
    neutral_s: Annotated[float, Field(ge=0, le=60)] = 0.5  # centred sticks after release or loss, then silence
    needs_dead_man: bool = True  # false: a gamepad whose mapping names no dead-man switch will do


def _client_by_name(value: Any) -> Any:
    """A client that needs no settings of its own is written by its name alone."""
    return {"name": value} if isinstance(value, str) else value


class StartedCut(Section):
    """A client under test that the bench starts itself on this machine."""

    name: str  # as `hil companion` knows it
    settings: dict[str, Any] = Field(default_factory=dict)  # of this one, over those of all


class Companion(Section):
    """The link to the companion computer: frames of sensor data out, desired states back (docs/companion.md)."""

    clients: Annotated[int, Field(ge=0, le=32)] = 0  # waited for before the flight; more may come and go
    start: Annotated[tuple[Annotated[StartedCut, BeforeValidator(_client_by_name)], ...], Field(max_length=8)] = ()
    settings: dict[str, Any] = Field(default_factory=dict)  # of all started ones, as `hil companion --set` takes them
    control: bool = False  # what the clients desire is flown; the mission is then theirs to fly, and still judged
    time: Literal["lockstep", "realtime", "latency_true"] = "lockstep"
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 10.0  # frames
    arrangement: Literal["shared_memory", "one_port", "ports"] = "shared_memory"
    host: str = "127.0.0.1"  # of one_port and ports; one that others can reach needs `keys`
    port: Annotated[int, Field(ge=0, le=65535)] = 5570  # 0: any that is free
    sensor_port: Annotated[int, Field(ge=1024, le=65535)] | None = None  # of `ports`: the first of the sensors' own
    ring_mb: Annotated[int, Field(ge=1, le=4096)] = 64  # of shared_memory: MiB for the frames under way
    keys: str | None = None  # folder made by `hil keys`
    connect_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 30.0  # wall clock, for all clients to come
    reply_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 5.0  # wall clock, for the answer to a frame
    reconnect_s: Annotated[float, Field(ge=0, le=3600)] = (
        5.0  # wall clock, that a lost controlling client may stay away
    )
    on_loss: Literal["error", "go_on"] = "error"  # of one that controls and does not come back
    link_delay_s: Annotated[float, Field(ge=0, le=10)] | None = None  # latency_true charges it too; null: as measured
    setpoint_hz: Annotated[float, Field(ge=3, le=250)] = 50.0  # simulated time
    trace: str | None = None  # answers recorded in another run, instead of clients; `hil replay` sets it

    @property
    def on(self) -> bool:
        """Whether there is such a link at all."""
        return self.clients > 0 or bool(self.start) or self.trace is not None

    @property
    def times_count(self) -> bool:
        """Whether how long clients took has a say in the flight. A trace of it repeats the run all the same."""
        return self.on and self.control and self.time != "lockstep" and self.trace is None

    @property
    def expected(self) -> int:
        """Clients to wait for."""
        return max(self.clients, len(self.start))


class Record(Section):
    """What is kept of a run, besides run.json."""

    mcap: bool = True  # everything, for Foxglove and `ros2 bag`
    images: bool = True  # with mcap: pictures and point clouds too; what nobody else wants is then not even drawn
    tlog: bool = True  # MAVLink as ground stations record it
    report: bool = True  # the report page with its plots


class Trajectory(Section):
    """A course for `hil dataset`, flown round and round from the take-off place on (hil/dataset/plan.py)."""

    preset: Literal["square", "circle", "figure_eight", "survey"] = "square"
    side_m: Annotated[float, Field(ge=2, le=2000)] = 20.0  # of the square about it
    height_m: Annotated[float, Field(ge=1, le=500)] = 8.0  # above the take-off place
    speed_mps: Annotated[float, Field(ge=0.2, le=15)] = 3.0


class DatasetSettings(Section):
    """What `hil dataset` makes of the flight (docs/dataset.md)."""

    trajectory: Trajectory | None = None  # flown instead of the mission; null: the mission
    record: Literal["trajectory", "flight"] = "trajectory"  # from the first waypoint to the last, or all of it
    depth_step_m: Annotated[float, Field(ge=1e-6, le=1.0)] = 0.001  # of depth pictures, which reach to 65534 steps
    guard_frames: Annotated[int, Field(ge=0, le=1000)] = 2  # in no set, where two sets meet
    lidar_csv: bool = False  # sweeps as text too: slow and large


class Limits(Section):
    """What a flight must keep to PASS; null: measured and shown, but not judged. Definitions: `hil.verdict`."""

    max_cross_track_m: Annotated[float, Field(gt=0)] | None = 1.0
    final_error_m: Annotated[float, Field(gt=0)] | None = 0.7
    altitude_error_m: Annotated[float, Field(gt=0)] | None = 0.5
    landing_speed_mps: Annotated[float, Field(gt=0)] | None = 2.0
    landed_tilt_deg: Annotated[float, Field(gt=0, le=180)] | None = 30.0


Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]


class Goal(Section):
    """A place that the companion finds its own way to; told to it as the bench's one waypoint. null: not judged."""

    p_W: tuple[Coordinate, Coordinate, Coordinate]  # its third number is the height of the flight
    outcome: str = "goal"  # that the client is to report: another one for a goal that cannot be reached
    within_m: Annotated[float, Field(gt=0)] | None = 1.5
    min_clearance_m: Annotated[float, Field(gt=0, le=4)] | None = 0.5  # of the vehicle to anything
    max_path_ratio: Annotated[float, Field(ge=1)] | None = 1.35  # way flown over the shortest on the full map


class Search(Section):
    """Things of a class that a companion is to find and place; judged by ground truth. null: not judged."""

    label: str = "person"
    camera: str = "front"  # sensor: who was to be seen is who it could see
    visible_px: Annotated[int, Field(ge=1)] = 64  # of somebody who can be seen
    visible_looks: Annotated[int, Field(ge=1)] = 4  # four a second
    gate_m: Annotated[float, Field(gt=0, le=100)] = 4.0  # farther from everybody, an object is a false one
    min_found_share: Annotated[float, Field(ge=0, le=1)] | None = 0.9  # of those who were to be seen
    max_error_m: Annotated[float, Field(gt=0)] | None = 2.0  # median, horizontally
    max_false: Annotated[int, Field(ge=0)] | None = None
    doubles_count: bool = False  # whether one person told twice is a false one too


class Physics(Section):
    """Switches of the dynamics."""

    contact_skipping: bool = True  # no contact work while nothing can touch
    effects: Effects = Effects()  # optional parts of the vehicle's model
    # Longest step of the free-flight integrator; null: the tick. It must divide the tick.
    step_us: Annotated[int, Field(ge=10, le=10_000)] | None = None


class Faults(Section):
    """What goes wrong on purpose, each at a simulated time."""

    rotors: tuple[RotorFault, ...] = ()
    sensors: tuple[SensorFault, ...] = ()
    links: tuple[LinkFault, ...] = ()  # on the wire to the autopilot


class SensorConfig(BaseModel):
    """One sensor, with the parameters of its preset and the bench file's own merged.

    In files `parameters` has no name of its own: its keys stand beside the others.
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
    features: tuple[str, ...] = ()  # hardware that the rig has; tests choose by it
    scene: str = "airfield"
    map_seed: Annotated[int, Field(ge=0, le=MAX_SEED)] | None = None  # of a generated map; null: the scene's own
    vehicle: str = "x500"
    mission: str | None = None  # .plan, .waypoints or script; null: only the router's clients command
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 1
    tick_hz: Annotated[int, Field(ge=100, le=1000)] = 250
    duration_s: Annotated[float, Field(gt=0, le=86_400)] = 600.0  # simulated time after which the run ends
    # Of cameras that name no level of their own (sim/frame/quality.py); null: as they are.
    quality: QualityName | None = None
    pace: Annotated[float, Field(gt=0, le=1000)] | None = None  # times real time; null: as fast as it goes
    autopilot: Autopilot = Autopilot()
    router: Router = Router()
    manual: Manual = Manual()
    companion: Companion = Companion()
    sensors: dict[str, SensorConfig] = Field(default_factory=dict)
    physics: Physics = Physics()
    wind: Wind | None = None  # null: the scene's steady wind
    weather: Weather | None = None  # null: the scene's
    randomize: Randomize = Randomize()
    faults: Faults = Faults()
    record: Record = Record()
    dataset: DatasetSettings = DatasetSettings()
    limits: Limits = Limits()
    goal: Goal | None = None  # null: the flight is not judged by one
    search: Search | None = None  # null: the flight is not judged by what was found

    @property
    def tick_ns(self) -> int:
        """One tick [ns], exact."""
        return NS_PER_S // self.tick_hz

    def autopilot_sensors(self) -> dict[str, str]:
        """kind -> name of the one sensor of that kind that feeds the flight controller."""
        return {sensor.kind: name for name, sensor in self.sensors.items() if sensor.autopilot}

    @field_validator("tick_hz")
    @classmethod
    def _whole_nanoseconds(cls, tick_hz: int) -> int:
        if NS_PER_S % tick_hz:
            fitting = [hz for hz in range(100, 1001) if NS_PER_S % hz == 0]
            near = min(fitting, key=lambda hz: abs(hz - tick_hz))
            raise ValueError(
                f"{tick_hz} Hz is not a whole number of nanoseconds per tick; the nearest that is: {near} Hz"
            )
        return tick_hz


# What a bench has that does not speak of sensors.
STANDARD_SENSORS: dict[str, dict[str, Any]] = {
    "imu": {"preset": "icm20689"},
    "gps": {"preset": "here_plus", "rate_hz": 10},
    "baro": {"preset": "ms5611", "rate_hz": 50},
    "mag": {"preset": "ist8310", "rate_hz": 50},
}
