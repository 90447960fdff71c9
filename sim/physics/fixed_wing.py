"""Facts of a vehicle with wings that its controllers and checks need: trim, speeds, stability, effect of its surfaces.

All of it is computed from the forces as the flight has them (`RigidBody.steady_wrench`), whatever their kinds, with the
forces' own states at rest. Angles of flight: alpha from the flow in the plane of symmetry, beta positive with the
wind from the right, climb of the velocity over the horizontal, bank positive with the right wing down. Torques are in B
(FLU): a positive one about x rolls right, about y pitches down, about z yaws left. SI units.

Equations of a trim, with v the velocity and w the rate of a steady turn in B, I the inertia, n = R^T z_W:

    0 = F - m (g n + w x v),   0 = M - w x (I w),   v . n = V sin(climb),   w = -turn n

Unknown: alpha, beta, pitch, throttle, the surfaces, and the bank (straight flight) or the turn rate (at a given bank).
With more unknowns than equations the smallest change from neutral is taken, beta before everything else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.units import STANDARD_GRAVITY_MPS2
from sim._kernels import Wheels
from sim.physics.forces.force import Effects
from sim.physics.forces.rotors import RotorSet
from sim.physics.integration import TickSteps
from sim.physics.vehicle import Vehicle, rigid_body
from sim.scene.scene import Site

Float64 = NDArray[np.float64]
USUAL_CRUISE = 1.4  # cruise speed over the stall speed where the vehicle's file says none
LEAST_AHEAD = 0.5  # forward part of the axis of an engine
_STEPS, _CLOSE = 30, 1e-10  # Newton's method; residual over the weight
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SERVES = 0.1  # residual that is left by a step with slopes that serve
_MOST_ALPHA_RAD = math.radians(60.0)
_SLOPE_RAD = 1e-5
_FASTEST_MPS = 150.0
_DEEP_M = 1000.0


class NoTrimError(Exception):
    """The vehicle cannot fly steadily so; the text says what runs out."""


@dataclass(frozen=True)
class Trim:
    """Steady flight in still air."""

    airspeed_mps: float
    climb_rad: float
    bank_rad: float
    turn_radps: float  # of the heading, positive to the right
    alpha_rad: float
    beta_rad: float
    pitch_rad: float
    throttle: float  # command of every engine
    controls: tuple[float, ...]  # all commands of the vehicle, in their order

    @property
    def v_B_mps(self) -> Float64:
        """Velocity in B."""
        return _velocity(self.airspeed_mps, self.alpha_rad, self.beta_rad)

    @property
    def w_B_radps(self) -> Float64:
        """Body rates in B."""
        return -self.turn_radps * _up(self.pitch_rad, self.bank_rad)


class _Root(NamedTuple):
    """Place at which the equations of a trim were left."""

    airspeed_mps: float
    x: Float64  # unknowns
    residual: float
    ahead: float  # force along x that is left, over the weight
    throttle: float
    climb_rad: float
    bank_rad: float
    turn_radps: float


@dataclass(frozen=True)
class Mode:
    """A mode of the linearised motion: eigenvalue with a positive or no imaginary part."""

    eigenvalue: complex

    @property
    def period_s(self) -> float:
        """Period of an oscillation; inf without one."""
        return math.tau / self.eigenvalue.imag if self.eigenvalue.imag > 0.0 else math.inf

    @property
    def damping_ratio(self) -> float:
        """-Re / |lambda|; 1 or -1 without an oscillation."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


def engines(vehicle: Vehicle) -> list[int]:
    """Return the indices of the rotors that pull ahead in flight, some of them turned there by tilts."""
    return [i for i, rotor in enumerate(vehicle.rotors_ahead) if rotor.axis[0] >= LEAST_AHEAD]


def is_plane(vehicle: Vehicle) -> bool:
    """Return True for a vehicle that its wings alone carry: it has no rotor that lifts."""
    return vehicle.has_wings and all(vehicle.upward(rotor.axis) < LEAST_AHEAD for rotor in vehicle.rotors)


