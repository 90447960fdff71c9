"""Several vehicles in one scene, advanced tick by tick together; they collide with each other.

One tick:

1. alone     Every vehicle flies the tick as if it were alone (sim.physics.vehicle_physics), contact with the
             scene included.
2. nearness  Pairs whose bounding spheres cannot have met are left as they are: one native call for all pairs.
3. query     Near pairs are posed along their ways and MuJoCo looks for contacts between them. If there are none, the
             results of 1 stand. Vehicles that touch, directly or through others, form a cluster.
4. contact   Each cluster returns to the start of the tick and is stepped together (sim.physics.joint_contact). Its
             vehicles may now touch others: 2 to 4 are repeated, with larger clusters, until none is added.

A vehicle that touches no other has the bits of a flight alone. Within a cluster the vehicles are ordered by name, so
the order of the mapping has no influence.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.errors import ModelRangeError
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_MS
from sim._kernels import near_pairs, write_downwash
from sim.physics.joint_contact import JointContact, Outcome, Touch, reach_m
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import HARD_LANDING_MPS, VehiclePhysics
from sim.scene.scene_map import Actor

IMPACT_NS = 20 * NS_PER_MS  # a longer contact is a rest: only this much of its impulse is counted
_CALM_MPS = 0.1  # a hard contact ends when every vehicle is slower
_APART_NS = 100 * NS_PER_MS  # a contact after a shorter gap is the same contact


class VehicleContact(NamedTuple):
    """Contact of two vehicles, reported when they have parted, or after 20 ms."""

    t_ns: int  # begin, to the contact step
    a: str
    b: str
    closing_mps: float  # speed of approach along the contact's normal, at its begin
    impulse_ns: float  # total impulse [N s] between them, of the first 20 ms
    point_W: Vec3  # at its begin


@dataclass
class _Lasting:
    """Contact that goes on, or ended less than 100 ms ago."""

    begin_ns: int
    closing_mps: float
    point_W: Vec3
    impulse_W_ns: list[float]
    last_ns: int  # end of the last tick with contact
    reported: bool = False


class VehicleGroup:
    """Vehicles of one run.

    `downwash`: the wakes of vehicles are wind for others (sim/native/downwash.hpp), by their states one tick earlier.
    Raises ValueError unless the vehicles have the same scene and tick.
    """

    def __init__(self, vehicles: Mapping[str, VehiclePhysics], *, downwash: bool = False) -> None:
        if not vehicles:
            raise ValueError("a group needs a vehicle")
        self._names = list(vehicles)
        self._vehicles = list(vehicles.values())
        first = self._vehicles[0]
        for name, vehicle in vehicles.items():
            if vehicle.tick_ns != first.tick_ns or vehicle.scene != first.scene:
                raise ValueError(f"vehicle {name!r} has another scene or tick than {self._names[0]!r}")
        self._bodies = [vehicle.body for vehicle in self._vehicles]
        self._downwash_W = np.zeros((len(vehicles), 3)) if downwash else None
        self._blown = np.zeros(len(vehicles), dtype=bool)  # vehicles that have met a wake
        self._reach_m = np.array([reach_m(vehicle.vehicle) for vehicle in self._vehicles])
        self._every_pair = [(a, b) for b in range(len(self._names)) for a in range(b)]
        self._skipping = all(vehicle.contact_skipping for vehicle in self._vehicles)
        self._joint: list[tuple[list[Vehicle], JointContact]] = []
        self._lasting: dict[tuple[int, int], _Lasting] = {}
        self._contacts: list[VehicleContact] = []

    def advance(self, tick: int, controls: Sequence[Sequence[float]]) -> list[TruthState]:
        """Advance all vehicles to tick `tick`, and return their states; both in the mapping's order.

        See `VehiclePhysics.advance`. A ModelRangeError names its vehicle.
        """
        if self._downwash_W is not None:
            self._blow(self._downwash_W)
        touching = []
        for index, (vehicle, control) in enumerate(zip(self._vehicles, controls, strict=True)):
            try:
                touching.append(vehicle.fly(tick, control))
            except ModelRangeError as error:
                raise self._named(error, index) from None
        if tick > 0 and len(self._vehicles) > 1:
            self._collide(tick, touching)
        states, errors = [], []
        for index, vehicle in enumerate(self._vehicles):
            try:
                states.append(vehicle.finish(touching[index]))
            except ModelRangeError as error:
                errors.append(self._named(error, index))
        if errors:  # the tick of the other vehicles is complete
            raise errors[0]
        return states

    def actor_changed(self, actor: Actor, t_ns: int) -> None:
        """Take notice that an actor that rests was put elsewhere at `t_ns`."""
        for vehicle in self._vehicles:
            vehicle.actor_changed(actor, t_ns)
        for _, joint in self._joint:
            joint.actor_changed(actor, t_ns)

    def forget_scene(self) -> None:
        """Make the models of contact anew when they are needed, because the vehicles' scene was changed."""
        self._joint.clear()

    def forget(self, name: str) -> None:
        """Forget the contacts of a vehicle that was placed elsewhere between two ticks; they are not reported."""
        index = self._names.index(name)
        self._lasting = {pair: lasting for pair, lasting in self._lasting.items() if index not in pair}

    def take_contacts(self, *, last: bool = False) -> list[VehicleContact]:
        """Return the contacts reported since the last call; with `last` also those whose impact still goes on."""
        if last:
            for pair, lasting in self._lasting.items():
                self._report(pair, lasting)
        contacts, self._contacts = sorted(self._contacts), []
        return contacts

    def _blow(self, wind_W: NDArray[np.float64]) -> None:
        write_downwash(self._bodies, wind_W)
        for index in np.flatnonzero(wind_W.any(axis=1) | self._blown).tolist():
            x, y, z = wind_W[index].tolist()
            self._vehicles[index].set_downwash((x, y, z))
            self._blown[index] = True

    def _collide(self, tick: int, touching: list[bool]) -> None:
        """Resolve the contacts between vehicles in this tick, and set `touching` of those in a cluster."""
        clusters: dict[int, tuple[int, ...]] = {}  # by member
        touches: dict[tuple[int, int], Touch] = {}
        clear: set[tuple[int, int]] = set()  # pairs that do not touch on their present ways
        while True:
            found = []
            for pair in near_pairs(self._bodies, self._reach_m) if self._skipping else self._every_pair:
                a, b = pair
                if pair in clear or (a in clusters and clusters[a] is clusters.get(b)):
                    continue
                if not (self._vehicles[a].collides and self._vehicles[b].collides):
                    continue
                members = self._members(pair)
                if self._joint_contact(members).touch(members):
                    found.append(pair)
                else:
                    clear.add(pair)
            if not found:
                break
            for a, b in found:
                cluster = self._by_name({*clusters.get(a, (a,)), *clusters.get(b, (b,))})
                clusters.update(dict.fromkeys(cluster, cluster))
            for cluster in {clusters[a] for a, _ in found}:
                clear = {pair for pair in clear if not (pair[0] in cluster or pair[1] in cluster)}
                touches = {pair: touch for pair, touch in touches.items() if pair[0] not in cluster}
                outcome = self._step(tick, cluster)
                for row, index in enumerate(cluster):
                    touching[index] = row in outcome.touching
                touches |= {(cluster[a], cluster[b]): touch for (a, b), touch in outcome.touches.items()}
        if touches or self._lasting:
            self._keep(tick * self._vehicles[0].tick_ns, touches)

    def _step(self, tick: int, cluster: Sequence[int]) -> Outcome:
        members = [self._vehicles[index] for index in cluster]
        for member in members:
            member.rewind()
        first, (fast, faster) = members[0], sorted(member.surface_speed_mps for member in members)[-2:]
        meets = fast + faster > HARD_LANDING_MPS and not all(member.was_touching for member in members)
        hard = meets or (faster > _CALM_MPS and any(member.hard for member in members))
        rows = {index: row for row, index in enumerate(cluster)}
        resting = {
            (rows[a], rows[b])
            for (a, b), lasting in self._lasting.items()
            if lasting.reported and a in rows and b in rows
        }
        t_ns = first.start_ns + tick * first.tick_ns
        return self._joint_contact(members).step(members, t_ns, hard=hard, resting=resting)

    def _keep(self, end_ns: int, touches: dict[tuple[int, int], Touch]) -> None:
        """Add the touches of a tick to the contacts that last, and report those whose impact is over."""
        for pair, touch in touches.items():
            lasting = self._lasting.get(pair)
            if lasting is None:
                begin_ns = end_ns - self._vehicles[0].tick_ns + touch.start_ns
                lasting = _Lasting(begin_ns, touch.closing_mps, touch.point_W, [0.0, 0.0, 0.0], end_ns)
                self._lasting[pair] = lasting
            lasting.last_ns = end_ns
            if not lasting.reported:
                for k in range(3):
                    lasting.impulse_W_ns[k] += touch.impulse_W_ns[k]
        for pair, lasting in list(self._lasting.items()):
            if pair not in touches or end_ns - lasting.begin_ns >= IMPACT_NS:
                self._report(pair, lasting)
            if end_ns - lasting.last_ns >= _APART_NS:
                del self._lasting[pair]

    def _report(self, pair: tuple[int, int], lasting: _Lasting) -> None:
        if lasting.reported:
            return
        lasting.reported = True
        a, b = (self._names[index] for index in pair)
        impulse_ns = math.hypot(*lasting.impulse_W_ns)
        self._contacts.append(VehicleContact(lasting.begin_ns, a, b, lasting.closing_mps, impulse_ns, lasting.point_W))

    def _by_name(self, indices: Iterable[int]) -> tuple[int, ...]:
        return tuple(sorted(indices, key=self._names.__getitem__))

    def _members(self, indices: Iterable[int]) -> list[VehiclePhysics]:
        return [self._vehicles[index] for index in self._by_name(indices)]

    def _joint_contact(self, members: Sequence[VehiclePhysics]) -> JointContact:
        """Return the model for vehicles of these types."""
        types = [member.vehicle for member in members]
        for known, joint in self._joint:
            if known == types:
                return joint
        self._joint.append((types, JointContact(members)))
        return self._joint[-1][1]

    def _named(self, error: ModelRangeError, index: int) -> ModelRangeError:
        vehicle = self._names[index]
        return ModelRangeError(error.tick, error.variable, error.value, error.limit, cause=error.cause, vehicle=vehicle)
