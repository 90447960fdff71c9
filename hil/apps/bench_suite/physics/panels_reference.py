"""Wings by panels for plane_reference.py, in another form than the kernel's.

Sections by their angles (arc tangents, sines), panel by panel with vectors; vortices by the angles under which their
ends are seen (Katz and Plotkin, 2.12); the mutual velocities by numpy's solver and as CasADi matrices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from sim.physics.forces.airfoil import flap_of, plate_drag, stall_of
from sim.physics.forces.panels import PanelPlace, Panels

Float64 = NDArray[np.float64]
_DENSITY = 1.225
_CALM2, _SLACK2 = 0.09, 4.0  # (m/s)^2
_AHEAD = np.array([1.0, 0.0, 0.0])


@dataclass
class Stream:
    """A propeller and its flow: expressions; place and axis are those of a tilt, or constants."""

    place: ca.SX | ca.DM
    axis: ca.SX | ca.DM
    radius_m: float
    velocity: ca.SX  # of its hub through the air
    induced: ca.SX  # at the disc


@dataclass
class Flight:
    """State of the body as panels see it: expressions in B."""

    air: ca.SX
    w: ca.SX
    height: ca.SX
    up: ca.SX  # z of W
    streams: Sequence[Stream]
    ground: bool = True


class _Frame(NamedTuple):
    """Geometry of one panel."""

    x: Float64
    y: Float64
    z: Float64
    seen: Float64
    quarter: Float64
    ahead: Float64
    width: float
    chord: float


def panels(part: Panels, flight: Flight, angles: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return force and torque in B at 1.225 kg/m3, as expressions."""
    places = part.layout()
    frames = [_frame(place) for place in places]
    wings = [i for i, place in enumerate(places) if place.body is None]
    flows = [_flow(frame, flight) for frame in frames]
    seen, tilting = influence(part)
    bends: dict[int, tuple[Any, Any]] = {i: _bend(part, places[i], angles) for i in wings}
    passed = []
    for row, i in enumerate(wings):
        u, _, v = flows[i]
        own = [k for k, j in enumerate(wings) if places[j].wing == places[i].wing]
        reduced = 1.0 - float(np.sum(seen[row, own]))
        shift = 2 * ca.atan(bends[i][0] / 2)
        theta, size = ca.atan2(v, u) + shift, ca.sqrt(u**2 + v**2)
        V = ca.sqrt(u**2 + v**2 + _CALM2)
        f = _attached(part, places[i], reduced * size * ca.sin(theta) / V, size * ca.cos(theta) / V)
        passed.append(f * size * ca.sin(theta))
    through = ca.DM(seen) @ ca.vertcat(*passed)
    leaning = ca.DM(tilting) @ ca.vertcat(*passed)
    span = max(wing.span_m for wing in part.wings)
    force, torque = ca.SX.zeros(3), ca.SX.zeros(3)
    for i, (place, frame) in enumerate(zip(places, frames, strict=True)):
        u, side, v = flows[i]
        middle = frame.quarter - frame.ahead
        if place.body is None:
            left: Any = 1.0
            if flight.ground:
                z = flight.height + ca.dot(flight.up, ca.DM(middle))
                fade = ca.fmax(1 - (z / (4 * span)) ** 2, 0) ** 4
                left = 1 - fade / (1 + (16 * z / span) ** 2)
            row = wings.index(i)
            turning = ca.dot(flight.w, ca.DM(frame.y))
            local, load = _section(
                part, place, frame, (u, side, v), (left * through[row], left * leaning[row]), bends[i], turning
            )
        else:
            local, load = _plate(place, frame, (u, side, v))
        pull = ca.DM(np.column_stack([frame.x, frame.y, frame.z])) @ local
        cosine = u / load[1]
        centre = ca.DM(middle) + (cosine * ca.DM(frame.ahead) if place.body is None else 0)
        force += pull
        torque += ca.cross(centre, pull) - load[0] * ca.DM(frame.y)
    return force, torque


