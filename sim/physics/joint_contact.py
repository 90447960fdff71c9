"""Contact of several vehicles with each other and with the scene, in one MuJoCo model.

    m_i dv_i/dt = F_i + m_i g + sum_c f_c,   I_i dw_i/dt + w_i x I_i w_i = M_i + sum_c (x_c - p_i) x f_c

F, M: rotors and air, from each vehicle's kernel. f_c: contact forces of all contacts together (mj_forward), equal and
opposite on the two bodies and at the same point x_c. Semi-implicit Euler kicks at the pose at which the forces were
computed, so momentum and angular momentum stay what they were. The contact is that of one vehicle with the scene
(sim.physics.contact_model): critically damped. The restitution e^-2 = 0.14 of exact time becomes 0.05 to
0.17 in contact steps, by the phase of the step in which they meet.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass

import mujoco

from signals.samples import Vec3
from sim.physics.actors import Actors
from sim.physics.contact_model import ROTOR_HALF_THICKNESS_M, build_model, soften_contact
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene_map import Actor
from sim.world_loader import load_world

_OUT_OF_RANGE_MPS = 400.0  # twice the speed limit of the model


@dataclass
class Touch:
    """Contact of two vehicles within one tick."""

    start_ns: int  # since the tick's start
    closing_mps: float  # normal speed of approach at the first instant of contact
    point_W: Vec3  # at that instant
    impulse_W_ns: list[float]  # on the second vehicle, within the tick


@dataclass
class Outcome:
    """Contacts of a cluster within one tick, by rows of its members."""

    touches: dict[tuple[int, int], Touch]
    touching: set[int]  # members that touched another or the scene


def reach_m(vehicle: Vehicle) -> float:
    """Return the radius of a sphere about the body origin that encloses contact spheres and rotor discs."""
    edge_m = math.hypot(vehicle.most_radius_m, ROTOR_HALF_THICKNESS_M)
    rotors_m = max(math.hypot(*rotor.position_m) for rotor in vehicle.rotors) + edge_m
    return max(vehicle.bounding_radius_m, rotors_m * (1.0 + 1e-12))


class JointContact:
    """Contact model of a number of vehicles of given types; serves any vehicles of these types, one tick at a time."""

    def __init__(self, members: Sequence[VehiclePhysics]) -> None:
        first, vehicles = members[0], [member.vehicle for member in members]
        self._tick_ns = first.tick_ns
        self._step_s = [first.tick_ns / 1e9 / count for count in first.contact_substeps]
        self._hard = False
        self._model = build_model(first.scene, *vehicles, contact_step_s=self._step_s[False])
        self._data = mujoco.MjData(self._model)
        self._count = len(vehicles)
        world = load_world(first.scene)
        radius_m = max(map(reach_m, vehicles))
        self._actors = (
            Actors(world, self._model, self._data, radius_m=radius_m, tick_ns=first.tick_ns)
            if world.map.actors
            else None
        )
        spheres = [sphere.radius_m for vehicle in vehicles for sphere in vehicle.contact_spheres]
        self._query_m = min(2.0 * ROTOR_HALF_THICKNESS_M, *spheres)

    def actor_changed(self, actor: Actor, t_ns: int) -> None:
        """Take notice that an actor that rests was put elsewhere at `t_ns`."""
        if self._actors is not None:
            self._actors.changed(actor, t_ns)

    def touch(self, members: Sequence[VehiclePhysics]) -> bool:
        """Return True if any two members touch each other on their ways since the last tick."""
        model, data = self._model, self._data
        travelled_m = sum(member.body.moved_m() for member in members)
        if not travelled_m < _OUT_OF_RANGE_MPS * len(members) * self._tick_ns / 1e9:
            return False  # out of the model's range: the check of this tick ends the run
        for row, member in enumerate(members):
            member.attach(data, row)
        queries = max(1, math.ceil(travelled_m / self._query_m))
        touched, query = False, 0
        while not touched and query < queries:
            query += 1
            for member in members:
                member.body.pose_in_tick(query / queries)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            touched = data.ncon > 0 and any(self._between(a, b) for a, b in self._rows())
        for member in members:
            member.attach()
        return touched

    def step(
        self,
        members: Sequence[VehiclePhysics],
        t_ns: int,
        *,
        hard: bool,
        resting: Container[tuple[int, int]] = (),
    ) -> Outcome:
        """Repeat the tick that ends at `t_ns` of the scene's time in contact steps.

        The impulses of pairs in `resting` are not computed.
        """
        model, data = self._model, self._data
        step_s = self._step_s[hard]
        if hard != self._hard:
            self._hard = hard
            soften_contact(model, step_s)
        if self._actors is not None:
            p_W = members[0].body.position_before()
            self._actors.gap_m(p_W, t_ns, max(math.dist(p_W, member.body.position_before()) for member in members))
            self._actors.pose_near(t_ns)
        data.qacc_warmstart[:] = 0.0  # the result depends on nothing before this tick
        bodies = []
        for row, member in enumerate(members):
            member.attach(data, row)
            member.hard = hard
            bodies.append(member.body)
        outcome = Outcome({}, set())
        substeps = members[0].contact_substeps[hard]
        for substep in range(substeps):
            for body in bodies:
                body.contact_load(substep, hard)
            mujoco.mj_forward(model, data)
            if data.ncon:
                self._record(outcome, substep * self._tick_ns // substeps, step_s, resting)
            for body in bodies:
                body.contact_update(hard)
        for member in members:
            member.attach()
        return outcome

    def _rows(self) -> list[list[int]]:
        """Return the rows of the two vehicles of each contact; a number below 0 or above the last row is the scene."""
        rows: list[list[int]] = (self._model.geom_bodyid[self._data.contact.geom] - 1).tolist()
        return rows

    def _between(self, a: int, b: int) -> bool:
        return 0 <= a < self._count and 0 <= b < self._count

    def _record(self, outcome: Outcome, start_ns: int, step_s: float, resting: Container[tuple[int, int]]) -> None:
        data = self._data
        began: set[tuple[int, int]] = set()
        for index, (a, b) in enumerate(self._rows()):
            if not self._between(a, b):
                outcome.touching.add(a if 0 <= a < self._count else b)
                continue
            pair = (a, b) if a < b else (b, a)
            if pair in outcome.touches and pair in resting:
                continue
            contact = data.contact[index]
            first = int(contact.efc_address)
            closing_mps = -float(data.efc_vel[first])
            if pair not in outcome.touches:
                began.add(pair)
                outcome.touching.update(pair)
                x, y, z = contact.pos.tolist()
                outcome.touches[pair] = Touch(start_ns, closing_mps, (x, y, z), [0.0, 0.0, 0.0])
            touch = outcome.touches[pair]
            if pair in began:
                touch.closing_mps = max(touch.closing_mps, closing_mps)
            # The axes of the contact in W are the rows of its frame; the force acts on the second geom's body.
            force, axes = data.efc_force[first : first + 3].tolist(), contact.frame.tolist()
            scale = step_s if a < b else -step_s
            for k in range(3):
                touch.impulse_W_ns[k] += scale * (force[0] * axes[k] + force[1] * axes[3 + k] + force[2] * axes[6 + k])
