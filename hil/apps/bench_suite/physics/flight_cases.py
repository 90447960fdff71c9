"""Flights on which the physics benchmarks compare methods, and the methods: this project and MuJoCo.

All flights but `switching` and `of_shipped_vehicle` use the x500 with a motor lag of 50 ms in both directions, and
without rotor inertia, ground effect and descent loss, which MuJoCo's model does not have. This project and MuJoCo use
the same native function for rotor and air forces; in MuJoCo it is the control callback, so no Python runs in a step.

MuJoCo holds the rotors' speeds as activations. With dyntype `filterexact` it solves the lag in closed form over a step,
which is best for Euler and implicitfast. With RK4 the activation then stays constant over the stages and the order
falls to one, so RK4 is also measured with `filter`, whose lag RK4 integrates over its stages.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import matrix_of
from signals.samples import Vec3
from sim.physics import multirotor
from sim.physics.contact_model import mjcf_text
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.forces.rotors import Rotor
from sim.physics.integration import Integration, TickSteps
from sim.physics.vehicle import Vehicle, load_vehicle, rigid_body
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene, Site, load_scene
from sim.scene.wind import Wind

Float64 = NDArray[np.float64]
TICK_NS = 4_000_000
TICK_S = 0.004
PLAIN = Effects(ground_effect=False, descent_loss=False, air_density=False)
_LAG_S = 0.05


def bench_vehicle(**changes: Any) -> Vehicle:
    """Return the x500 reduced to what all methods model, with `changes` to its rotor constants."""
    vehicle = load_vehicle("x500")
    shared_constants = {"time_constant_up_s": _LAG_S, "time_constant_down_s": _LAG_S, "inertia_kgm2": 0.0}
    return vehicle.model_copy(
        update={
            "rotor_constants": vehicle.rotor_constants.model_copy(update=shared_constants | changes),
            "battery": None,
        }
    )


def torque_free(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle without air drag and with negligible rotor forces."""
    bare = {"thrust_coefficient_n_per_radps2": 1e-30, "drag_kg_per_rad": 0.0, "inertia_kgm2": 0.0}
    return vehicle.model_copy(
        update={
            "rotor_constants": vehicle.rotor_constants.model_copy(update=bare),
            "body_drag_linear_n_per_mps": (0.0, 0.0, 0.0),
            "body_drag_quadratic_n_per_m2ps2": (0.0, 0.0, 0.0),
            "inertia_kgm2": (0.0239, 0.0300, 0.0440),
        }
    )


@dataclass(frozen=True)
class Flight:
    """Initial state and open-loop commands of a flight."""

    vehicle: Vehicle
    scene: Scene
    start: Float64  # (13 + rotors,): p, q, v in W, w in B, rotor speeds [rad/s]
    commands: Float64  # (ticks, rotors), 0 to 1
    wind_W_mps: Vec3 = (0.0, 0.0, 0.0)
    tick_ns: int = TICK_NS
    effects: Effects = PLAIN

    @property
    def site(self) -> Site | None:
        """Site whose air the vehicle flies in; None for that of sea level."""
        return self.scene.site if self.effects.air_density and self.vehicle.rotor_model != "quadratic" else None

    @property
    def duration_s(self) -> float:
        """Duration of the commands."""
        return len(self.commands) * self.tick_ns / 1e9


def vigorous(seconds: float = 5.0, *, tick_ns: int = TICK_NS, vehicle: Vehicle | None = None) -> Flight:
    """Return a flight that climbs, rolls, pitches and yaws at about 1 Hz, to 10 rad/s, 24 m/s and past 90 degrees."""
    vehicle = vehicle or bench_vehicle()
    hover = multirotor.hover_control(vehicle)
    t = np.arange(round(seconds * 1e9 / tick_ns)) * (tick_ns / 1e9)
    axes = np.stack(
        [
            0.035 * np.sin(2 * np.pi * 1.1 * t),
            0.030 * np.sin(2 * np.pi * 1.3 * t + 1),
            0.050 * np.sin(2 * np.pi * 0.4 * t),
        ],
        axis=1,
    )
    signs = np.sign(np.round(multirotor.effectiveness(vehicle)[3:], 9))  # of roll, pitch and yaw by each rotor
    commands = hover * (1 + 0.12 * np.sin(2 * np.pi * 0.9 * t)[:, None] + axes @ signs)
    return Flight(vehicle, load_scene("airfield"), start_state(vehicle), np.clip(commands, 0.0, 1.0), tick_ns=tick_ns)