def influence(part: Panels) -> tuple[Float64, Float64]:
    """Return W and W' of the lifting panels."""
    places = [place for place in part.layout() if place.body is None]
    frames = [_frame(place) for place in places]
    n = len(places)
    normal, beside = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            left, right = np.array(places[j].left_m), np.array(places[j].right_m)

            def core(
                p: Float64,
                middle: Float64 = (left + right) / 2,
                width: float = frames[j].width,
                other: bool = _sheet(places[i]) != _sheet(places[j]),
            ) -> float:
                behind = max(0.0, float(middle[0] - p[0])) if other else 0.0
                return width / 2 * behind / math.hypot(behind, 2 * width)

            bound = _vortex(left, right, frames[i].seen, core(frames[i].seen))
            trails = [_trailing(end, frames[i].seen, core(frames[i].seen)) for end in (left, right)]
            normal[i, j] = -(bound + trails[1] - trails[0]) @ frames[i].z
            trails = [_trailing(end, frames[i].quarter, core(frames[i].quarter)) for end in (left, right)]
            bound = np.zeros(3) if i == j else _vortex(left, right, frames[i].quarter, core(frames[i].quarter))
            beside[i, j] = -(bound + trails[1] - trails[0]) @ frames[i].z
    slopes = np.array([part.wings[place.wing].airfoil.lift_slope_per_rad for place in places])
    chords = np.array([frame.chord for frame in frames])
    section = normal + np.diag(2 / (slopes * chords) - 1 / (np.pi * chords))
    circulation = np.linalg.solve(section, np.eye(n))
    return np.eye(n) - (2 / (slopes * chords))[:, None] * circulation, beside @ circulation


def _sheet(place: PanelPlace) -> int:
    return place.wing if place.sheet is None else place.sheet


def _vortex(a: Float64, b: Float64, p: Float64, core: float) -> Float64:
    """Return the velocity at p of a straight vortex of circulation 1 from a to b, by the cosines of its ends."""
    e = (b - a) / np.linalg.norm(b - a)
    across = np.cross(e, p - a)
    distance2 = across @ across
    if distance2 + core**2 < 1e-16 * ((p - a) @ (p - a)):
        return np.zeros(3)
    cosines = [(e @ (p - end)) / math.sqrt((p - end) @ (p - end) + core**2) for end in (a, b)]
    return np.asarray(across * (cosines[0] - cosines[1]) / (4 * np.pi * (distance2 + core**2)))


def _trailing(a: Float64, p: Float64, core: float) -> Float64:
    """Return the velocity at p of a vortex from a along -x to infinity."""
    across = np.cross(-_AHEAD, p - a)
    cosine = -(p - a)[0] / math.sqrt((p - a) @ (p - a) + core**2)
    return np.asarray(across * (cosine + 1) / (4 * np.pi * (across @ across + core**2)))


def _frame(place: PanelPlace) -> _Frame:
    left, right, ahead = np.array(place.left_m), np.array(place.right_m), np.array(place.ahead_m)
    width = float(np.linalg.norm(left - right))
    y = (left - right) / width
    z = np.cross(ahead, y)
    z /= np.linalg.norm(z)
    x = np.cross(y, z)
    quarter = np.array(place.quarter_m)
    seen = quarter - (2 if place.body is None else 1) * ahead
    return _Frame(x, y, z, seen, quarter, ahead, width, 4 * float(ahead @ x))


