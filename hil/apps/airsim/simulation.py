"""The world of the server: its vehicles, the requests that let time go on, and what clients see of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from firmware_bridge.autopilots.catalog import PROFILES
from hil.apps.airsim.client_files import ClientFiles
from hil.apps.airsim.flight.simple_flight import SimpleFlight
from hil.apps.airsim.pictures.cameras import Cameras
from hil.apps.airsim.pictures.recording import Recorder
from hil.apps.airsim.rpc.large_replies import LargeReplies
from hil.apps.airsim.rpc.methods import Pending, RpcError
from hil.apps.airsim.rpc.world_lock import WorldLock
from hil.apps.airsim.settings.settings import AirSimSettings
from hil.apps.airsim.settings.vehicles import Vehicle as VehicleSettings
from hil.apps.airsim.world.drawings import Drawings
from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.frames import Frames
from hil.apps.airsim.world.ned import Earth, NedFrame
from hil.apps.airsim.world.objects.present_world import PresentWorld
from hil.apps.airsim.world.objects.registry import Objects
from hil.apps.airsim.world.past import Past
from hil.apps.airsim.world.radars import Radars
from hil.apps.airsim.world.sensors.sensor import Measured
from hil.apps.airsim.world.sensors.suite import SensorSuite
from hil.apps.airsim.world.starts import Starts
from hil.apps.airsim.world.surroundings import Surroundings
from hil.config import Bench
from hil.run.stepped.vehicle import FlyingVehicle, Pilot, SteppedVehicle
from hil.run.stepped.world import Departure, SteppedWorld
from signals.errors import ConfigError, LinkError
from signals.frames import ned_from_enu
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.forces.push import Push
from sim.physics.multirotor import uneven, unfit
from sim.scene.scene import Scene

TICK_NS = 4_000_000  # 250 Hz
FRAME_TICKS = 4  # of simContinueForFrames: 16 ms, about a frame of AirSim at 60 Hz
CALLS_EPOCH_NS = 1_700_000_000 * NS_PER_S  # time stamps of the clock `calls` begin here, so that they repeat
MOST_VEHICLES = 200  # after which clients cannot add any
_SETTLED_M = 1e-3  # a vehicle that stands this near the place in its settings is at 0, 0, 0

# The rig of each VehicleType of settings.json that simple_flight does not fly, named as its kind of autopilot.
RIGS = {profile.airsim_type: kind for kind, profile in PROFILES.items() if profile.airsim_type}

Log = Callable[[str], None]
Rigs = Callable[[str], Bench]


class Simulation:
    """Vehicles of one server in one scene. Time moves in `step` alone; `hil.apps.airsim.clock` calls it."""

    def __init__(self, bench: Bench, settings: AirSimSettings, log: Log, rigs: Rigs | None = None) -> None:
        """`bench`: its scene, the model of every multirotor, the start as AirSim's origin, wind, effects and radars.
        `rigs` returns the bench of a rig that ticks every TICK_NS.

        Raises ConfigError for vehicles that cannot start.
        """
        config = bench.config
        self.bench, self._rigs = bench, rigs
        self.scene, self.model, self.settings = bench.scene, bench.vehicle, settings
        self.log = log
        if self.flies and (wrong := unfit(self.model) or uneven(self.model)) is not None:
            message = f"{self.model.name} {wrong[1]}; AirSim has multirotors and cars, and its API flies no plane"
            raise ConfigError.at("vehicle", message, "serve a multirotor, such as vehicle: x500")
        self.large_replies = LargeReplies(log)
        self._effects, self._seed = config.physics.effects, config.noise_seed
        x, y, z = config.start.p_W
        self.frame = NedFrame((x, y, z + self.model.standing_height_m))
        self.earth = Earth(settings.origin, self.frame)
        self.world = SteppedWorld(self.scene, TICK_NS, seed=self._seed, wind=config.wind)
        self.present = PresentWorld(self.world)
        self.objects = Objects(self.present, log)
        self.drones: dict[str, Drone] = {}
        self._push_W_n = ned_from_enu(settings.external_force_n)
        self.frames = Frames(self.world, self.present, self.drones)
        self.surroundings = Surroundings()
        self.radars = Radars(bench, self.frames, self.present_scene)
        self.drawings = Drawings(self.frame, lambda: self.world.t_ns, log)
        self.begin_at(CALLS_EPOCH_NS)
        self.cameras = Cameras(
            settings, self.world, self.frames, self.surroundings, world_frame=self.frame, find_drone=self.drone
        )
        o = settings.origin
        place = {"latitude_deg": o.latitude_deg, "longitude_deg": o.longitude_deg, "altitude_m": o.altitude_m}
        self._site = self.scene.site.model_copy(update=place)
        self.paused = False
        self.recorder = Recorder(
            settings.recording,
            self.cameras,
            self.drones,
            lambda: self.present_scene().weather,
            default=settings.default_vehicle,
            log=log,
        )
        self.files = ClientFiles(lambda: Path("runs"))
        self._starts = Starts(self.scene, self.frame, self.present, on_ground=self.flies, log=log)
        self._until_tick: int | None = None  # end of simContinueForTime
        self._continued = Pending()
        self.wake: Callable[[], None] = lambda: None  # set by the clock: something lets time go on
        self.lock = WorldLock(lambda: self.wake())
        for name, each in settings.vehicles.items():
            self._add(name, each)
        self.default_name = settings.default_vehicle
        if settings.wind_mps != (0.0, 0.0, 0.0):
            self.world.set_wind(ned_from_enu(settings.wind_mps))

    def begin_at(self, epoch_ns: int) -> None:
        """Let the simulated time begin at `epoch_ns`, since 1970; a time of day without a start begins there, too."""
        self.epoch_ns = epoch_ns
        self.surroundings.take_settings(self.settings, epoch_ns)

    @property
    def flies(self) -> bool:
        """False in ComputerVision and with ExternalPhysicsEngine: vehicles only stand where clients put them."""
        return self.settings.sim_mode == "Multirotor" and self.settings.physics_engine != "ExternalPhysicsEngine"

    @property
    def now_ns(self) -> int:
        """Time stamp of the present: nanoseconds since 1970."""
        return self.epoch_ns + self.world.t_ns

    def drone(self, name: str) -> Drone:
        """Return a vehicle; "" is the default one. Raises RpcError with the names that exist."""
        found = self.drones.get(name or self.default_name)
        if found is None:
            known = ", ".join(self.drones)
            raise RpcError(
                f"Vehicle API for '{name}' is not available: this vehicle does not exist. The vehicles are: {known}. "
                "Use one of these names, or add the vehicle to Vehicles of settings.json"
            )
        return found

    def present_scene(self) -> Scene:
        """Return the scene in the present weather: another object after a client changed it."""
        return self.surroundings.present(self.scene)

    def push(self, force_W_n: Vec3) -> None:
        """Set the external force on each vehicle that flies, those that are added later too."""
        self._push_W_n = force_W_n
        for drone in self.drones.values():
            if isinstance(drone.vehicle, FlyingVehicle):
                drone.vehicle.physics.set_push(force_W_n)

    # Time ------------------------------------------------------------------------------------------------------------

    @property
    def continuing(self) -> bool:
        """True while simContinueForTime or simContinueForFrames lets the world run."""
        return self._until_tick is not None

    @property
    def busy(self) -> bool:
        """True while a client waits for simulated time: in a move, or in simContinueForTime."""
        return self.continuing or any(d.flight is not None and d.flight.busy for d in self.drones.values())

    @property
    def runs(self) -> bool:
        """True unless the world is paused, or a long call has it."""
        return (not self.paused or self.continuing) and not self.lock.held

    def continue_for(self, ticks: int) -> Pending:
        """Let the world run for a number of ticks and pause it then."""
        self._end_continuing()
        self._continued = Pending()
        pending = self._continued
        self._until_tick = self.world.tick + ticks
        self.paused = True
        if ticks <= 0:
            self._end_continuing()
        self.wake()
        return pending

    def pause(self, paused: bool) -> None:
        """Pause the world, or let it run. Either ends simContinueForTime."""
        self.paused = paused
        self._end_continuing()
        self.wake()

    def _end_continuing(self) -> None:
        if self._until_tick is not None:
            self._until_tick = None
            self._continued.resolve(None)

    def step(self) -> None:
        """Advance by one tick, or begin to make the world anew that a vehicle needs then."""
        world = self.world
        if self.present.is_near and not self.lock.run(self.present.settle).done:
            return
        world.step()
        for departure in world.take_departures():
            self._depart(departure)
        for drone in self.drones.values():
            truth = drone.vehicle.truth
            drone.past.add(truth)
            if truth.in_contact or drone.touching:
                drone.touch()
            if drone.flight is not None:
                try:
                    drone.flight.observe(truth)
                except Exception as defect:  # noqa: BLE001 (as in `_pilot`)
                    self._stop(drone.name, drone.flight, defect)
        for contact in world.take_contacts():
            for own, other in ((contact.a, contact.b), (contact.b, contact.a)):
                self.drones[own].meet(other, contact)
        if self.recorder.runs:
            self.recorder.observe(world.t_ns, self.now_ns)
        if self._until_tick is not None and world.tick >= self._until_tick:
            self._end_continuing()

    def _depart(self, departure: Departure) -> None:
        """End the move of a vehicle that left the range of the model, and stop its rotors."""
        drone = self.drones[departure.vehicle]
        if drone.departed_ns is None or departure.t_ns - drone.departed_ns > NS_PER_S:
            self.log(f"{departure.message}; {departure.vehicle} was stopped where it was and its move ended")
        drone.departed_ns = departure.t_ns
        if drone.flight is not None:
            drone.flight.cancel()
            drone.flight.armed = False
        self.placed(drone)

    # Vehicles --------------------------------------------------------------------------------------------------------

    def add(self, settings: VehicleSettings) -> Drone:
        """Add a vehicle that a client asked for. Raises RpcError."""
        if settings.name in self.drones:
            raise RpcError(f"there is a vehicle '{settings.name}' already; choose another name")
        if len(self.drones) >= MOST_VEHICLES:
            raise RpcError(f"there are {MOST_VEHICLES} vehicles, as many as there may be")
        return self._add(settings.name, settings)

    def _add(self, name: str, settings: VehicleSettings) -> Drone:
        rig = self._rig_of(name, settings.kind) if self.flies else None
        model = self.model if rig is None else rig.vehicle
        model = model.model_copy(update={"forces": (*model.forces, Push(kind="push"))})
        if settings.collisions and settings.pass_through:
            self.log(f"{name}: a collision stops the vehicle: EnableCollisionPassthrogh has no effect")
        settings, start = self._starts.take(settings, model)
        vehicle: SteppedVehicle
        flight: SimpleFlight | None = None
        if self.flies:
            vehicle = flying = self.world.add(name, model, start, effects=self._effects)
            flying.physics.collides = settings.collisions
            flying.physics.set_push(self._push_W_n)
            origin = self._origin(settings, flying)
            flight = self._flight(name, flying, rig, origin)
            flying.pilot = self._pilot(name, flight)
        else:
            vehicle = self.world.stand(name, model, start, effects=self._effects)
            origin = self._origin(settings, vehicle)
        measured = Measured(
            name,
            self.present_scene,
            self._site,
            self.present,
            altitude_m=lambda p_W: self.earth.geodetic(p_W)[2],
            seen_at=lambda t_ns: self.frames.seen_by(name, t_ns),
            tick_ns=TICK_NS,
        )
        sensors = SensorSuite(dict(settings.sensors), measured)
        drone = Drone(name, settings, vehicle, origin, flight, sensors, Past(vehicle.truth))
        drone.touching = vehicle.truth.in_contact
        if flight is not None:
            flight.landed = drone.touching
        self.drones[name] = drone
        return drone

    def _pilot(self, name: str, flight: SimpleFlight) -> Pilot:
        """Return the pilot of a vehicle: a defect of its controller stops its rotors, and nobody else."""

        def controls(truth: TruthState) -> Sequence[float]:
            try:
                return flight.controls(truth)
            except (ConfigError, LinkError) as error:
                self.log(f"{name}: its autopilot is lost and its rotors stop: {error}")
                flight.close()
                flight.cancel()
                return (0.0,) * len(truth.rotor_speed_radps)
            except Exception as defect:  # noqa: BLE001 (one vehicle ends no other's flight)
                self._stop(name, flight, defect)
                return (0.0,) * len(truth.rotor_speed_radps)

        return controls

    def _stop(self, name: str, flight: SimpleFlight, defect: Exception) -> None:
        self.log(f"{name}: {type(defect).__name__}: {defect} (a defect of the flight controller; its rotors stop)")
        try:
            flight.reset()
        except Exception as error:  # noqa: BLE001 (an autopilot that does not start again ends no other's flight)
            self.log(f"{name}: its autopilot cannot be started again: {error}")

    def _rig_of(self, name: str, kind: str) -> Bench | None:
        """Return the bench whose autopilot flies vehicles of this type; None: simple_flight. Raises ConfigError."""
        if kind not in RIGS:
            return None
        if self._rigs is None:
            raise ConfigError.at(f"Vehicles.{name}.VehicleType", f"{kind} cannot be flown here", "use SimpleFlight")
        rig = self._rigs(RIGS[kind])
        return replace(rig, scene=self.scene.model_copy(update={"site": self._site}))

    def _origin(self, settings: VehicleSettings, vehicle: SteppedVehicle) -> NedFrame:
        """Return the vehicle's NED frame: at the place in its settings, so that differences of frames are exact."""
        x, y, z = self.frame.to_W(settings.position_m)
        p_W = (x, y, z + vehicle.vehicle.standing_height_m - self.model.standing_height_m)
        start_W = vehicle.truth.p_WB
        return NedFrame(start_W if math.dist(p_W, start_W) < _SETTLED_M else p_W)

    def _flight(self, name: str, vehicle: FlyingVehicle, rig: Bench | None, origin: NedFrame) -> SimpleFlight:
        model, gravity, start_W = vehicle.vehicle, self.scene.gravity_mps2, origin.origin_W
        if rig is None:
            thin = 1.0 if vehicle.physics is None else vehicle.physics.density_ratio
            return SimpleFlight(model, TICK_NS, gravity, start_W, density_ratio=thin)
        from hil.apps.airsim.world.rig_flight import RigFlight, RigPilot

        physics = vehicle.physics
        self.log(f"{name}: starting {rig.config.autopilot.kind}")
        return RigFlight(
            model, TICK_NS, gravity, start_W, lambda: RigPilot(rig, physics, lambda text: self.log(f"{name}: {text}"))
        )

    def close(self) -> None:
        """End the autopilots of all vehicles, and a recording."""
        self.recorder.stop()
        for drone in self.drones.values():
            if drone.flight is not None:
                drone.flight.close()

    def reset(self) -> None:
        """Put all vehicles back to their starts; wind and weather stay, and time goes on."""
        self._end_continuing()
        for drone in self.drones.values():
            drone.reset()
        for drone in self.drones.values():  # all are where they will be seen
            self._forget(drone)
        self.wake()

    def placed(self, drone: Drone, *, collides: bool = False) -> None:
        """Take notice that a vehicle was put elsewhere; without physics, find what it touches there."""
        drone.touching, drone.touched = False, ""
        self.present.settle_near()
        if drone.flight is not None:
            if drone.settings.collisions:
                drone.push_out()
            drone.flight.moved()
        elif (
            collides
            and drone.settings.collisions
            and self.settings.sim_mode == "Multirotor"
            and (contact := drone.vehicle.touch()) is not None
        ):
            drone.collide(contact)
        self._forget(drone)

    def _forget(self, drone: Drone) -> None:
        """Forget what was measured and touched on the way of a vehicle that was put elsewhere."""
        self.world.forget_contacts(drone.name)
        drone.past.place(drone.vehicle.truth)
        drone.sensors.forget()
        self.radars.forget(drone.name)
