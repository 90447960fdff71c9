"""A plane of a bench as its autopilot is told of it: plain values, computed from the forces of the vehicle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.autopilots.installation import FixedWing, Rotor, Surface
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.fixed_wing import Airframe, NoTrimError, Trim
from sim.physics.vehicle import Vehicle
from sim.scene.atmosphere import SEA_LEVEL_KGPM3, density_kgpm3
from sim.scene.scene import Site

_BANK_RAD = math.radians(35.0)  # of the turns that a plan may expect
_MOST_KNOWN = 16
_KNOWN: dict[str, FixedWing] = {}  # by vehicle and site


def turn_radius_m(airspeed_mps: float) -> float:
    """Return the radius of a level turn with a bank of 35 degrees."""
    return airspeed_mps * airspeed_mps / (STANDARD_GRAVITY_MPS2 * math.tan(_BANK_RAD))


def fixed_wing_facts(vehicle: Vehicle, site: Site | None = None) -> FixedWing:
    """Return the facts about a vehicle that `fixed_wing.unfit` finds fit. Raises NoTrimError if it cannot fly level.

    Checks, part and link of a run ask for the same: they are computed once, in about a second.
    """
    key = f"{vehicle.model_dump_json()} {site!r}"
    if key not in _KNOWN:
        if len(_KNOWN) >= _MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[key] = _computed(vehicle, site)
    return _KNOWN[key]


def _computed(vehicle: Vehicle, site: Site | None) -> FixedWing:
    airframe = Airframe(vehicle, site)
    _, fastest = airframe.speed_range_mps
    cruise = airframe.cruise_mps
    trim = airframe.trim(cruise)
    glide = airframe.best_glide
    effect, damping = airframe.effectiveness_nm(trim), airframe.damping_nms(trim)
    surfaces = [
        Surface(
            vehicle.commands[index].name,
            (float(effect[0, k]), float(effect[1, k]), float(effect[2, k])),
            trim.controls[index],
        )
        for k, index in enumerate(airframe.surfaces)
    ]
    most = airframe.thrust_range_n(cruise)[1]
    needed = _thrust_n(airframe, trim)
    constants = vehicle.constants_of_rotors
    x, y, z = vehicle.inertia_kgm2
    return FixedWing(
        name=vehicle.name,
        mass_kg=vehicle.mass_kg,
        inertia_kgm2=(x, y, z),
        rotors=[
            Rotor(rotor.position_m, rotor.axis, rotor.spin.sign, 1.0, constants[i].moment_ratio_m)
            for i, rotor in enumerate(vehicle.rotors_ahead)
            if i in airframe.engines
        ],
        surfaces=surfaces,
        stall_mps=airframe.stall_speed_mps,
        cruise_mps=cruise,
        fastest_mps=fastest,
        glide_mps=glide.airspeed_mps,
        idle_sink_mps=_idle_sink_mps(airframe, trim),
        climb_mps=cruise * min(max((most - needed) / (vehicle.mass_kg * airframe.gravity_mps2), 0.0), 0.9),
        pitch_rad=trim.pitch_rad,
        throttle=trim.throttle,
        damping_nms=(float(damping[0, 0]), float(damping[1, 1]), float(damping[2, 2])),
        pull_up=_pull_up(airframe, trim, effect[1]),
        wheels=vehicle.rolls,
        ground_pitch_rad=vehicle.standing_pitch_rad,
        steering=_command(vehicle, "steering"),
        brake=_command(vehicle, "brake"),
        density_kgpm3=SEA_LEVEL_KGPM3 if site is None else density_kgpm3(site.altitude_m, site.warmer_k),
    )


def _command(vehicle: Vehicle, name: str) -> int | None:
    """Return the index of a command of the vehicle; None: it has none of this name."""
    return next((i for i, command in enumerate(vehicle.commands) if command.name == name), None)


def _idle_sink_mps(airframe: Airframe, trim: Trim) -> float:
    """Return the sink rate at the cruise airspeed with the engines' command at 0."""
    try:
        return -trim.airspeed_mps * math.sin(airframe.glide(trim.airspeed_mps).climb_rad)
    except NoTrimError:  # the surfaces do not trim it: by the drag of level flight
        return _thrust_n(airframe, trim) * trim.airspeed_mps / (airframe.vehicle.mass_kg * airframe.gravity_mps2)


def _thrust_n(airframe: Airframe, trim: Trim) -> float:
    """Return the force of the engines along x in a trim, by the change with their command."""
    controls = np.array(trim.controls)
    idle = controls.copy()
    idle[airframe.engines] = 0.0
    still = (0.0, 0.0, 0.0)
    change = airframe.wrench(trim.v_B_mps, still, controls) - airframe.wrench(trim.v_B_mps, still, idle)
    return float(change[0]) + airframe.thrust_range_n(trim.airspeed_mps)[0]


def _pull_up(airframe: Airframe, trim: Trim, pitch_effect: NDArray[np.float64]) -> float:
    """Return the pitch command per pitch rate that a steady turn needs beyond straight flight [s/rad]."""
    try:
        turn = airframe.trim(trim.airspeed_mps, bank_rad=_BANK_RAD)
    except NoTrimError:
        return 0.5
    full = float(np.sum(np.abs(pitch_effect)))
    change = np.array([turn.controls[i] - trim.controls[i] for i in airframe.surfaces])
    rate = float(turn.w_B_radps[1])
    if full <= 0.0 or abs(rate) < 1e-6:
        return 0.5
    return float(pitch_effect @ change) / full / rate