def unfit(vehicle: Vehicle) -> tuple[str, str] | None:
    """Return the key of the vehicle's file and the reason why a plane's controller cannot fly it; None if it can."""
    if not vehicle.has_wings:
        return "forces", "holds no wings (such as aero_table)"
    if not engines(vehicle):
        return "rotors", "holds no engine: a rotor with the axis [1, 0, 0]"
    if not vehicle.surfaces:
        return "forces", "holds no control surfaces"
    after = vehicle.commands[len(vehicle.rotors) + len(vehicle.tilts) :]
    if [command.name for command in after[: len(vehicle.surfaces)]] != [surface.name for surface in vehicle.surfaces]:
        return "forces", "holds wheels before the control surfaces: put what has the surfaces first"
    return None


@dataclass
class Airframe:
    """A vehicle with wings in the air of a site; without one the density is 1.225 kg/m3."""

    vehicle: Vehicle
    site: Site | None = None
    gravity_mps2: float = STANDARD_GRAVITY_MPS2
    _known: dict[tuple[float, float, float], Trim] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        forces = self.vehicle.make_forces(Effects(ground_effect=False))
        for force in forces:
            if isinstance(force, Wheels):  # it flies, though at a height of 0
                force.set_ground(-_DEEP_M)
        self._truth = np.zeros(13 + sum(force.states for force in forces) + 6)
        self._truth[3] = 1.0
        self._body = rigid_body(
            self.vehicle,
            self._truth,
            forces=forces,
            gravity_mps2=self.gravity_mps2,
            wind_W_mps=(0.0, 0.0, 0.0),
            steps=TickSteps(0.004, 1),
            air=None if self.site is None else (self.site.altitude_m, self.site.warmer_k),
        )
        commands = self.vehicle.commands
        self.engines = engines(self.vehicle)
        names = {surface.name for surface in self.vehicle.surfaces}
        self.surfaces = [i for i, command in enumerate(commands) if command.name in names]
        self._neutral = np.array(self.vehicle.ahead_commands)  # tilts stay where they are in flight
        self._weight_n = self.vehicle.mass_kg * self.gravity_mps2

    # ---- forces

    def wrench(self, v_B: Sequence[float] | Float64, w_B: Sequence[float] | Float64, controls: Float64) -> Float64:
        """Return force [N] without gravity and torque [N m] in B in still air."""
        self._truth[7:10], self._truth[10:13] = v_B, w_B  # at the attitude (1, 0, 0, 0), W is B
        return np.array(self._body.steady_wrench(tuple(controls.tolist())))

    def controls(self, throttle: float, surfaces: Sequence[float] | Float64) -> Float64:
        """Return all commands from those of the engines and of each surface."""
        out = self._neutral.copy()
        out[self.engines] = throttle
        out[self.surfaces] = surfaces
        return out

    # ---- steady flight

    def trim(self, airspeed_mps: float, *, climb_rad: float = 0.0, bank_rad: float = 0.0) -> Trim:
        """Return steady flight at an airspeed: straight, or turning at a bank. Raises NoTrimError."""
        key = (airspeed_mps, climb_rad, bank_rad)
        if key not in self._known:
            self._known[key] = self._solve(airspeed_mps, climb_rad=climb_rad, bank_rad=bank_rad)
        return self._known[key]

    def glide(self, airspeed_mps: float) -> Trim:
        """Return straight flight at an airspeed with the engines' command at 0. Raises NoTrimError."""
        return self._solve(airspeed_mps, climb_rad=None, bank_rad=0.0)

    def _solve(self, V: float, *, climb_rad: float | None, bank_rad: float) -> Trim:
        return self._accepted(self._root(V, climb_rad=climb_rad, bank_rad=bank_rad))

    def _root(self, V: float, *, climb_rad: float | None, bank_rad: float) -> _Root:
        """Newton's method with least-norm steps, its slopes kept while they serve.

        Unknown: alpha, beta, pitch, throttle or climb, bank or turn, surfaces.
        """
        n, turning, mass, gravity = len(self.surfaces), bank_rad != 0.0, self.vehicle.mass_kg, self.gravity_mps2
        inertia = self.vehicle.inertia_tensor_kgm2
        rows = inertia.tolist()
        per_force, sin, cos = 1.0 / self._weight_n, math.sin, math.cos
        per_torque = per_force / math.sqrt(float(np.max(np.diag(inertia))) / mass)  # by the radius of gyration
        neutral, wrench = self._neutral.tolist(), self._body.steady_wrench

        def residual(x: Float64) -> Float64:
            alpha, beta, pitch, third, fourth, *surfaces = x.tolist()
            throttle, climb = (0.0, third) if climb_rad is None else (third, climb_rad)
            bank, turn = (bank_rad, fourth) if turning else (fourth, 0.0)
            controls = neutral.copy()
            for i in self.engines:
                controls[i] = throttle
            for i, u in zip(self.surfaces, surfaces, strict=True):
                controls[i] = u
            a, b, c = V * cos(alpha) * cos(beta), -V * sin(beta), -V * sin(alpha) * cos(beta)
            ux, uy, uz = sin(pitch), cos(pitch) * sin(bank), cos(pitch) * cos(bank)
            p, q, r = -turn * ux, -turn * uy, -turn * uz
            self._truth[7:13] = (a, b, c, p, q, r)  # at the attitude (1, 0, 0, 0), W is B
            fx, fy, fz, mx, my, mz = wrench(tuple(controls))
            hx, hy, hz = (row[0] * p + row[1] * q + row[2] * r for row in rows)
            return np.array(
                [
                    (fx - mass * (gravity * ux + q * c - r * b)) * per_force,
                    (fy - mass * (gravity * uy + r * a - p * c)) * per_force,
                    (fz - mass * (gravity * uz + p * b - q * a)) * per_force,
                    (mx - (q * hz - r * hy)) * per_torque,
                    (my - (r * hx - p * hz)) * per_torque,
                    (mz - (p * hy - q * hx)) * per_torque,
                    (a * ux + b * uy + c * uz) / V - sin(climb),
                ]
            )

        scale = np.ones(5 + n)
        scale[1] = 0.02  # beta
        x = np.zeros(5 + n)
        x[0] = x[2] = 0.05
        x[3] = -0.1 if climb_rad is None else 0.5
        x[4] = gravity * math.tan(bank_rad) / V if turning else 0.0
        if climb_rad is not None:
            x[2] += climb_rad
        r, slopes = residual(x), None
        size = float(np.max(np.abs(r)))
        for _ in range(_STEPS):
            if size < _CLOSE:
                break
            if slopes is None:
                slopes = _central_slopes(residual, x) * scale
            step = scale * np.linalg.lstsq(slopes, -r, rcond=1e-9)[0]
            last, x = x, x + step * min(1.0, 0.15 / max(1e-12, float(np.max(np.abs(step)))))
            if climb_rad is not None and not 0.0 <= x[3] <= 1.0:  # beyond, a command changes nothing
                x[3] = 0.5 * (last[3] + (1.0 if x[3] > 1.0 else 0.0))
            x[0] = min(_MOST_ALPHA_RAD, max(-_MOST_ALPHA_RAD, x[0]))
            r, before = residual(x), size
            size = float(np.max(np.abs(r)))
            if not size < _SERVES * before:
                slopes = None
        third, fourth = float(x[3]), float(x[4])
        throttle, climb = (0.0, third) if climb_rad is None else (third, climb_rad)
        bank, turn = (bank_rad, fourth) if turning else (fourth, 0.0)
        return _Root(V, x, size, float(r[0]), throttle, climb, bank, turn)

    def _accepted(self, root: _Root) -> Trim:
        """Return the trim of a solution. Raises NoTrimError."""
        V, x, throttle = root.airspeed_mps, root.x, root.throttle
        controls = self.controls(throttle, x[5:])
        self._refuse(root, controls)
        return Trim(
            V,
            root.climb_rad,
            root.bank_rad,
            root.turn_radps,
            float(x[0]),
            float(x[1]),
            float(x[2]),
            throttle,
            tuple(float(u) for u in controls),
        )

    def _refuse(self, root: _Root, controls: Float64) -> None:
        """Raise NoTrimError if the solution is none, or asks for more than the vehicle has."""
        V, throttle = root.airspeed_mps, root.throttle
        where, found = f"steady flight at {V:.3g} m/s", root.residual < 1e-7
        if not found and self.stall_speed_mps > V:
            raise NoTrimError(
                f"no {where}: the wings carry {self._weight_n:.3g} N from {self.stall_speed_mps:.3g} m/s on"
            )
        at_an_end = not found and throttle > 0.0 and not 0.01 < throttle < 0.99
        if at_an_end and root.ahead < 0.0:
            raise NoTrimError(f"{where} would need more thrust than the engines have")
        for i in self.surfaces:
            if abs(controls[i]) > 1.0 + 1e-9:
                wanted = f"at {controls[i]:.2f}" if found else "beyond the end"
                raise NoTrimError(f"{where} would need {self.vehicle.commands[i].name} {wanted} of its range")
        if at_an_end:
            raise NoTrimError(f"{where} would need more drag than the vehicle has with its engines at 0")
        if not found:
            raise NoTrimError(f"no {where} was found")
        if self.lift_slope_n_per_rad(V, float(root.x[0]), controls) <= 0.0:
            raise NoTrimError(
                f"steady flight at {V:.3g} m/s is beyond the stall, at {math.degrees(root.x[0]):.1f} degrees"
            )

    def lift_slope_n_per_rad(self, V: float, alpha_rad: float, controls: Float64) -> float:
        """Return the change of lift with alpha [N/rad]: below 0 beyond the stall."""
        ahead, behind = (self._lift_n(V, alpha_rad + h, controls) for h in (1e-4, -1e-4))
        return (ahead - behind) / 2e-4

    def _lift_n(self, V: float, alpha_rad: float, controls: Float64) -> float:
        force = self.wrench(_velocity(V, alpha_rad, 0.0), (0.0, 0.0, 0.0), controls)
        return float(force[0] * math.sin(alpha_rad) + force[2] * math.cos(alpha_rad))

    # ---- speeds

    @property
    def cruise_mps(self) -> float:
        """Cruise speed of the vehicle's file, else 1.4 times the stall speed."""
        given = self.vehicle.cruise_mps
        return USUAL_CRUISE * self.stall_speed_mps if given is None else given

    @cached_property
    def stall_speed_mps(self) -> float:
        """Slowest airspeed at which the wings carry the weight in straight flight, pitch trimmed, engines at 0."""
        return self._stall[0]

    @cached_property
    def stall_alpha_rad(self) -> float:
        """Angle of attack of the greatest lift at the stall speed."""
        return self._stall[1]

    @cached_property
    def _stall(self) -> tuple[float, float]:
        lift, alpha = self.most_lift_n(_FASTEST_MPS)
        if lift < self._weight_n:
            raise NoTrimError(f"the wings do not carry {self._weight_n:.3g} N at {_FASTEST_MPS:g} m/s")
        V = _FASTEST_MPS
        for _ in range(12):  # the lift is nearly quadratic in V
            better = V * math.sqrt(self._weight_n / lift)
            if abs(better - V) < 1e-9 * V:
                break
            V = better
            lift, alpha = self.most_lift_n(V, near_rad=alpha)
        return V, alpha

    def most_lift_n(self, V: float, *, near_rad: float | None = None) -> tuple[float, float]:
        """Return the greatest lift [N] with the pitch trimmed as far as the surfaces reach, and its alpha [rad].

        `near_rad`: an alpha within 2 degrees of it; by default all up to 45 degrees are tried.
        """

        def lift(alpha: float) -> float:
            return self._lift_n(V, alpha, self.controls(0.0, self._pitch_trimmed(V, alpha)))

        if near_rad is None:
            coarse = np.radians(np.arange(0.0, 45.0, 2.0))
            near_rad = float(coarse[int(np.argmax([lift(alpha) for alpha in coarse]))])
        alpha = _greatest(lift, near_rad - math.radians(2.0), near_rad + math.radians(2.0), steps=25)
        return lift(alpha), alpha

    def _pitch_trimmed(self, V: float, alpha: float) -> Float64:
        """Return commands of the surfaces at which the pitching torque is 0, moved in proportion to their effect."""
        direction = self._pitch_direction
        v = _velocity(V, alpha, 0.0)

        def torque(share: float) -> float:
            return float(self.wrench(v, (0.0, 0.0, 0.0), self.controls(0.0, share * direction))[4])

        at_low, at_high = torque(-1.0), torque(1.0)
        if at_low * at_high > 0.0:
            return direction * (-1.0 if abs(at_low) < abs(at_high) else 1.0)
        return _zero(torque, (-1.0, at_low), (1.0, at_high)) * direction

    @cached_property
    def _pitch_direction(self) -> Float64:
        """Commands of the surfaces, at most 1, that pitch most."""
        effect = self._effect(_velocity(20.0, 0.05, 0.0), self.controls(0.0, np.zeros(len(self.surfaces))))[1]
        most = float(np.max(np.abs(effect), initial=0.0))
        return effect / most if most > 0.0 else effect

    @cached_property
    def speed_range_mps(self) -> tuple[float, float]:
        """Slowest and fastest airspeed of level flight. Raises NoTrimError if there is none."""
        stall = self.stall_speed_mps
        tried = [stall * factor for factor in (1.05, 1.2, 1.35, 1.5, 1.75, 2.0)]
        good = next((V for V in tried if self._flies(V)), None)
        if good is None:
            self.trim(1.3 * stall)  # raises with the reason
            raise NoTrimError(f"no level flight between {tried[0]:.3g} and {tried[-1]:.3g} m/s")
        slowest = _border(self._flies, 0.5 * stall, good)
        fastest = _border(lambda V: not self._flies(V), good, _FASTEST_MPS)
        return slowest, fastest

    def _flies(self, V: float) -> bool:
        try:
            self._solve(V, climb_rad=0.0, bank_rad=0.0)
        except NoTrimError:
            return False
        return True

    @cached_property
    def best_glide(self) -> Trim:
        """Glide with the engines' command at 0 that loses least height over the way. Raises NoTrimError."""
        stall = self.stall_speed_mps
        return self.glide(_greatest(self._climb_in_glide_rad, 1.02 * stall, 3.0 * stall, steps=30))

    def _climb_in_glide_rad(self, V: float) -> float:
        """Return the climb angle of a glide; where there is none, less than any, and less the faster it is."""
        try:
            return self.glide(V).climb_rad
        except NoTrimError:
            return -math.pi - V

    def thrust_range_n(self, airspeed_mps: float) -> tuple[float, float]:
        """Return the force of the engines along x at command 0 and 1 in level flow [N]."""
        v, still = _velocity(airspeed_mps, 0.0, 0.0), (0.0, 0.0, 0.0)
        surfaces = np.zeros(len(self.surfaces))
        bare = self._without_engines.wrench(v, still, self._neutral)[0]
        least, most = (float(self.wrench(v, still, self.controls(u, surfaces))[0] - bare) for u in (0.0, 1.0))
        return least, most

    @cached_property
    def _without_engines(self) -> Airframe:
        vehicle = self.vehicle
        weak = {"thrust_coefficient_n_per_radps2": 1e-30, "drag_kg_per_rad": 0.0}
        sets = {
            name: RotorSet(rotor_constants=of.rotor_constants.model_copy(update=weak))
            for name, of in vehicle.rotor_sets.items()
        }
        bare = vehicle.rotor_constants.model_copy(update=weak)
        update = {"rotor_constants": bare, "rotor_model": "quadratic", "rotor_sets": sets}
        return Airframe(vehicle.model_copy(update=update), self.site, self.gravity_mps2)

    # ---- stability

    def neutral_point_m(self, airspeed_mps: float) -> float:
        """Return how far behind the centre of mass the lift by a change of alpha acts [m]: below 0 it is unstable."""
        trim = self.trim(airspeed_mps)
        loads = [
            self.wrench(_velocity(airspeed_mps, trim.alpha_rad + h, trim.beta_rad), (0, 0, 0), np.array(trim.controls))
            for h in (1e-4, -1e-4)
        ]
        change = loads[0] - loads[1]
        return float(change[4] / change[2])

    def static_margin(self, airspeed_mps: float) -> float | None:
        """Return the neutral point behind the centre of mass over the mean chord; None if no wing tells its chord."""
        chord = next((force.mean_chord_m for force in self.vehicle.forces if force.mean_chord_m is not None), None)
        return None if chord is None else self.neutral_point_m(airspeed_mps) / chord

    def effectiveness_nm(self, trim: Trim) -> Float64:
        """Return roll, pitch and yaw torque in B per unit command of each surface about a trim: (3, surfaces) [N m]."""
        return self._effect(trim.v_B_mps, np.array(trim.controls))

    def _effect(self, v_B: Float64, controls: Float64) -> Float64:
        columns = []
        for i in self.surfaces:
            change = np.zeros(len(controls))
            change[i] = 0.05
            loads = [self.wrench(v_B, (0.0, 0.0, 0.0), controls + sign * change)[3:] for sign in (1.0, -1.0)]
            columns.append((loads[0] - loads[1]) / 0.1)
        return np.column_stack(columns)

    def damping_nms(self, trim: Trim) -> Float64:
        """Return the change of the torque with the body rates about a trim: (3, 3) [N m s], below 0 on the diagonal."""
        v, controls = trim.v_B_mps, np.array(trim.controls)

        def torque(w: Float64) -> Float64:
            return self.wrench(v, w, controls)[3:]

        return _slopes(torque, trim.w_B_radps)

    def state_matrix(self, trim: Trim) -> Float64:
        """Return A of dx/dt = A x about a straight trim, x changes of v_B [m/s], w_B [rad/s], bank and pitch [rad].

        Engines and surfaces hold their commands, with their own states at rest.
        """
        inertia, controls = self.vehicle.inertia_tensor_kgm2, np.array(trim.controls)
        inverse = np.linalg.inv(inertia)

        def rate(x: Float64) -> Float64:
            v, w, bank, pitch = x[:3], x[3:6], float(x[6]), float(x[7])
            load = self.wrench(v, w, controls)
            dv = load[:3] / self.vehicle.mass_kg - self.gravity_mps2 * _up(pitch, bank) - np.cross(w, v)
            dw = inverse @ (load[3:] - np.cross(w, inertia @ w))
            # FLU: pitch is about -y, heading about z.
            about_left = w[1] * math.cos(bank) - w[2] * math.sin(bank)
            about_up = (w[1] * math.sin(bank) + w[2] * math.cos(bank)) / math.cos(pitch)
            return np.concatenate([dv, dw, [w[0] - math.sin(pitch) * about_up, -about_left]])

        at = np.concatenate([trim.v_B_mps, trim.w_B_radps, [trim.bank_rad, trim.pitch_rad]])
        return _slopes(rate, at)

    def modes(self, trim: Trim) -> dict[str, Mode]:
        """Return those modes there are of short_period, phugoid, dutch_roll, roll and spiral."""
        found = named_modes(self.state_matrix(trim))
        return {name: Mode(value) for name, value in found.items()}


