"""Flight of a vehicle through a scene, one tick at a time.

One tick, from t_{k-1} to t_k, with the commands u held constant:

1. free flight   The native kernel advances the tick (sim/native/free_flight.hpp) as if nothing were near.
2. clearance     If the bounding sphere cannot have reached the scene, this result stands; MuJoCo is not called.
3. collision     Otherwise MuJoCo looks for contacts at every sub-step pose, and in between if a sub-step moves the
                 vehicle farther than the radius of its smallest sphere. Without a contact, the result of 1 stands.
4. contact       Otherwise the tick starts again at t_{k-1} with sub-steps of 1 ms or less: wrench of the forces from
                 the same kernel, contact forces from mj_forward, semi-implicit Euler. MuJoCo's own integrator is not
                 used: its quaternion update calls the C library's sin and cos, whose last bit depends on the CPU.
                 A plane slides without MuJoCo's friction (sim.physics.sliding).
                 A touch-down faster than 2.5 m/s gets shorter sub-steps and stiffer contact until the vehicle is in
                 the air again: feet sink about v T / e in a contact of time constant T (sim.physics.contact_model).

Step 2 skips only work whose result is known, so a flight has the same bits with and without it (a test switches
`Integration.contact_skipping`). The clearance is not computed in every tick: a computed clearance, less the distance
travelled since, is a lower bound. The same holds for moving actors (sim.physics.actors).

Faults and gusts begin at ticks; `take_events` reports them.

Limits of the model: speed 200 m/s, body rate 200 rad/s, 50 km from the site, every value finite, a battery that is not
empty and can deliver the power. Beyond them: ModelRangeError.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals._kernel import TupleReader
from signals.errors import ModelRangeError
from signals.rotation import NO_TURN, norm, quaternion_norm
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_MS
from sim._kernels import IdealController, Launcher, Push, Rotors, SurfacedForce, Wheels
from sim.physics.actors import Actors
from sim.physics.battery import GAS_CONSTANT_J_PER_MOL_K, BatteryState
from sim.physics.contact_model import build_model, set_inertia, soften_contact
from sim.physics.disturbances import Disturbances
from sim.physics.faults import HEALTHY, RotorFault, check_faults
from sim.physics.flight_start import FlightStart
from sim.physics.footing import find_footing
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.launch import LaunchRail
from sim.physics.scene_contact import SceneContact, deepest_contact
from sim.physics.sliding import SlidingContact
from sim.physics.stiffness import too_stiff, too_strong
from sim.physics.surface_faults import SurfaceFault, VehicleFault, check_surface_faults
from sim.physics.vehicle import Vehicle, rigid_body
from sim.scene.atmosphere import SEA_LEVEL_KGPM3
from sim.scene.scene import Scene
from sim.scene.scene_map import Actor
from sim.scene.solids import solid_tree
from sim.scene.wind import GustEvent, Wind, WindAtVehicle
from sim.world_loader import load_world

# Ticks finished, way of a tick flown but not finished or -1, violation, index of a bad command or -1.
Cruise = tuple[int, float, int, int]
HARD_LANDING_MPS = 2.5
NO_MOTION: Vec3 = (0.0, 0.0, 0.0)
_SETTLE_NS, _SETTLE_ON_WHEELS_NS = 500 * NS_PER_MS, 3000 * NS_PER_MS
_MAX_TRAVEL_M = 1.0e6  # a vehicle within the speed limit travels less in a tick; NaN fails the comparison too

_new_tuple = tuple.__new__  # without the calls of a NamedTuple's own

_P, _Q, _V, _W = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
_LIMITS = {
    1: ("state", "finite"),
    2: ("speed_mps", "<= 200 m/s"),
    3: ("body_rate_radps", "<= 200 rad/s"),
    4: ("distance_from_site_m", "<= 50000 m"),
    5: ("battery_voltage_v", "above 0: the pack cannot deliver the power of the rotors"),
    6: ("battery_charge", ">= 0: the pack is empty"),
}


class _Coming(NamedTuple):
    """Event to come; with a fault also what it changes."""

    tick: int
    kind: str
    text: str
    fault: VehicleFault | None = None
    ends: bool = False  # of the fault


class PhysicsEvent(NamedTuple):
    """Fault or gust that began or ended."""

    t_ns: int
    kind: str  # "fault", "gust" or "launch"
    text: str


@dataclass
class ContactSkips:
    """Counts of ticks by the contact work that they took."""

    skipped: int = 0  # nothing near enough to touch: no collision query
    queried: int = 0  # collision query, nothing touched
    touching: int = 0  # contact sub-steps


def check_motion(p_WB: Vec3, q_WB: Quat, v_WB_W: Vec3, w_WB_B: Vec3) -> float:
    """Return the length of the quaternion. Raises ValueError for a state beyond the limits of the model."""
    for name, size, limit in (
        ("p_WB", norm(p_WB), 50.0e3),
        ("v_WB_W", norm(v_WB_W), 200.0),
        ("w_WB_B", norm(w_WB_B), 200.0),
    ):
        if not size <= limit:
            raise ValueError(f"{name} has the size {size:g}, and the model holds up to {limit:g}")
    length = quaternion_norm(q_WB)
    if not 1e-3 <= length <= 1e3:
        raise ValueError(f"q_WB {q_WB} is not a rotation: its length is {length:g}")
    return length


def _check_faults(faults: Sequence[VehicleFault], vehicle: Vehicle) -> None:
    check_faults([fault for fault in faults if isinstance(fault, RotorFault)], vehicle)
    check_surface_faults([fault for fault in faults if isinstance(fault, SurfaceFault)], vehicle)


class VehiclePhysics:
    """Simulation of one vehicle over one flight.

    Raises ValueError if a step does not divide the tick, a fault names a rotor that the vehicle does not have, or the
    battery is switched on and the vehicle has none.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        scene: Scene,
        tick_ns: int,
        *,
        start: FlightStart = FlightStart(),  # noqa: B008 (frozen)
        effects: Effects = Effects(),  # noqa: B008 (frozen)
        disturbances: Disturbances = Disturbances(),  # noqa: B008 (frozen)
        integration: Integration = Integration(),  # noqa: B008 (frozen)
    ) -> None:
        steps = self._steps = integration.steps(tick_ns)
        if effects.battery and vehicle.battery is None:
            raise ValueError(f"effects.battery is on, but the vehicle {vehicle.name!r} has no battery")
        _check_faults(disturbances.faults, vehicle)
        self.vehicle = vehicle
        self.scene = scene
        self._declared = disturbances
        self.tick_ns = tick_ns
        self.contact_skipping = integration.contact_skipping
        self.collides = True  # False: nothing stops the vehicle once it has left the ground where it started
        self.skips = ContactSkips()
        self.touched = False  # in any tick since the caller last cleared it
        self._effects = effects
        self.contact_substeps = steps.contact
        self._hard = False  # contact since a hard touch-down
        self._tick_s = steps.tick_s
        wind = disturbances.wind if disturbances.wind is not None else Wind(steady_W_mps=scene.wind_W_mps)
        self._wind = WindAtVehicle(wind, seed=disturbances.seed, tick_ns=tick_ns)
        self._start = start
        states = 13 + self._make_body(None, self._wind.wind.steady_W_mps)
        self._battery: NDArray[np.float64] | None = None
        if effects.battery and vehicle.battery is not None:
            b = vehicle.battery
            self._battery_capacity_c = 3600.0 * b.capacity_ah
            self._battery_start_c = (1.0 - b.initial_charge) * self._battery_capacity_c
            self._battery_start_degc = 0.0
            if b.thermal is not None:
                ambient_degc, start_degc = self._air_degc(b.thermal.ambient_degc), b.thermal.initial_degc
                self._battery_start_degc = ambient_degc if start_degc is None else start_degc
            self._battery = np.array([self._battery_start_c, 0.0, 0.0, self._battery_start_degc])
            self._fit_battery(b.auxiliary_w)
            if b.thermal is not None:
                self._battery_start_c = (1.0 - b.initial_charge) * self.body.battery_capacity_c()
                self._battery[0] = self._battery_start_c
                self._fit_battery(b.auxiliary_w)
        self._radius_m = vehicle.bounding_radius_m
        self._min_sphere_radius_m = min(sphere.radius_m for sphere in vehicle.contact_spheres)
        self._enter(scene)
        self.start_ns = start.t_ns
        self._rotor_slice = slice(13, 13 + len(vehicle.rotors))  # drag, the force before them, has no states
        self._states = states
        parts = [_P, _Q, _V, _W, slice(states, states + 3), slice(states + 3, states + 6), self._rotor_slice]
        parts += [slice(first, first + force.states) for force, first in self._surfaced]
        reader: Any = TupleReader(self._truth, [(part.start, part.stop) for part in parts])
        self._read_truth = reader.read
        self._tick = -1

        state = self.state
        state[_Q] = vehicle.standing_quat(start.yaw_rad)
        self._standing = start.p_WB is None
        if self._rail is not None:
            state[_P], state[_Q] = self._rail.p_WB, self._rail.q_WB
        elif start.p_WB is None:
            if self._actors is not None:
                self._actors.pose_all(self.start_ns)
            footing = find_footing(self._model, self._data, vehicle, start)
            state[_P], state[_Q] = footing.p_WB, footing.q_WB
            self._settle()
        else:
            state[_P] = start.p_WB
        self.body.touching = self._standing
        self._start_truth = self._truth.copy()
        self._start_warmstart = self._data.qacc_warmstart.copy()
        self._wind_W: Vec3 = self._wind.wind.steady_W_mps
        self._downwash_W: Vec3 | None = None
        self._events: list[PhysicsEvent] = []
        self._pending = self._schedule(disturbances.faults)
        self._next_change = self._pending[-1].tick if self._pending else -1

    def _make_body(self, truth: NDArray[np.float64] | None, wind_W_mps: Vec3) -> int:
        """Make the kernel of the vehicle, on `truth` or on a new array; return the number of its forces' own states."""
        forces = self.vehicle.make_forces(self._effects)
        start = self._start
        self._rail: LaunchRail | None = None
        if start.launch is not None:
            forces.append(launcher := Launcher())
            self._rail = LaunchRail(
                start.launch,
                launcher,
                ground_W=start.ground_W,
                yaw_rad=start.yaw_rad,
                mass_kg=self.vehicle.mass_kg,
                rotors=len(self.vehicle.rotors),
                tick_ns=self.tick_ns,
            )
        self._wheels = [force for force in forces if isinstance(force, Wheels)]
        for wheels in self._wheels:
            wheels.set_ground(start.ground_W[2])
        self._rotors = [force for force in forces if isinstance(force, Rotors)]  # by `Vehicle.rotor_groups`
        self._push = next((force for force in reversed(forces) if isinstance(force, Push)), None)
        rest = self.vehicle.rest_commands
        self._rest = [*rest, *([0.0] * (sum(force.commands for force in forces) - len(rest)))]  # the launcher's
        self._surfaced, own = [], 0
        for force in forces:
            if isinstance(force, SurfacedForce):
                self._surfaced.append((force, 13 + own))
            own += force.states
        self._truth: NDArray[np.float64] = np.zeros(13 + own + 6) if truth is None else truth
        self.body = rigid_body(
            self.vehicle,
            self._truth,
            forces=forces,
            gravity_mps2=self.scene.gravity_mps2,
            wind_W_mps=wind_W_mps,
            steps=self._steps,
            air=self._air,
        )
        self._groups = self.vehicle.rotor_groups
        self._most_radps = [2.0 * constants.max_speed_radps for constants in self.vehicle.constants_of_rotors]
        leading = self.vehicle.leading_group
        self._blades = None if leading is None else leading.blades
        late = [group for group in self._groups if group.constants.dead_time_s > 0.0]
        if late:  # the rotors' commands are the first
            count = sum(len(group.rotors) for group in late)
            self.body.delay_commands(dead_time_s=late[0].constants.dead_time_s, first=late[0].first, count=count)
        return own

    @property
    def _air(self) -> tuple[float, float] | None:
        vehicle = self.vehicle
        thin = vehicle.has_wings or any(group.model != "quadratic" for group in vehicle.rotor_groups)
        if not self._effects.air_density or not thin:
            return None
        return self.scene.site.altitude_m, self.scene.site.warmer_k

    @property
    def density_ratio(self) -> float:
        """Density of the air where the vehicle is over that of its file, as `multirotor.density_ratio` at the site."""
        if self._blades is None:
            return 1.0
        return self.body.density_ratio() * SEA_LEVEL_KGPM3 / self._blades.air_density_kgpm3

    @property
    def state(self) -> NDArray[np.float64]:
        """View of p_WB, q_WB, v_WB_W, w_WB_B and the forces' own states. Write to it only before tick 1."""
        return self._truth[: self._states]

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        """Advance to tick `tick`, 0 first and one higher with each call, and return its state.

        `controls`: commands 0..1, or -1..1 of control surfaces (saturated), held since the previous tick, in the order
        of `Vehicle.commands`; values beyond them are ignored. Tick 0 is the initial state and ignores them.
        Raises ModelRangeError when the vehicle leaves the model's range or a command is not finite.
        """
        if (
            tick in (0, self._next_change)
            or tick != self._tick + 1
            or self._rail is not None
            or self._downwash_W is not None
            or not self._wind.constant
        ):
            return self.finish(self.fly(tick, controls))
        # Nothing but contact can happen: one call of the kernel flies the tick and finishes it.
        self._tick = tick
        done, travelled_m, violation, bad_index = self.body.cruise(controls, 1)
        if bad_index >= 0:
            raise ModelRangeError(tick, f"controls[{bad_index}]", float(controls[bad_index]), "finite")
        if not done:
            return self.finish(self._check_contact(travelled_m))
        self.skips.skipped += 1
        if violation:
            raise self._range_error(tick, violation)
        return self._truth_state(tick, in_contact=False)

    def fly(self, tick: int, controls: Sequence[float]) -> bool:
        """Advance to tick `tick` without completing it; see `advance`. Return True if the vehicle touched the scene."""
        if tick != self._tick + 1:
            raise ValueError(f"tick {tick} after tick {self._tick}: ticks must come in order")
        self._tick = tick
        if tick == 0:
            if not self._wind.constant:
                self._wind_W = self._wind.start(float(self._truth[2]))
            return self._standing
        body = self.body
        if self._downwash_W is not None or not self._wind.constant:
            self._update_wind(tick)
        bad_index = body.command(controls)
        if bad_index >= 0:
            raise ModelRangeError(tick, f"controls[{bad_index}]", float(controls[bad_index]), "finite")
        if self._rail is not None and self._rail.phase != "released":
            return self._fly_on_rail(self._rail, tick, controls)
        travelled_m = body.fly()
        if body.keeps_clear(travelled_m):
            self.skips.skipped += 1
            return False
        return self._check_contact(travelled_m)

    @property
    def launching(self) -> bool:
        """True while a launcher holds or pulls the vehicle."""
        return self._rail is not None and self._rail.phase != "released"

    def _fly_on_rail(self, rail: LaunchRail, tick: int, controls: Sequence[float]) -> bool:
        began = rail.begin(tick, [float(control) for control in controls])
        self.body.fly()
        ended = rail.keep(self.state)
        self._events += [PhysicsEvent(tick * self.tick_ns, "launch", text) for text in (began, ended) if text]
        self.body.remaining_m = 0.0
        if self._actors is not None:
            self.body.actors_remaining_m = 0.0
        return rail.phase != "released"

    @property
    def cruises(self) -> bool:
        """True if `cruise_flights` may fly the coming ticks: nothing but contact can happen in them."""
        return (
            not self.launching
            and self._next_change < 0
            and self._downwash_W is None
            and self._wind.constant
            and self._tick >= 0
        )

    def cruised(self, ticks: int) -> None:
        """Take notice of ticks that `cruise_flights` has flown, all that were asked for."""
        self._tick += ticks
        self.skips.skipped += ticks

    def hold(self, controls: Sequence[float] | IdealController, ticks: int, cruised: Cruise | None = None) -> None:
        """Advance by `ticks` ticks: the bits of `advance`, without the states in between.

        `controls`: the same commands in all ticks, or the native controller that makes them. `cruised`: what
        `cruise_flights` has flown of them. Raises ModelRangeError at the tick at which `advance` would.
        """
        body, last = self.body, self._tick + ticks
        while self._tick < last:
            if cruised is None:
                coming = last if self._next_change < 0 else min(last, self._next_change - 1)
                single = self._downwash_W is not None or not self._wind.constant or self.launching
                if single or coming <= self._tick or self._tick < 0:
                    commands = self._commanded(controls) if isinstance(controls, IdealController) else controls
                    self._complete(self.fly(self._tick + 1, commands))
                    continue
                cruised = body.cruise(controls, coming - self._tick)
            done, travelled_m, violation, bad = cruised
            cruised = None
            self._tick += done
            self.skips.skipped += done
            if violation:
                raise self._range_error(self._tick, violation)
            if bad >= 0:
                value = math.nan if isinstance(controls, IdealController) else float(controls[bad])
                raise ModelRangeError(self._tick + 1, f"controls[{bad}]", value, "finite")
            if travelled_m >= 0.0 or travelled_m != travelled_m:  # a tick that may touch, or left the range
                self._tick += 1
                self._complete(self._check_contact(travelled_m))

    def _commanded(self, controller: IdealController) -> Sequence[float]:
        t = self.truth
        return controller.commands(
            t.p_WB, t.q_WB, t.v_WB_W, t.w_WB_B, t.a_WB_W, t.alpha_WB_B, t.rotor_speed_radps, t.in_contact
        )

    def attach(self, data: mujoco.MjData | None = None, row: int = 0) -> None:
        """Compute contact in `data`, as its free joint `row`; by default in the model of this vehicle alone."""
        data = self._data if data is None else data
        p, v = slice(7 * row, 7 * row + 7), slice(6 * row, 6 * row + 6)
        self.body.attach(data.qpos[p], data.qvel[v], data.qfrc_applied[v], data.qacc[v])

    def set_downwash(self, wind_W_mps: Vec3) -> None:
        """Set the wind that other vehicles add at the next tick and from then on."""
        self._downwash_W = wind_W_mps

    def rewind(self) -> None:
        """Return to the previous tick, to repeat this one in contact with other vehicles."""
        self.body.rewind()
        self.body.remaining_m = 0.0
        if self._actors is not None:
            self.body.actors_remaining_m = 0.0

    def finish(self, touching: bool) -> TruthState:
        """Complete the tick of `fly` and return its state. Raises ModelRangeError."""
        self._complete(touching)
        return self._truth_state(self._tick, touching)

    def _complete(self, touching: bool) -> None:
        tick = self._tick
        if tick > 0:
            self.body.touching = touching
            self.touched |= touching
            violation = self.body.finish()
            if violation:
                raise self._range_error(tick, violation)
        if tick == self._next_change:
            self._begin_events(tick)

    @property
    def truth(self) -> TruthState:
        """State at the last complete tick, or where the vehicle was placed since."""
        return self._truth_state(max(self._tick, 0), self.body.touching)

    def place(
        self,
        p_WB: Vec3,
        q_WB: Quat = NO_TURN,
        v_WB_W: Vec3 = NO_MOTION,
        w_WB_B: Vec3 = NO_MOTION,
        rotor_speed_radps: Sequence[float] | None = None,
    ) -> TruthState:
        """Move the vehicle to another state between two ticks, and return it; by default the rotors stand still.

        From here the flight has the bits of a new object with this state, as far as wind, faults and battery are the
        same: these go on. Raises ValueError for a state beyond the limits of the model, and changes nothing then.
        """
        rotors = [0.0] * len(self.vehicle.rotors) if rotor_speed_radps is None else list(rotor_speed_radps)
        length = check_motion(p_WB, q_WB, v_WB_W, w_WB_B)
        if len(rotors) != len(self.vehicle.rotors) or not all(speed >= 0.0 for speed in rotors):
            raise ValueError(
                f"rotor_speed_radps needs a speed of 0 or more for each of {len(self.vehicle.rotors)} rotors"
            )
        for speed_radps, most_radps in zip(rotors, self._most_radps, strict=True):
            if not speed_radps <= most_radps:
                raise ValueError(f"rotor_speed_radps has {speed_radps:g}; the model holds up to {most_radps:g}")
        if self._rail is not None:
            self._rail.let_go()
        self._truth[:] = 0.0
        self._truth[_P], self._truth[_Q] = p_WB, [x / length for x in q_WB]
        self._truth[_V], self._truth[_W], self._truth[self._rotor_slice] = v_WB_W, w_WB_B, rotors
        self._data.qacc_warmstart[:] = 0.0
        return self._placed(touching=False)

    def reset(self) -> TruthState:
        """Return the vehicle to its start between two ticks, with a full battery, as a new object begins."""
        self._truth[:] = self._start_truth
        if self._rail is not None:
            self._rail.reset()
        self._data.qacc_warmstart[:] = self._start_warmstart
        if self._battery is not None and self.vehicle.battery is not None:
            self._battery[:] = (self._battery_start_c, 0.0, 0.0, self._battery_start_degc)
            self._fit_battery(self.vehicle.battery.auxiliary_w)
        return self._placed(touching=self._standing)

    def restart(self, seed: int) -> TruthState:
        """Return to tick 0 and to the start, as a new object with this seed of the disturbances begins.

        Injected faults and gusts and a wind that was set are forgotten. Placed elsewhere (`place`) before the first
        tick, the vehicle has the bits of a new object that was placed.
        """
        wind, self._tick, self._downwash_W = self._declared.wind or Wind(steady_W_mps=self.scene.wind_W_mps), 0, None
        self._wind = WindAtVehicle(wind, seed=seed, tick_ns=self.tick_ns)
        self._wind_W = wind.steady_W_mps
        self.body.set_wind(self._wind_W, self._wind_W)
        self.body.repair()
        self._events.clear()
        self._pending = self._schedule(self._declared.faults)
        self._next_change = self._pending[-1].tick if self._pending else -1
        truth = self.reset()
        if not self._wind.constant:
            self._wind_W = self._wind.start(float(self._truth[2]))
        if self._next_change == 0:
            self._begin_events(0)
        return truth

    def become(self, vehicle: Vehicle) -> None:
        """Be a vehicle with another mass, inertia, rotor constants or drag, and the shapes of this one.

        Call it only before `restart`. It starts where this one does: a heavier vehicle then settles by micrometres.
        Raises ValueError for another number of rotors or other contact spheres.
        """
        old = self.vehicle
        if (len(vehicle.rotors), vehicle.contact_spheres) != (len(old.rotors), old.contact_spheres):
            raise ValueError(f"{vehicle.name}: a vehicle becomes one of its own shape only")
        self.vehicle, actors_m, approach_m = vehicle, self.body.actors_remaining_m, self.body.approach_m
        self._make_body(self._truth, self._wind_W)
        self.body.actors_remaining_m, self.body.approach_m = actors_m, approach_m
        if self._battery is not None:
            self._fit_battery(0.0 if vehicle.battery is None else vehicle.battery.auxiliary_w)
        set_inertia(self._model, self._data, vehicle)
        self._sliding = self._sliding_contact()
        self.attach(self._data)

    def join(self, tick: int) -> TruthState:
        """Let a new object take part in a group that has completed tick `tick`."""
        if self._tick != -1:
            raise ValueError(f"only a vehicle that has not flown can join; this one is at tick {self._tick}")
        self.fly(0, ())
        self._tick = tick
        return self.truth

    def _placed(self, *, touching: bool) -> TruthState:
        """Forget what was known of the way so far."""
        self.body.touching = touching
        self.body.forget_commands()
        self.hard = False
        self.body.remaining_m = 0.0
        if self._actors is not None:
            self.body.actors_remaining_m = 0.0
        return self.truth

    @property
    def on_wheels(self) -> bool:
        """True if a wheel carried load at the end of the last tick."""
        return any(load > 0.0 for wheels in self._wheels for load in wheels.loads_n)

    def contact(self) -> SceneContact | None:
        """Return the deepest contact with the scene in the last contact step; None if there was none."""
        return deepest_contact(self._model, self._data, self.scene)

    def touch(self, t_ns: int) -> SceneContact | None:
        """Return the deepest contact with the scene at `t_ns` where the vehicle is now; None if it touches nothing."""
        if self._actors is not None:
            self._actors.pose_all(t_ns)
            self.body.actors_remaining_m = 0.0
        self.body.contact_load(0, self._hard)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        return self.contact()

    def _fit_battery(self, auxiliary_w: float) -> None:
        battery = self.vehicle.battery
        assert battery is not None
        assert self._battery is not None
        thermal = battery.thermal
        if thermal is not None:
            self.body.fit_battery_thermal(
                cells_ohm=battery.resistance_ohm - thermal.leads_ohm,
                leads_ohm=thermal.leads_ohm,
                reference_degc=thermal.reference_degc,
                activation_k=thermal.activation_j_per_mol / GAS_CONSTANT_J_PER_MOL_K,
                heat_capacity_j_per_k=thermal.heat_capacity_j_per_k,
                cooling_w_per_k=thermal.cooling_w_per_k,
                ambient_degc=self._air_degc(thermal.ambient_degc),
                table_degc=[degc for degc, _ in thermal.capacity_share],
                table_share=[share for _, share in thermal.capacity_share],
            )
        self.body.fit_battery(
            battery=self._battery,
            cells=float(battery.cells),
            capacity_c=self._battery_capacity_c,
            resistance_ohm=battery.resistance_ohm,
            efficiency=battery.efficiency,
            auxiliary_w=auxiliary_w,
            nominal_voltage_v=battery.nominal_voltage_v,
        )

    def _air_degc(self, given_degc: float | None) -> float:
        """Return the temperature of the air at the battery: the given one, else that of the site."""
        return self.scene.site.air_degc if given_degc is None else given_degc

    def surround(self, scene: Scene) -> None:
        """Fly in another scene from the next tick on; its gravity and friction must be the same. The state stays."""
        warmstart = self._data.qacc_warmstart.copy()
        self.scene = scene
        self._enter(scene)
        self._data.qacc_warmstart[:] = warmstart

    def actor_changed(self, actor: Actor, t_ns: int) -> None:
        """Take notice that an actor that rests was put elsewhere at `t_ns`."""
        if self._actors is not None:
            self._actors.changed(actor, t_ns)
            self.body.actors_remaining_m = 0.0

    def _enter(self, scene: Scene) -> None:
        """Make the model of contact with a scene."""
        self._model = build_model(scene, self.vehicle, contact_step_s=self._tick_s / self.contact_substeps[self._hard])
        self._data = mujoco.MjData(self._model)
        self._sliding = self._sliding_contact()
        self.attach(self._data)
        world = load_world(scene)
        self._solids = solid_tree(world)
        self.body.remaining_m = 0.0
        self._actors: Actors | None = None
        self.body.actors_remaining_m = math.inf
        self.body.approach_m = 0.0
        if world.map.actors:
            self._actors = Actors(world, self._model, self._data, radius_m=self._radius_m, tick_ns=self.tick_ns)
            self.body.actors_remaining_m, self.body.approach_m = 0.0, self._actors.approach_m

    def _sliding_contact(self) -> SlidingContact | None:
        if not self.vehicle.has_wings:  # only wings land at flying speed
            return None
        return SlidingContact(self.vehicle, self._model, self._data, friction=self.scene.ground_friction)

    def switch_off(self) -> None:
        """Switch off everything but the rotors, so that a vehicle that only lies there does not empty its battery."""
        if self._battery is not None:
            self._fit_battery(0.0)

    def end_battery(self) -> None:
        """Let an empty battery deliver nothing from now on, until `reset`; its vehicle stays within the model."""
        if self._battery is not None:
            self._battery[:3] = (self.body.battery_capacity_c(), 0.0, 0.0)
            self.switch_off()

    @property
    def battery(self) -> BatteryState | None:
        """State of the battery; None without one."""
        if self._battery is None:
            return None
        drawn_c, voltage_v, current_a, degc = self._battery.tolist()
        thermal = self.vehicle.battery is not None and self.vehicle.battery.thermal is not None
        charge = 1.0 - drawn_c / self.body.battery_capacity_c()
        return BatteryState(charge, voltage_v, current_a, degc if thermal else None)

    @property
    def actor_poses(self) -> tuple[int, int]:
        """Poses of actors computed so far, and their number if every actor were posed at every tick."""
        if self._actors is None:
            return 0, 0
        return self._actors.posed, max(self._tick, 0) * self._actors.count

    @property
    def wind_W_mps(self) -> Vec3:
        """Wind at the vehicle at this tick [m/s in W]."""
        return self._wind_W

    def take_events(self) -> list[PhysicsEvent]:
        """Return the faults and gusts that began or ended since the last call, in order."""
        events, self._events = self._events, []
        return events

    def set_steady_wind(self, wind_W_mps: Vec3) -> None:
        """Set the steady wind from the next tick on; turbulence and gusts come on top as before."""
        self._wind.set_steady(wind_W_mps)
        if self._wind.constant and self._downwash_W is None:
            self._wind_W = wind_W_mps
            self.body.set_wind(wind_W_mps, wind_W_mps)

    def set_push(self, force_W_n: Vec3) -> None:
        """Set the force of the vehicle's last entry `push` from the next tick on. Raises ValueError without one."""
        if self._push is None:
            raise ValueError(f"the vehicle {self.vehicle.name!r} has no force of kind push")
        self._push.set(force_W_n)

    def set_turbulence(self, wind_20ft_mps: float) -> None:
        """Change the strength of the turbulence over a second, from the next tick on; see `WindAtVehicle`."""
        self._wind.set_turbulence(wind_20ft_mps, self._tick)

    def inject(self, disturbance: VehicleFault | GustEvent) -> None:
        """Add a fault or gust during the flight.

        Raises ValueError if it would begin before the next tick, or names a rotor that does not exist.
        """
        if isinstance(disturbance, GustEvent):
            events = [_Coming(event.tick, "gust", event.text) for event in self._wind.add(disturbance)]
        else:
            _check_faults((disturbance,), self.vehicle)
            events = self._of_fault(disturbance)
        if events[0].tick <= self._tick:
            raise ValueError(f"{events[0].text}: begins at tick {events[0].tick}, and tick {self._tick} is over")
        # `_pending` ends with the next event; within a tick, events keep the order in which they were added.
        self._pending = sorted([*self._pending[::-1], *events], key=lambda item: item.tick)[::-1]
        self._next_change = self._pending[-1].tick

    def _of_fault(self, fault: VehicleFault) -> list[_Coming]:
        events = [_Coming(fault.start_tick(self.tick_ns), "fault", fault.text, fault)]
        if isinstance(fault, RotorFault) and (end := fault.end_tick(self.tick_ns)) is not None:
            events.append(_Coming(end, "fault", fault.end_text, fault, ends=True))
        return events

    def _schedule(self, faults: Sequence[VehicleFault]) -> list[_Coming]:
        """Return all events to come, the next one last."""
        self._faulty: dict[int, RotorFault] = {}  # the fault of each rotor that has one
        events = [event for fault in faults for event in self._of_fault(fault)]
        events += [_Coming(event.tick, "gust", event.text) for event in self._wind.events()]
        return sorted(events, key=lambda item: item.tick)[::-1]  # sorted() is stable: within a tick, in the given order

    def _begin_events(self, tick: int) -> None:
        while self._pending and self._pending[-1].tick == tick:
            _, kind, text, fault, ends = self._pending.pop()
            if isinstance(fault, RotorFault):
                if ends and self._faulty.get(fault.rotor) is not fault:
                    continue  # a later fault has replaced it
                self._break_rotor(fault, ends=ends)
            elif fault is not None:
                self._break_surface(fault)
            self._events.append(PhysicsEvent(tick * self.tick_ns, kind, text))
        self._next_change = self._pending[-1].tick if self._pending else -1

    def _break_rotor(self, fault: RotorFault, *, ends: bool) -> None:
        self._faulty[fault.rotor] = fault
        for group, rotors in zip(self._groups, self._rotors, strict=True):
            if fault.rotor not in group.indices:
                continue
            rotors.set_rotor(fault.rotor - group.first, *(HEALTHY if ends else fault.rotor_state))
            if group.constants.motor is not None:
                rotors.set_driven(fault.rotor - group.first, driven=ends or fault.driven)

    def _break_surface(self, fault: SurfaceFault) -> None:
        force, index, place = self._surface(fault.surface)
        force.set_surface(index, fault.state, fault.stuck_rad(float(self._truth[place])))
        tilt = next((tilt for tilt in self.vehicle.tilts if tilt.name == fault.surface), None)
        if tilt is not None and fault.kind == "lost":  # its rotors with it
            for group, rotors in zip(self._groups, self._rotors, strict=True):
                for i in set(tilt.rotors) & set(group.indices):
                    rotors.set_rotor(i - group.first, 0.0, 0.0, 0.0)

    def _surface(self, name: str) -> tuple[SurfacedForce, int, int]:
        """Return the force of a surface, the surface's index in it, and its place in the state."""
        names = [servo.name for servo in self.vehicle.servos]
        index = names.index(name)
        for force, first in self._surfaced:
            if index < force.states:
                return force, index, first + index
            index -= force.states
        raise AssertionError(name)  # every surface belongs to a force

    def _update_wind(self, tick: int) -> None:
        previous_W = self._wind_W
        s = self._truth[2:10].tolist()
        self._wind_W = self._wind.at(tick, s[0], (s[5], s[6], s[7]))
        if self._downwash_W is not None:
            (x, y, z), (dx, dy, dz) = self._wind_W, self._downwash_W
            self._wind_W = (x + dx, y + dy, z + dz)
        self.body.set_wind(previous_W, self._wind_W)

    def _check_contact(self, travelled_m: float) -> bool:
        """Compute a used-up clearance anew; if it is too small, ask MuJoCo for contacts. Return True if any touched."""
        if not self.collides and not self.body.touching:
            self.body.remaining_m = self.body.actors_remaining_m = math.inf
            return False
        left_m, actors_left_m = self.body.remaining_m, self.body.actors_remaining_m
        self.body.remaining_m = 0.0
        if self._actors is not None:
            self.body.actors_remaining_m = 0.0
        if not travelled_m < _MAX_TRAVEL_M:
            return False  # out of the model's range: the check of this tick ends the run
        actors = self._actors
        t_ns = self.start_ns + self._tick * self.tick_ns
        if self.contact_skipping:
            if not travelled_m < left_m:
                left_m = self.body.clearance_before(self._radius_m, self._solids)
            if actors is not None and not travelled_m < actors_left_m:
                actors_left_m = actors.gap_m(self.body.position_before(), t_ns, travelled_m)
                actors.pose_near(t_ns)
            elif actors is not None:
                actors.park_all()
            if travelled_m < left_m and travelled_m < actors_left_m:
                self.body.remaining_m = left_m - travelled_m
                self.body.actors_remaining_m = actors_left_m - (travelled_m + self.body.approach_m)
                self.skips.skipped += 1
                return False
        elif actors is not None:
            actors.pose_all(t_ns)
        if not self._touches():
            self.skips.queried += 1
            if travelled_m < left_m:
                self.body.remaining_m = left_m - travelled_m
            if travelled_m < actors_left_m:
                self.body.actors_remaining_m = actors_left_m - (travelled_m + self.body.approach_m)
            return False
        self.skips.touching += 1
        self.body.rewind()
        if not self.body.touching:
            self.hard = self.surface_speed_mps > HARD_LANDING_MPS
        return self._contact_steps()

    @property
    def was_touching(self) -> bool:
        """True if the vehicle touched anything in the last complete tick."""
        return self.body.touching

    @property
    def surface_speed_mps(self) -> float:
        """Upper bound of the speed of any contact sphere."""
        s = self._truth[7:13].tolist()
        speed = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        return speed + self._radius_m * math.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])

    @property
    def hard(self) -> bool:
        """True from a hard touch-down until the next touch-down: short contact steps, stiff contact."""
        return self._hard

    @hard.setter
    def hard(self, hard: bool) -> None:
        if hard != self._hard:
            self._hard = hard
            soften_contact(self._model, self._tick_s / self.contact_substeps[hard])

    def _touches(self) -> bool:
        model, data, body = self._model, self._data, self.body
        for step in range(body.steps()):
            queries = max(1, math.ceil(body.way_in_substep(step) / self._min_sphere_radius_m))
            for query in range(queries):
                body.pose_in_substep(step, (query + 1) / queries)
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)
                if data.ncon:
                    return True
        return False

    def _contact_steps(self) -> bool:
        model, data, body = self._model, self._data, self.body
        load, update, forward, sliding = body.contact_load, body.contact_update, mujoco.mj_forward, self._sliding
        touched, hard = False, self._hard
        substeps = self.contact_substeps[hard]
        for substep in range(substeps):
            load(substep, hard)
            if sliding is None:
                forward(model, data)
            else:
                sliding.forward(self._truth, self._radius_m, self._tick_s / substeps)
            touched = touched or data.ncon > 0
            update(hard)
        return touched

    def _settle(self) -> None:
        """Let the feet settle to their depth (about 10 um) with rotors stopped, so that the flight starts at rest."""
        self.body.command(self._rest)
        settle_ns = _SETTLE_ON_WHEELS_NS if self._wheels else _SETTLE_NS
        for _ in range(-(-settle_ns // self.tick_ns)):
            self._contact_steps()
        self._truth[self._rotor_slice] = 0.0  # wind turns a rotor with a motor
        self._truth[_V] = 0.0
        self._truth[_W] = 0.0

    def _truth_state(self, tick: int, in_contact: bool) -> TruthState:
        p, q, v, w, a, alpha, rotors, *surfaces = self._read_truth()
        in_contact = in_contact or (bool(self._wheels) and self.on_wheels)
        deflections = tuple(chain.from_iterable(surfaces)) if surfaces else ()
        return _new_tuple(
            TruthState, (tick, tick * self.tick_ns, p, q, v, w, a, alpha, rotors, in_contact, deflections)
        )

    def _range_error(self, tick: int, violation: int) -> ModelRangeError:
        variable, limit = _LIMITS[violation]
        values = self._truth.tolist()
        battery = self.battery
        if battery is not None and violation in (5, 6):
            return ModelRangeError(tick, variable, battery.voltage_v if violation == 5 else battery.charge, limit)
        self.body.rewind()
        cause = too_stiff(self.vehicle, self._steps, self.state[_V].tolist(), self._wind_W)
        cause = cause or too_strong(self.vehicle, self._steps, 200.0, 200.0) or ""
        if violation == 1:
            index = next(i for i, value in enumerate(values) if not -1e300 < value < 1e300)
            return ModelRangeError(tick, f"{variable}[{index}]", values[index], limit, cause=cause)
        start = {2: _V, 3: _W, 4: _P}[violation].start
        x, y, z = values[start : start + 3]
        return ModelRangeError(tick, variable, float(np.sqrt(x * x + y * y + z * z)), limit, cause=cause)