def _flow(frame: _Frame, flight: Flight) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the velocity through the air along x and y, and against z, where the panel sees it."""
    velocity = flight.air + ca.cross(flight.w, ca.DM(frame.seen))
    for stream in flight.streams:
        offset = ca.DM(frame.seen) - stream.place
        behind = -ca.dot(offset, stream.axis)
        across2 = ca.sumsqr(offset) - behind**2
        axial = ca.dot(stream.velocity, stream.axis)
        beside2 = ca.sumsqr(stream.velocity - axial * stream.axis)
        v = stream.induced
        grown = 1 + behind / ca.sqrt(behind**2 + stream.radius_m**2)
        E = axial**2 + beside2 + _SLACK2
        radius2 = stream.radius_m**2 * (E + v**2) / (E + grown * v**2)
        skew = (axial + v) ** 2 / ((axial + v) ** 2 + beside2 + _SLACK2)
        velocity += v * skew * grown / (1 + (across2 / radius2) ** 4) * stream.axis
    return ca.dot(velocity, ca.DM(frame.x)), ca.dot(velocity, ca.DM(frame.y)), -ca.dot(velocity, ca.DM(frame.z))


def _bend(part: Panels, place: PanelPlace, angles: ca.SX) -> tuple[Any, Any]:
    """Return the change of the angle of zero lift [rad, twice its half's tangent] and of C_m by surfaces and camber."""
    section = part.wings[place.wing].airfoil
    bend: Any = -math.radians(section.zero_lift_deg)
    moment: Any = section.cm0
    for index, gearing in place.flaps:
        surface = part.surfaces[index]
        flap = flap_of(surface.chord_ratio)
        bend += gearing * surface.effectiveness * flap.angle * angles[index]
        moment += gearing * surface.effectiveness * flap.moment * angles[index]
    return bend, moment


def _attached(part: Panels, place: PanelPlace, s: ca.SX, c: ca.SX) -> ca.SX:
    wing = part.wings[place.wing]
    foil = wing.airfoil
    stall = stall_of(foil.lift_slope_per_rad, foil.cl_max, foil.cl_min, plate_drag(wing.aspect_ratio))
    return (1 + c) ** 2 * (2 - c) / 4 / (1 + ((s - stall.middle) / stall.half_width) ** 8)


def _section(
    part: Panels,
    place: PanelPlace,
    frame: _Frame,
    flow: tuple[ca.SX, ca.SX, ca.SX],
    induced: tuple[ca.SX, ca.SX],
    bend: tuple[Any, Any],
    turning: ca.SX,
) -> tuple[ca.SX, tuple[ca.SX, ca.SX]]:
    """Return the force in the panel's axes, its moment nose up, and the speed."""
    wing, (u, side, v) = part.wings[place.wing], flow
    foil, v, lean = wing.airfoil, v - induced[0], v - induced[1]
    V, size = ca.sqrt(u**2 + v**2 + _CALM2), ca.sqrt(u**2 + v**2)
    theta = ca.atan2(v, u) + 2 * ca.atan(bend[0] / 2)
    s, c = size * ca.sin(theta) / V, size * ca.cos(theta) / V
    f = _attached(part, place, s, c)
    normal = plate_drag(wing.aspect_ratio) * s / (0.56 + 0.44 * ca.sqrt(s**2 + 0.05**2))
    C_l = f * foil.lift_slope_per_rad * s + (1 - f) * normal * c
    C_d = foil.cd0 + f * foil.cd_cl2 * (foil.lift_slope_per_rad * s) ** 2 + (1 - f) * normal * s
    area = frame.width * frame.chord
    scale = _DENSITY / 2 * V * area
    force = scale * ca.vertcat(C_l * lean - C_d * u, -foil.cd0 * side, C_l * u + C_d * lean)
    damped = foil.lift_slope_per_rad / 16 * frame.chord * turning / V
    return force, (_DENSITY / 2 * V**2 * area * frame.chord * f * (bend[1] + damped), V)


def _plate(place: PanelPlace, frame: _Frame, flow: tuple[ca.SX, ca.SX, ca.SX]) -> tuple[ca.SX, tuple[ca.SX, ca.SX]]:
    body, (u, side, v) = place.body, flow
    assert body is not None
    V = ca.sqrt(u**2 + v**2 + _CALM2)
    s, c = v / V, u / V
    normal = body.cross_drag * s * ca.sqrt(s**2 + 0.05**2)
    cd0 = body.drag_area_m2 / ((body.nose_m[0] - body.tail_m[0]) * (body.width_m + body.height_m))
    C_l, C_d = normal * c, cd0 + normal * s
    scale = _DENSITY / 2 * V * frame.width * frame.chord
    return scale * ca.vertcat(C_l * v - C_d * u, -cd0 * side, C_l * u + C_d * v), (ca.SX(0.0), V)