def named_modes(A: Float64) -> dict[str, complex]:
    """Return the eigenvalues of a state matrix of `Airframe.state_matrix` by the name of their mode.

    Motions are told apart by the share of their eigenvector in the plane of symmetry.
    """
    values, vectors = np.linalg.eig(A)
    speed = np.array([1.0, 1.0, 1.0, 15.0, 15.0, 15.0, 15.0, 15.0])  # rates and angles beside velocities
    symmetric = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    shares = np.sum((np.abs(vectors.T) * speed * symmetric) ** 2, axis=1) / np.sum(
        (np.abs(vectors.T) * speed) ** 2, axis=1
    )
    out: dict[str, complex] = {}
    keep = values.imag >= 0.0
    along = sorted((complex(v) for v, s, k in zip(values, shares, keep, strict=True) if k and s > 0.5), key=abs)
    across = sorted((complex(v) for v, s, k in zip(values, shares, keep, strict=True) if k and s <= 0.5), key=abs)
    turning = [v for v in along if v.imag > 0.0]
    if turning:
        out["phugoid"] = turning[0]
    if len(turning) > 1:
        out["short_period"] = turning[-1]
    swinging, plain = [v for v in across if v.imag > 0.0], [v for v in across if v.imag == 0.0]
    if swinging:
        out["dutch_roll"] = swinging[-1]
    if len(plain) > 1:
        out["spiral"], out["roll"] = plain[0], plain[-1]
    return out