def of_shipped_vehicle(name: str, *, tilt_deg: float = 0.0, model: str = "blade_element") -> Flight:
    """Return the vigorous flight of a vehicle with all effects, its rotors tilted sideways in turn."""
    vehicle = load_vehicle(name).model_copy(update={"rotor_model": model})
    side = math.tan(math.radians(tilt_deg))
    rotors = []
    for rotor in vehicle.rotors:
        x, y, _ = rotor.position_m
        reach = math.hypot(x, y)
        axis = (-side * rotor.spin.sign * y / reach, side * rotor.spin.sign * x / reach, 1.0)
        rotors.append(rotor if not tilt_deg else Rotor.model_validate(rotor.model_dump() | {"axis": axis}))
    flight = vigorous(vehicle=vehicle.model_copy(update={"rotors": tuple(rotors)}))
    return replace(flight, effects=Effects())


# The X500 V2 kit's motor, as in rigs/benches/x500_motors.yaml; APC Slow Flyer 10 x 4.7 in, as in docs/physics.md.
_MOTOR = {"kv_rpm_per_v": 920.0, "resistance_ohm": 0.12, "no_load_current_a": 0.9, "nominal_voltage_v": 14.8}
_SLOW_FLYER = {"thrust_coefficients": (0.1300, -0.1063, -0.1365), "power_coefficients": (0.0530, -0.0026, -0.0714)}


def of_x500(*, motor: bool, model: str = "blade_element", starts_and_stops: bool = False) -> Flight:
    """Return a flight of the x500 with all effects: the vigorous one, or one that switches its rotors at random."""
    data = load_vehicle("x500").model_dump() | {"rotor_model": model}
    data["rotor_constants"] |= {"motor": _MOTOR if motor else None, "wind_tunnel": _SLOW_FLYER}
    vehicle = Vehicle.model_validate(data)
    flight = switching(vehicle=vehicle) if starts_and_stops else vigorous(vehicle=vehicle)
    return replace(flight, effects=Effects())


def hover(seconds: float = 5.0) -> Flight:
    """Return a flight with hover commands that differ slightly between the rotors."""
    vehicle = bench_vehicle()
    commands = np.tile(
        multirotor.hover_control(vehicle) * np.array([1.0, 1.0002, 1.0001, 1.0]), (round(seconds / TICK_S), 1)
    )
    return Flight(vehicle, load_scene("airfield"), start_state(vehicle), commands)


def gust() -> Flight:
    """Return a hover in a wind of 12 m/s that starts suddenly."""
    vehicle = bench_vehicle()
    commands = np.full((round(3.0 / TICK_S), 4), multirotor.hover_control(vehicle))
    return Flight(vehicle, load_scene("airfield"), start_state(vehicle), commands, wind_W_mps=(9.6, -7.2, 0.0))


