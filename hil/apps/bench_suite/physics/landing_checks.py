"""Checks of ground contact: time to rest, penetration, energy, and flights with contact skipping on and off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.apps.bench_suite.physics.flight_cases import Float64
from hil.apps.bench_suite.result import Check, ShowStatus
from signals.rotation import matrix_of
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.integration import Integration
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

_REST_SPEED = 1e-3  # m/s and rad/s


@dataclass
class Landed:
    """Outcome of a fall onto the ground."""

    rest_s: float  # from the first contact to rest; infinite without rest
    depth_m: float  # greatest penetration of any contact sphere
    gain_j: float  # greatest energy after a contact minus the energy before it
    finite: bool


def drop(
    vehicle: Vehicle,
    height_m: float,
    *,
    tick_ns: int,
    seconds: float = 4.0,
    v_W: tuple[float, float, float] = (0, 0, 0),
) -> Landed:
    """Drop a vehicle with its motors off from `height_m` above standing height, with initial velocity `v_W` [m/s]."""
    physics = VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        tick_ns,
        start=FlightStart(p_WB=(0.0, 0.0, vehicle.standing_height_m + height_m)),
    )
    physics.state[7:10] = v_W
    inertia = np.array(vehicle.inertia_kgm2)
    centres_B = np.array([sphere.position_m for sphere in vehicle.contact_spheres])
    radii = np.array([sphere.radius_m for sphere in vehicle.contact_spheres])

    def energy(s: Float64) -> float:
        motion = vehicle.mass_kg * float(s[7:10] @ s[7:10]) + float(np.sum(inertia * s[10:13] ** 2))
        return vehicle.mass_kg * STANDARD_GRAVITY_MPS2 * float(s[2]) + 0.5 * motion

    off = (0.0,) * len(vehicle.rotors)
    physics.advance(0, off)
    air_j = before_j = energy(physics.state)
    touched_at = rest_at = None
    depth, gain, flying = 0.0, -np.inf, True
    for tick in range(1, round(seconds * 1e9 / tick_ns) + 1):
        truth = physics.advance(tick, off)
        s = physics.state
        if truth.in_contact:
            if flying:
                before_j = air_j
            touched_at = touched_at or tick * tick_ns / 1e9
        else:
            air_j = energy(s)  # of the last tick in the air
        flying = not truth.in_contact
        if touched_at is not None:
            gain = max(gain, energy(s) - before_j)
        up_row = np.array(matrix_of(s[3:7])[6:])
        depth = max(depth, float(np.max(radii - (s[2] + centres_B @ up_row))))
        if max(abs(value) for value in truth.v_WB_W + truth.w_WB_B) > _REST_SPEED:
            rest_at = None
        elif rest_at is None and touched_at is not None:
            rest_at = tick * tick_ns / 1e9
    rest_s = rest_at - touched_at if rest_at is not None and touched_at is not None else np.inf
    return Landed(rest_s, depth, float(gain), bool(np.isfinite(physics.state).all()))


def skipping_difference_m() -> float:
    """Return the greatest position difference [m] between a flight with and without contact skipping."""
    tracks = []
    for skipping in (True, False):
        physics = VehiclePhysics(
            load_vehicle("x500"), load_scene("airfield"), 4_000_000, integration=Integration(contact_skipping=skipping)
        )
        h = multirotor.hover_control(physics.vehicle)
        phases = [(25, 0.0), (220, 1.04), (20, 1.0), (100, 0.97), (250, 0.95), (200, 0.0)]  # ticks, control over hover
        track, tick = [physics.advance(0, (0.0,) * 4).p_WB], 0
        for ticks, level in phases:
            controls = (level * h, level * h, level * h * 1.0001, level * h)
            for _ in range(ticks):
                tick += 1
                track.append(physics.advance(tick, controls).p_WB)
        tracks.append(np.array(track))
    return float(np.max(np.linalg.norm(tracks[0] - tracks[1], axis=1)))


def landing_checks(status: ShowStatus) -> list[Check]:
    """Drop every vehicle from 0.1 and 0.5 m, straight and sideways, with ticks of 1, 2 and 4 ms; return the checks."""
    landings = []
    for name in multirotor_names():
        for tick_ns in (1_000_000, 2_000_000, 4_000_000):
            status(f"landing: {name}, tick {tick_ns / 1e6:g} ms")
            for height_m, v_W in ((0.1, (0.0, 0.0, 0.0)), (0.5, (0.0, 0.0, 0.0)), (0.3, (0.5, -0.3, -0.5))):
                landings.append(drop(load_vehicle(name), height_m, tick_ns=tick_ns, seconds=2.0, v_W=v_W))
    return [
        Check("landing: longest time from touch to rest", max(landed.rest_s for landed in landings), "<=", 1.0, "s"),
        Check("landing: deepest penetration", max(landed.depth_m for landed in landings), "<=", 5e-3, "m"),
        Check(
            "landing: greatest energy gain through a contact", max(landed.gain_j for landed in landings), "<=", 0.0, "J"
        ),
        Check("flight changed by contact skipping", skipping_difference_m(), "<=", 1e-9, "m"),
    ]
