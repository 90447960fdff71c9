"""Flies a multirotor through a scene, one tick at a time.

One tick, from t_{k-1} to t_k, with the commands u held constant:

1. free flight   the native kernel takes the tick (sim/native/free_flight.hpp) as if nothing were near.
2. clearance     if the bounding sphere cannot have reached the scene, that is the answer: MuJoCo is not asked.
3. collision     otherwise MuJoCo looks for contacts at every sub-step pose, and in between where a sub-step goes
                 farther than the smallest sphere's radius. None: the answer of 1 stands.
4. contact       otherwise back to t_{k-1}, and sub-steps of 1 ms or less: rotor and air wrench from the same kernel,
                 contact forces from mj_forward, semi-implicit Euler. MuJoCo's own integrator is not used: its
                 quaternion update calls the C library's sin and cos, whose last bit depends on the CPU.
                 What touches down faster than 2.5 m/s gets shorter sub-steps and stiffer contact until it is in the
                 air again: depth is about v T / e for a contact of time constant T (sim.scene.mjcf).

Step 2 only ever skips work whose outcome is known, so flights with and without it are the same bits
(`contact_skipping=False` has the test). It needs the scene only now and then: a clearance once computed stays a lower
bound until the vehicle has travelled that far. Likewise with what moves in the scene (sim.physics.actors).

Faults and gusts take hold at ticks; what happened is told by `take_events`.

Limits of the model: speed 200 m/s, body rate 200 rad/s, 50 km from the site, all finite, a battery that is not empty
and can deliver; outside, ModelRangeError.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.signals._kernel import det_cos, det_sin
from hil.signals.errors import ModelRangeError
from hil.signals.samples import TruthState, Vec3
from hil.signals.time import NS_PER_MS, NS_PER_S
from sim.physics.actors import Actors
from sim.physics.faults import RotorFault, check_faults
from sim.physics.vehicle import BatteryState, Effects, Vehicle, rigid_body
from sim.scene.mjcf import build_model, soften_contact
from sim.scene.scene import Scene
from sim.scene.solids import solid_tree
from sim.scene.wind import GustEvent, Wind, WindAtVehicle
from sim.scene.world import load_world

# Upper bounds of a free-flight step; the error they leave: `hil bench physics`.
FREE_STEP_NS = {"order8": 4 * NS_PER_MS, "classical": 1 * NS_PER_MS}
CONTACT_STEP_NS = 1 * NS_PER_MS  # upper bound
HARD_CONTACT_STEP_NS = NS_PER_MS // 5  # upper bound, after a hard touch-down
HARD_LANDING_MPS = 2.5
_SETTLE_NS = 500 * NS_PER_MS
_LOST_M = 1.0e6  # no vehicle within the speed limit goes so far in a tick; NaN fails the comparison

_P, _Q, _V, _W = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
_LIMITS = {
    1: ("state", "finite"),
    2: ("speed_mps", "<= 200 m/s"),
    3: ("body_rate_radps", "<= 200 rad/s"),
    4: ("distance_from_site_m", "<= 50000 m"),
    5: ("battery_voltage_v", "above 0: the pack cannot deliver what the rotors draw"),
    6: ("battery_charge", ">= 0: the pack is empty"),
}


class PhysicsEvent(NamedTuple):
    """Something that the flight was told to undergo."""

    t_ns: int
    kind: str  # "fault" or "gust"
    text: str


@dataclass
class ContactSkips:
    """Ticks by what they cost."""

    skipped: int = 0  # out of reach: no collision query
    queried: int = 0  # collision query, nothing touched
    touching: int = 0  # contact sub-steps


class QuadrotorPhysics:
    """Vehicle state over time. Owns all memory it works in; one instance is one flight.

    Starts level at `initial_yaw_rad` (counter-clockwise from east), rotors stopped, at rest: standing settled on the
    ground at W's origin, or at `initial_p_WB` if given.

    `start_ns`: the scene's time at tick 0, for what moves in it.

    `wind`: default the scene's steady wind; `seed` is that of its turbulence. `method`: Runge-Kutta of
    order 8, or the classical one of order 4. `step_ns`: upper bound of a free-flight step, which must divide the tick;
    default 4 ms (classical: 1 ms) or the next shorter that divides. Raises ValueError where a step
    does not divide, a fault names a rotor that is not there, or the battery is asked for and there is none.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        scene: Scene,
        tick_ns: int,
        *,
        contact_skipping: bool = True,
        initial_p_WB: Vec3 | None = None,
        initial_yaw_rad: float = 0.0,
        start_ns: int = 0,
        effects: Effects = Effects(),  # noqa: B008 (frozen)
        faults: Sequence[RotorFault] = (),
        wind: Wind | None = None,
        seed: int = 1,
        method: Literal["order8", "classical"] = "order8",
        step_ns: int | None = None,
    ) -> None:
        if tick_ns <= 0:
            raise ValueError(f"tick_ns must be above 0, not {tick_ns}")
        if step_ns is not None and (step_ns <= 0 or tick_ns % step_ns):
            raise ValueError(f"step_ns {step_ns} does not divide the tick of {tick_ns} ns")
        if effects.battery and vehicle.battery is None:
            raise ValueError(f"effects.battery is on, but the vehicle {vehicle.name!r} has no battery")
        check_faults(faults, len(vehicle.rotors))
        self.vehicle = vehicle
        self.scene = scene
        self.tick_ns = tick_ns
        self.contact_skipping = contact_skipping
        self.skips = ContactSkips()
        rotors = len(vehicle.rotors)
        self._contact_substeps = (-(-tick_ns // CONTACT_STEP_NS), -(-tick_ns // HARD_CONTACT_STEP_NS))
        self._hard = False  # contact since a hard touch-down
        tick_s = self._tick_s = tick_ns / NS_PER_S
        self._wind = WindAtVehicle(
            wind if wind is not None else Wind(steady_W_mps=scene.wind_W_mps), seed=seed, tick_ns=tick_ns
        )
        self._truth: NDArray[np.float64] = np.zeros(13 + rotors + 6)
        self._body = rigid_body(
            vehicle,
            self._truth,
            effects=effects,
            gravity_mps2=scene.gravity_mps2,
            wind_W_mps=self._wind.wind.steady_W_mps,
            tick_s=tick_s,
            substeps=tick_ns // step_ns if step_ns is not None else -(-tick_ns // FREE_STEP_NS[method]),
            classical=method == "classical",
            contact_substeps=self._contact_substeps,
        )
        self._battery: NDArray[np.float64] | None = None
        if effects.battery and vehicle.battery is not None:
            b = vehicle.battery
            self._battery_capacity_c = 3600.0 * b.capacity_ah
            self._battery_start_c = (1.0 - b.initial_charge) * self._battery_capacity_c
            self._battery = np.array([self._battery_start_c, 0.0, 0.0])
            self._body.fit_battery(
                battery=self._battery,
                cells=float(b.cells),
                capacity_c=self._battery_capacity_c,
                resistance_ohm=b.resistance_ohm,
                efficiency=b.efficiency,
                auxiliary_w=b.auxiliary_w,
                nominal_voltage_v=b.nominal_voltage_v,
            )
        self._model = build_model(scene, vehicle, contact_step_s=tick_s / self._contact_substeps[False])
        self._data = mujoco.MjData(self._model)
        self._body.attach(self._data.qpos, self._data.qvel, self._data.qfrc_applied, self._data.qacc)
        world = load_world(scene)
        self._solids = solid_tree(world)
        self._radius_m = vehicle.bounding_radius_m
        self._finest_m = min(sphere.radius_m for sphere in vehicle.contact_spheres)
        self._remaining_m = 0.0
        self._actors: Actors | None = None
        self._actors_remaining_m = math.inf
        self._approach_m = 0.0
        if world.map.actors:
            self._actors = Actors(world, self._model, self._data, radius_m=self._radius_m, tick_ns=tick_ns)
            self._actors_remaining_m, self._approach_m = 0.0, self._actors.approach_m
        self.start_ns = start_ns
        self._rotor_slice = slice(13, 13 + rotors)
        self._a_slice = slice(13 + rotors, 16 + rotors)
        self._alpha_slice = slice(16 + rotors, 19 + rotors)
        self._tick = -1

        state = self.state
        state[_Q] = (det_cos(0.5 * initial_yaw_rad), 0.0, 0.0, det_sin(0.5 * initial_yaw_rad))
        self._standing = initial_p_WB is None
        if initial_p_WB is None:
            state[2] = vehicle.standing_height_m
            self._settle()
        else:
            state[_P] = initial_p_WB
        self._was_touching = self._standing
        self._wind_W: Vec3 = self._wind.wind.steady_W_mps
        self._events: list[PhysicsEvent] = []
        self._to_come = self._schedule(faults)
        self._next_change = self._to_come[-1][0] if self._to_come else -1

    @property
    def state(self) -> NDArray[np.float64]:
        """View of p_WB, q_WB, v_WB_W, w_WB_B, rotor speeds (13 + rotors). Write to it only before tick 1."""
        return self._truth[: self._rotor_slice.stop]

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        """State at tick `tick`, which must be 0 first and then one more each call.

        `controls`: commands 0..1 (saturated) held since the tick before, in the vehicle's rotor order; more values
        than rotors are ignored. Tick 0 is the initial state and ignores them.
        Raises ModelRangeError when the vehicle leaves the model's range or a command is not finite.
        """
        if tick != self._tick + 1:
            raise ValueError(f"tick {tick} after tick {self._tick}: ticks must come in order")
        self._tick = tick
        if tick == 0:
            if not self._wind.constant:
                self._wind_W = self._wind.start(float(self._truth[2]))
            if self._next_change == 0:
                self._take_hold(0)
            return self._truth_state(tick, self._standing)
        body = self._body
        if not self._wind.constant:
            self._blow(tick)
        bad = body.command(controls)
        if bad >= 0:
            raise ModelRangeError(tick, f"controls[{bad}]", float(controls[bad]), "finite, 0..1")
        travelled_m = body.fly()
        touching = False
        if travelled_m < self._remaining_m and travelled_m < self._actors_remaining_m:
            self._remaining_m -= travelled_m
            self._actors_remaining_m -= travelled_m + self._approach_m
            self.skips.skipped += 1
        else:
            touching = self._near_scene(travelled_m)
        self._was_touching = touching
        violation = body.finish()
        if violation:
            raise self._range_error(tick, violation)
        if tick == self._next_change:
            self._take_hold(tick)
        return self._truth_state(tick, touching)

    @property
    def battery(self) -> BatteryState | None:
        """The battery now; None without one."""
        if self._battery is None:
            return None
        drawn_c, voltage_v, current_a = self._battery.tolist()
        return BatteryState(1.0 - drawn_c / self._battery_capacity_c, voltage_v, current_a)

    @property
    def actor_poses(self) -> tuple[int, int]:
        """Poses of actors that were computed so far, and what they would be with every actor posed at every tick."""
        if self._actors is None:
            return 0, 0
        return self._actors.posed, max(self._tick, 0) * self._actors.count

    @property
    def wind_W_mps(self) -> Vec3:
        """The wind at the vehicle at this tick [m/s in W]."""
        return self._wind_W

    def take_events(self) -> list[PhysicsEvent]:
        """Faults and gusts that began or ended since the last call, in order."""
        events, self._events = self._events, []
        return events

    def inject(self, what: RotorFault | GustEvent) -> None:
        """Let a fault or gust happen that was not known at the start. ValueError if it would begin before the next
        tick, or names a rotor that is not there.
        """
        coming: list[tuple[int, str, str, RotorFault | None]]
        if isinstance(what, GustEvent):
            coming = [(event.tick, "gust", event.text, None) for event in self._wind.add(what)]
        else:
            check_faults((what,), len(self.vehicle.rotors))
            coming = [(what.start_tick(self.tick_ns), "fault", what.text, what)]
        if coming[0][0] <= self._tick:
            raise ValueError(f"{coming[0][2]}: begins at tick {coming[0][0]}, and tick {self._tick} is over")
        # `_to_come` ends with what comes next; of one tick, what was known earlier stays first.
        self._to_come = sorted([*self._to_come[::-1], *coming], key=lambda item: item[0])[::-1]
        self._next_change = self._to_come[-1][0]

    def _schedule(self, faults: Sequence[RotorFault]) -> list[tuple[int, str, str, RotorFault | None]]:
        """(tick, kind, text, fault) of everything that will happen, the next one last."""
        coming: list[tuple[int, str, str, RotorFault | None]] = [
            (fault.start_tick(self.tick_ns), "fault", fault.text, fault) for fault in faults
        ]
        coming += [(event.tick, "gust", event.text, None) for event in self._wind.events()]
        return sorted(coming, key=lambda item: item[0])[::-1]  # of one tick, the one given first comes last

    def _take_hold(self, tick: int) -> None:
        now = []
        while self._to_come and self._to_come[-1][0] == tick:
            now.append(self._to_come.pop())
        for _, kind, text, fault in now:
            self._events.append(PhysicsEvent(tick * self.tick_ns, kind, text))
            if fault is not None:
                self._body.set_rotor(fault.rotor, *fault.rotor_left)
        self._next_change = self._to_come[-1][0] if self._to_come else -1

    def _blow(self, tick: int) -> None:
        before = self._wind_W
        s = self._truth[2:10].tolist()
        self._wind_W = self._wind.at(tick, s[0], (s[5], s[6], s[7]))
        self._body.set_wind(before, self._wind_W)

    def _near_scene(self, travelled_m: float) -> bool:
        """A clearance of earlier is used up: renew it, or let MuJoCo decide. Returns whether anything touched."""
        left_m, actors_left_m = self._remaining_m, self._actors_remaining_m
        self._remaining_m = 0.0
        if self._actors is not None:
            self._actors_remaining_m = 0.0
        if not travelled_m < _LOST_M:
            return False  # no longer a flight: the range check of this tick ends the run
        actors = self._actors
        t_ns = self.start_ns + self._tick * self.tick_ns
        if self.contact_skipping:
            if not travelled_m < left_m:
                left_m = self._body.clearance_before(self._radius_m, self._solids)
            if actors is not None and not travelled_m < actors_left_m:
                actors_left_m = actors.gap_m(self._body.position_before(), t_ns, travelled_m)
                actors.pose_near(t_ns)
            elif actors is not None:
                actors.put_away()
            if travelled_m < left_m and travelled_m < actors_left_m:
                self._remaining_m = left_m - travelled_m
                self._actors_remaining_m = actors_left_m - (travelled_m + self._approach_m)
                self.skips.skipped += 1
                return False
        elif actors is not None:
            actors.pose_all(t_ns)
        if not self._touches(travelled_m):
            self.skips.queried += 1
            if travelled_m < left_m:
                self._remaining_m = left_m - travelled_m
            if travelled_m < actors_left_m:
                self._actors_remaining_m = actors_left_m - (travelled_m + self._approach_m)
            return False
        self.skips.touching += 1
        self._body.rewind()
        if not self._was_touching:
            self._touch_down()
        return self._contact_steps()

    def _touch_down(self) -> None:
        """Choose how stiff the contact is that begins now."""
        s = self._truth[7:13].tolist()
        speed = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        speed += self._radius_m * math.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
        hard = speed > HARD_LANDING_MPS
        if hard != self._hard:
            self._hard = hard
            soften_contact(self._model, self._tick_s / self._contact_substeps[hard])

    def _touches(self, travelled_m: float) -> bool:
        model, data, body = self._model, self._data, self._body
        steps = body.steps()
        looks = max(1, math.ceil(travelled_m / (steps * self._finest_m)))
        for look in range(steps * looks):
            body.pose_in_substep(look // looks, (look % looks + 1) / looks)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon:
                return True
        return False

    def _contact_steps(self) -> bool:
        model, data, body = self._model, self._data, self._body
        load, update, forward = body.contact_load, body.contact_update, mujoco.mj_forward
        touched, hard = False, self._hard
        for substep in range(self._contact_substeps[hard]):
            load(substep, hard)
            forward(model, data)
            touched = touched or data.ncon > 0
            update(hard)
        return touched

    def _settle(self) -> None:
        """Let the feet find their depth (about 10 um) with rotors stopped, so that the flight starts at rest."""
        self._body.command([0.0] * len(self.vehicle.rotors))
        if self._actors is not None:
            self._actors.pose_all(self.start_ns)
        for _ in range(-(-_SETTLE_NS // self.tick_ns)):
            self._contact_steps()
        self._truth[_V] = 0.0
        self._truth[_W] = 0.0

    def _truth_state(self, tick: int, in_contact: bool) -> TruthState:
        s = self._truth.tolist()
        return TruthState(
            tick,
            tick * self.tick_ns,
            (s[0], s[1], s[2]),
            (s[3], s[4], s[5], s[6]),
            (s[7], s[8], s[9]),
            (s[10], s[11], s[12]),
            tuple(s[self._a_slice]),
            tuple(s[self._alpha_slice]),
            tuple(s[self._rotor_slice]),
            in_contact,
        )

    def _range_error(self, tick: int, violation: int) -> ModelRangeError:
        variable, limit = _LIMITS[violation]
        values = self._truth.tolist()
        battery = self.battery
        if battery is not None and violation in (5, 6):
            return ModelRangeError(tick, variable, battery.voltage_v if violation == 5 else battery.charge, limit)
        if violation == 1:
            index = next(i for i, value in enumerate(values) if not -1e300 < value < 1e300)
            return ModelRangeError(tick, f"{variable}[{index}]", values[index], limit)
        start = {2: _V, 3: _W, 4: _P}[violation].start
        x, y, z = values[start : start + 3]
        return ModelRangeError(tick, variable, float(np.sqrt(x * x + y * y + z * z)), limit)