def _border(reached: Callable[[float], bool], low: float, high: float) -> float:
    """Return where a condition that holds at `high` begins to hold."""
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def _greatest(f: Callable[[float], float], low: float, high: float, *, steps: int) -> float:
    """Return where a function with one maximum in an interval has it, by golden section."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = f(a), f(b)
    for _ in range(steps - 1):
        if at_a > at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = f(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = f(b)
    return 0.5 * (low + b) if at_a > at_b else 0.5 * (a + high)


def _zero(f: Callable[[float], float], low: tuple[float, float], high: tuple[float, float]) -> float:
    """Return a zero between two places where f, given there, has opposite signs: false position (Illinois)."""
    (a, at_a), (b, at_b) = low, high
    for _ in range(60):
        if at_b == 0.0 or abs(b - a) < 1e-12:
            return b
        c = b - at_b * (b - a) / (at_b - at_a)
        at_c = f(c)
        if at_b * at_c < 0.0:
            a, at_a = b, at_b
        else:
            at_a *= 0.5
        near = abs(c - b) < 1e-10
        b, at_b = c, at_c
        if near:
            break
    return b


def _velocity(V: float, alpha: float, beta: float) -> Float64:
    """Return the velocity through the air in B (FLU)."""
    return V * np.array(
        [math.cos(alpha) * math.cos(beta), -math.sin(beta), -math.sin(alpha) * math.cos(beta)], dtype=np.float64
    )


def _up(pitch: float, bank: float) -> Float64:
    """Return z_W in B (FLU)."""
    return np.array([math.sin(pitch), math.cos(pitch) * math.sin(bank), math.cos(pitch) * math.cos(bank)])


def _central_slopes(f: Callable[[Float64], Float64], x: Float64) -> Float64:
    """Return the Jacobian by central differences."""
    columns = []
    for i in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += _SLOPE_RAD
        behind[i] -= _SLOPE_RAD
        columns.append((f(ahead) - f(behind)) * (0.5 / _SLOPE_RAD))
    return np.column_stack(columns)


def _slopes(f: Callable[[Float64], Float64], x: Float64) -> Float64:
    """Return the Jacobian by central differences of fourth order."""
    columns = []
    for i in range(len(x)):
        h = 1e-4 * max(1.0, abs(float(x[i])))
        at = [f(x + k * h * np.eye(len(x))[i]) for k in (-2.0, -1.0, 1.0, 2.0)]
        columns.append((at[0] - 8.0 * at[1] + 8.0 * at[2] - at[3]) / (12.0 * h))
    return np.column_stack(columns)