def switching(*, model: str = "blade_element", vehicle: Vehicle | None = None) -> Flight:
    """Return a flight of the iris with all effects, whose rotors stop and start at random every 0.1 s."""
    vehicle = vehicle or load_vehicle("iris").model_copy(update={"rotor_model": model})
    ticks = round(5.0 / TICK_S)
    running = np.random.default_rng(3).integers(0, 2, (-(-ticks // 25), len(vehicle.rotors)))
    commands: Float64 = np.repeat(running.astype(np.float64), 25, axis=0)[:ticks]
    commands *= min(1.0, 2.0 * multirotor.hover_control(vehicle))
    return Flight(vehicle, load_scene("airfield"), start_state(vehicle), commands, effects=Effects())


def tumble(seconds: float, spin_radps: float = 20.0) -> Flight:
    """Return a torque-free flight without gravity that spins about an axis off the principal axes."""
    vehicle = torque_free(bench_vehicle())
    state = start_state(vehicle)
    direction = np.array([1.0, 0.7, 0.4])
    state[10:13] = spin_radps * direction / np.linalg.norm(direction)
    state[13:] = 0.0
    scene = load_scene("airfield").model_copy(update={"gravity_mps2": 0.0})
    return Flight(vehicle, scene, state, np.zeros((round(seconds / TICK_S), 4)))


def landing(height_m: float = 0.25, seconds: float = 2.0) -> Flight:
    """Return a fall onto the landing gear with motors off and a small sideways speed."""
    vehicle = bench_vehicle()
    state = start_state(vehicle)
    state[:3] = (0.0, 0.0, vehicle.standing_height_m + height_m)
    state[7:10] = (0.3, -0.2, 0.0)
    state[13:] = 0.0
    return Flight(vehicle, load_scene("airfield"), state, np.zeros((round(seconds / TICK_S), 4)))


def start_state(vehicle: Vehicle) -> Float64:
    """Return the initial state: level, at rest, 300 m up, rotors at hover speed."""
    speed = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
    return np.array([0, 0, 300.0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, *([speed] * len(vehicle.rotors))])


class _TickByTick:
    """A method that advances tick by tick. Only one flight may be open at a time."""

    name: str
    begin: Callable[[Flight], _ProjectStepper | _MujocoStepper]

    def fly(self, flight: Flight, *, record: bool) -> Float64:
        """Fly and return the states (p, q, v, w), (n, 13): at every tick if `record`, else only the last."""
        stepper, states = self.begin(flight), [flight.start[:13].copy()]
        try:
            for controls in flight.commands.tolist():
                stepper.advance(controls)
                if record:
                    states.append(stepper.state[:13].copy())
            return np.array(states) if record else stepper.state[None, :13].copy()
        finally:
            stepper.close()


class ThisProject(_TickByTick):
    """VehiclePhysics with its Python layer, as the bench runs it."""

    def __init__(self, step_ms: float, *, method: Any = "order8") -> None:
        self.step_ns = round(step_ms * 1e6)
        self.method = method
        self.name = f"this project, {'order 8' if method == 'order8' else 'classical RK4'} @ {step_ms:g} ms"

    def begin(self, flight: Flight) -> _ProjectStepper:
        """Start a flight with this project's physics."""
        return _ProjectStepper(flight, self.method, self.step_ns)


class _ProjectStepper:
    def __init__(self, flight: Flight, method: Any, step_ns: int) -> None:
        physics = self.physics = VehiclePhysics(
            flight.vehicle,
            flight.scene,
            flight.tick_ns,
            effects=flight.effects,
            start=FlightStart(p_WB=tuple(flight.start[:3].tolist())),
            disturbances=Disturbances(wind=Wind(steady_W_mps=flight.wind_W_mps)),
            integration=Integration(method=method, step_ns=step_ns),
        )
        physics.state[:] = flight.start
        self.state: Float64 = physics.state
        physics.advance(0, (0.0,) * len(flight.vehicle.rotors))
        self._tick = 0

    def advance(self, controls: Sequence[float]) -> None:
        self._tick += 1
        self.physics.advance(self._tick, controls)

    def close(self) -> None:
        pass


class PlainMujoco(_TickByTick):
    """mj_step with one of MuJoCo's integrators and forces from the native callback."""

    def __init__(self, integrator: str, step_ms: float, *, lag: str = "filterexact") -> None:
        self.integrator, self.step_s, self.lag = integrator, step_ms / 1e3, lag
        label = integrator if lag == "filterexact" else f"{integrator} {lag}"
        self.name = f"MuJoCo {label} @ {step_ms:g} ms"

    def begin(self, flight: Flight) -> _MujocoStepper:
        """Start a flight with MuJoCo. Raises ValueError if the step is longer than the tick."""
        text = mjcf_text(flight.scene, flight.vehicle, contact_step_s=self.step_s)
        text = text.replace("<option ", f'<option integrator="{self.integrator}" ', 1)
        motor = f'<general joint="vehicle" gear="0 0 0 0 0 0" dyntype="{self.lag}" dynprm="{_lag(flight.vehicle)!r}"/>'
        text = text.replace("</mujoco>", f"<actuator>{motor * len(flight.vehicle.rotors)}</actuator></mujoco>")
        return _MujocoStepper(flight, mujoco.MjModel.from_xml_string(text), self.step_s)


class _MujocoStepper:
    def __init__(self, flight: Flight, model: mujoco.MjModel, step_s: float) -> None:
        self._vehicle = flight.vehicle
        self._model, self._data = model, mujoco.MjData(model)
        # A diverged state must stay diverged instead of being reset to the start.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._steps = round(flight.tick_ns / 1e9 / step_s)
        if self._steps < 1:
            raise ValueError("a step must not be longer than the tick")
        self._body = rigid_body(
            flight.vehicle,
            np.concatenate([flight.start, np.zeros(6)]),
            forces=flight.vehicle.make_forces(flight.effects),
            gravity_mps2=flight.scene.gravity_mps2,
            wind_W_mps=flight.wind_W_mps,
            steps=TickSteps(tick_s=flight.tick_ns / 1e9, free=1),
        )
        data = self._data
        data.qpos[:], data.qvel[:], data.act[:] = flight.start[:7], flight.start[7:13], flight.start[13:]
        self._body.serve_mujoco(data.qpos, data.qvel, data.act, data.qfrc_applied)
        signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
        mujoco.set_mjcb_control(signature(self._body.mujoco_callback()))
        # Without a handler, MuJoCo writes its warnings to a log file in the working directory.
        mujoco.set_mju_user_warning(lambda _text: None)
        self._speed = partial(multirotor.speed_radps, flight.vehicle)

    @property
    def state(self) -> Float64:
        return np.concatenate([self._data.qpos, self._data.qvel])

    def advance(self, controls: Sequence[float]) -> None:
        self._body.command(controls)
        self._data.ctrl[:] = [self._speed(min(1.0, max(0.0, u))) for u in controls]
        mujoco.mj_step(self._model, self._data, self._steps)

    def close(self) -> None:
        mujoco.set_mjcb_control(None)
        mujoco.set_mju_user_warning(None)


def _lag(vehicle: Vehicle) -> float:
    return vehicle.rotor_constants.time_constant_up_s


def attitude_error_rad(flown: Float64, exact: Float64) -> float:
    """Return the greatest angle between the attitudes of two flights, (n, 13) each.

    It is computed from the quaternions' vector part, because an arc cosine does not resolve angles below 1e-8.
    """
    a, b = flown[:, 3:7], exact[:, 3:7]
    vector = b[:, :1] * a[:, 1:] - a[:, :1] * b[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return float(np.max(2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(vector, axis=1)))))


def spin_drift(flight: Flight, end: Float64) -> dict[str, float]:
    """Return the relative drift of rotational energy, angular momentum and quaternion norm from the start to `end`."""
    inertia = np.array(flight.vehicle.inertia_kgm2)

    def energy_and_momentum(s: Float64) -> tuple[float, Float64]:
        R = np.reshape(matrix_of(s[3:7]), (3, 3))
        return 0.5 * float(np.sum(inertia * s[10:13] ** 2)), R @ (inertia * s[10:13])

    (e0, l0), (e1, l1) = energy_and_momentum(flight.start), energy_and_momentum(end)
    return {
        "energy": abs(e1 / e0 - 1.0),
        "momentum": float(np.linalg.norm(l1 - l0) / np.linalg.norm(l0)),
        "norm": abs(float(np.linalg.norm(end[3:7])) - 1.0),
    }
