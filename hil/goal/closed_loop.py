"""Flights of the explorer without an autopilot: its own code, the bench's sensors, a vehicle that follows velocities.

A flight of a minute and a half takes a few seconds, so that many villages can be tried. The vehicle follows the
velocity wanted as a quadrotor with an autopilot does:

    a_wanted = (v_wanted - v) / tau, at most a_most;   a' = (a_wanted - a) / tau_tilt;   v' = a;   p' = v

and tilts as its acceleration asks for. Frames are those of a bench with the same sensors; nothing is timed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hil.companion.bundle import Collector
from hil.companion.started import use_client
from hil.goal.clearance import Clearance
from hil.signals.samples import Quat, Sample, TruthState, Vec3
from hil.signals.time import NS_PER_S
from sim.frame.mount import Mount
from sim.frame.source import FrameSource
from sim.scene.scene import Scene
from sim.sensors.catalog import make_sensor

TICK_NS = 4_000_000
_TAU_S, _TAU_TILT_S, _MOST_MPS2 = 0.35, 0.12, 4.0
_TAU_UP_S, _MOST_UP_MPS2 = 0.3, 3.0
_YAW_GAIN_PER_S, _YAW_RATE_RADPS = 2.5, 1.5
_G_MPS2 = 9.80665
_SENSORS: dict[str, dict[str, Any]] = {
    "imu": {"preset": "icm20689", "rate_hz": 250.0},
    "gps": {"preset": "m8n", "rate_hz": 10.0},
    "baro": {"preset": "ms5611", "rate_hz": 50.0},
    "lidar": {"preset": "vlp16", "rate_hz": 10.0},
}


@dataclass
class Follower:
    """The vehicle. Velocities in W; the ground holds it until it is asked to climb."""

    p: np.ndarray
    yaw: float = 0.0
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))
    a: np.ndarray = field(default_factory=lambda: np.zeros(3))
    q: Quat = (1.0, 0.0, 0.0, 0.0)
    w: Vec3 = (0.0, 0.0, 0.0)

    def step(self, wanted_v: Sequence[float], wanted_yaw: float | None, dt_s: float) -> None:
        wanted = np.asarray(wanted_v, float)
        pull = (wanted - self.v) / np.array([_TAU_S, _TAU_S, _TAU_UP_S])
        level = math.hypot(pull[0], pull[1])
        if level > _MOST_MPS2:
            pull[:2] *= _MOST_MPS2 / level
        pull[2] = min(max(pull[2], -_MOST_UP_MPS2), _MOST_UP_MPS2)
        self.a = self.a + (pull - self.a) * (dt_s / _TAU_TILT_S)
        self.v = self.v + self.a * dt_s
        self.p = self.p + self.v * dt_s
        if wanted_yaw is not None:
            rate = _YAW_GAIN_PER_S * math.remainder(wanted_yaw - self.yaw, 2.0 * math.pi)
            self.yaw += min(max(rate, -_YAW_RATE_RADPS), _YAW_RATE_RADPS) * dt_s
        before, self.q = self.q, attitude(self.a, self.yaw)
        self.w = _rate(before, self.q, dt_s)

    def truth(self, tick: int) -> TruthState:
        def three(v: Any) -> Vec3:
            return (float(v[0]), float(v[1]), float(v[2]))

        zero = (0.0, 0.0, 0.0)
        return TruthState(
            tick, tick * TICK_NS, three(self.p), self.q, three(self.v), self.w, three(self.a), zero, (0.0,) * 4, False
        )


def attitude(a: np.ndarray, yaw: float) -> Quat:
    """With thrust along the specific force, looking along yaw."""
    z = np.array([a[0], a[1], a[2] + _G_MPS2])
    z /= np.linalg.norm(z)
    y = np.cross(z, (math.cos(yaw), math.sin(yaw), 0.0))
    y /= np.linalg.norm(y)
    R = np.stack([np.cross(y, z), y, z], axis=1)
    w = 0.5 * math.sqrt(max(1.0 + R[0, 0] + R[1, 1] + R[2, 2], 1e-12))
    if w > 1e-3:
        k = 0.25 / w
        return (w, float(R[2, 1] - R[1, 2]) * k, float(R[0, 2] - R[2, 0]) * k, float(R[1, 0] - R[0, 1]) * k)
    return (0.0, 0.0, math.cos(0.5 * math.pi + yaw), math.sin(0.5 * math.pi + yaw))  # looking back, nearly level


def _rate(before: Quat, after: Quat, dt_s: float) -> Vec3:
    """In the body: before times exp(w dt / 2) is after."""
    (w0, x0, y0, z0), (w1, x1, y1, z1) = before, after
    w = w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1
    x = w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1
    y = w0 * y1 + x0 * z1 - y0 * w1 - z0 * x1
    z = w0 * z1 - x0 * y1 + y0 * x1 - z0 * w1
    k = (2.0 if w >= 0.0 else -2.0) / dt_s
    return (k * x, k * y, k * z)


@dataclass(frozen=True)
class Flown:
    """One flight. Positions are true ones, ten a second."""

    report: Mapping[str, Any]
    t_s: np.ndarray
    p_W: np.ndarray
    wanted_W: np.ndarray
    clearance_m: float  # least, of the vehicle's edge, at the height of the flight
    path_m: float
    goal_error_m: float
    explorer: Any


def fly(
    scene: Scene,
    frames: FrameSource,
    localiser: Callable[[Mapping[str, Mapping[str, Any]]], Any],
    *,
    goal_W: tuple[float, float] = (70.0, 60.0),
    start_W: tuple[float, float] = (0.0, 0.0),
    seed: int = 1,
    radius_m: float,
    settings: Mapping[str, Any] | None = None,
    sensors: Mapping[str, Mapping[str, Any]] | None = None,
    frame_hz: int = 10,
    limit_s: float = 400.0,
    change: Callable[[TruthState, str, Any], Any] | None = None,
    watch: Callable[[Any, TruthState, Any], None] | None = None,
) -> Flown:
    """Until the explorer is finished, or `limit_s`. `localiser` is given the sensors' calibrations; `change` may alter
    a sample or take it away (None); `watch` sees explorer, truth and desired state at every frame."""
    use_client()
    from hil_companion.explore.explorer import Explorer
    from hil_companion.explore.settings import FlightSettings

    flight = FlightSettings(**dict(settings or {}))
    made, told = _make(scene, frames, seed, {**_SENSORS, **(sensors or {})})
    explorer = Explorer(flight, localiser(told), goal_W, told.get("lidar"))
    vehicle = Follower(np.array([start_W[0], start_W[1], 0.23]))
    collector = Collector(["truth", *made])
    waiting: list[tuple[int, str, Sample]] = []
    meter = Clearance(frames.geometry)
    every = round(NS_PER_S / frame_hz / TICK_NS)
    desired: Any = None
    times, places, wanteds, number = [], [], [], 0
    least, counted = math.inf, -1
    for tick in range(1, round(limit_s * NS_PER_S / TICK_NS)):
        v = (0.0, 0.0, 0.0) if desired is None else desired.v_W
        vehicle.step(v, None if desired is None else desired.yaw_rad, TICK_NS / NS_PER_S)
        truth = vehicle.truth(tick)
        for name, (sensor, period) in made.items():
            if tick % period == 0:
                sample = sensor.sample(truth, tick // period - 1)
                if change is not None:
                    sample = change(truth, name, sample)
                if sample is not None:
                    waiting.append((sample.t_available_ns, name, sample))
        due = sorted((w for w in waiting if w[0] <= truth.t_ns), key=lambda w: w[:2])
        if due:
            waiting = [w for w in waiting if w[0] > truth.t_ns]
            collector.add([(name, sample) for _, name, sample in due])
        if tick % every:
            continue
        desired = explorer.step(_frame(collector.take(number, truth).frame(["truth", *made])))
        number += 1
        if watch is not None:
            watch(explorer, truth, desired)
        times.append(truth.t_ns / NS_PER_S)
        places.append(truth.p_WB)
        wanteds.append(desired.v_W)
        if explorer.report.phase != "climb":
            counted = len(places) - 1 if counted < 0 else counted
            least = min(least, meter.nearest_m(truth.p_WB, truth.t_ns) - radius_m)
        if explorer.finished:
            break
    p_W = np.array(places)
    level = p_W[max(counted, 0) :, :2]
    path_m = float(np.hypot(*np.diff(level, axis=0).T).sum()) if len(level) > 1 else 0.0
    error_m = math.dist(p_W[-1, :2].tolist(), goal_W)
    return Flown(explorer.report.as_map(), np.array(times), p_W, np.array(wanteds), least, path_m, error_m, explorer)


def _make(
    scene: Scene, frames: FrameSource, seed: int, sensors: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, tuple[Any, int]], dict[str, dict[str, Any]]]:
    """Sensors with their periods in ticks, and their calibrations as clients are told them."""
    made, told = {}, {}
    for name, values in sensors.items():
        rest = {key: value for key, value in values.items() if key not in ("preset", "rate_hz")}
        sensor: Any = make_sensor(
            name,
            preset=values["preset"],
            rate_hz=values["rate_hz"],
            seed=seed,
            scene=scene,
            step_ns=TICK_NS,
            overrides=rest,
            frames=frames,
        )
        made[name] = (sensor, round(NS_PER_S / values["rate_hz"] / TICK_NS))
        mount = getattr(sensor, "mount", None)
        told[name] = {"kind": values["preset"], "rate_hz": values["rate_hz"]}
        if isinstance(mount, Mount):
            told[name] |= {"p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}
    return made, told


def _frame(bundle: Any) -> Any:
    """As the client's library makes it of what comes over the wire."""
    from hil_companion.frame import Frame as ClientFrame
    from hil_companion.frame import Sample as ClientSample

    samples = {
        s.topic: ClientSample(s.topic, s.seq, s.t_capture_ns, s.t_available_ns, dict(s.values), dict(s.arrays))
        for s in bundle.samples
    }
    header = {"frame": bundle.frame, "tick": bundle.tick, "t_ns": bundle.t_ns, "t_sent_ns": 0, "dropped": 0}
    return ClientFrame(header, samples, in_ring=False, t_received_ns=0)
