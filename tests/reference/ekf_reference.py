"""A small quadrotor in plain Python that closes the loop round the flight core, independent of the bench's physics.

NED/FRD, SI. Rigid body with motor lag (T = k (1000 u)^2 in steady state), linear drag against wind, flat ground with a
spring-damper under the centre of mass, levelling and gripping while the vehicle stands. IMU (means over the 4 ms tick),
GPS with delay, barometer and magnetometer, each with white noise and fixed biases. Of the code under test it uses
inputs and outputs only.
"""

from __future__ import annotations

import itertools
import math
import random
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from firmware_bridge import _native

GRAVITY = 9.81
TICK_US = 4000
SUBSTEPS = 2
DECLINATION_DEG = 2.0
FIELD_N = (
    0.21 * math.cos(math.radians(DECLINATION_DEG)),
    0.21 * math.sin(math.radians(DECLINATION_DEG)),
    0.43,
)
HOME = (47.397742, 8.545594, 488.0)

OFF, IDLE, POSITION, VELOCITY, ATTITUDE, RATE = range(6)
NAN = math.nan

PARAM = {name: i for i, name in enumerate(_native.PARAM_NAMES)}


def parameters(**changes: float) -> np.ndarray:
    """Return default parameters with the given changes and the world's declination and gravity."""
    values = np.array(_native.PARAM_DEFAULTS)
    for name, value in {"EKF_MAG_DECL": DECLINATION_DEG, "EKF_GRAVITY": GRAVITY, **changes}.items():
        values[PARAM[name]] = value
    return values


@dataclass
class Airframe:
    """Mass properties and rotors: (x forward, y right, spin) with +1 for counter-clockwise seen from above."""

    mass: float = 2.06
    inertia: tuple[float, float, float] = (0.0217, 0.0217, 0.04)
    rotors: tuple[tuple[float, float, float], ...] = (
        (0.174, 0.174, 1.0),
        (-0.174, -0.174, 1.0),
        (0.174, -0.174, -1.0),
        (-0.174, 0.174, -1.0),
    )
    thrust_k: float = 8.54858e-6
    moment_ratio: float = 0.016
    tau_up: float = 0.0125
    tau_down: float = 0.025
    drag: float = 0.3  # N per m/s


@dataclass
class SensorNoise:
    """Standard deviations per sample, fixed biases, GPS delay."""

    gyro: float = 0.002
    accel: float = 0.03
    gyro_bias: tuple[float, float, float] = (0.01, -0.008, 0.005)
    accel_bias: tuple[float, float, float] = (0.05, -0.04, 0.06)
    gps_p: float = 0.02
    gps_v: float = 0.05
    baro: float = 0.2
    baro_offset: float = 12.0
    mag: float = 0.003
    gps_delay_ticks: int = 25


@dataclass
class Log:
    """One row per tick: t [s], true position and velocity NED [m, m/s], estimated position, tilt [rad]."""

    t: list[float] = field(default_factory=list)
    p: list[tuple[float, float, float]] = field(default_factory=list)
    v: list[tuple[float, float, float]] = field(default_factory=list)
    p_est: list[tuple[float, float, float]] = field(default_factory=list)
    tilt: list[float] = field(default_factory=list)


def rotate(q: tuple[float, float, float, float], v: tuple[float, float, float]) -> tuple[float, float, float]:
    """Rotate from body to NED."""
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def unrotate(q: tuple[float, float, float, float], v: tuple[float, float, float]) -> tuple[float, float, float]:
    """Rotate from NED to body."""
    return rotate((q[0], -q[1], -q[2], -q[3]), v)


class Flight:
    """The vehicle, its sensors and the core under test, 250 Hz."""

    def __init__(
        self,
        *,
        seed: int = 1,
        params: np.ndarray | None = None,
        noise: SensorNoise | None = None,
        airframe: Airframe | None = None,
        yaw_rad: float = 0.7,
        wind_N: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.core = _native.FlightCore(parameters() if params is None else params)
        self.state, self.controls = self.core.state, self.core.controls
        self.noise = noise or SensorNoise()
        self.frame = airframe or Airframe()
        self.wind = wind_N
        self.random = random.Random(seed)
        self.q = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
        self.p, self.v, self.w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.motor = [0.0] * len(self.frame.rotors)
        self.tick = 0
        self.fixes: deque[tuple[int, tuple[float, ...]]] = deque()
        self.log = Log()
        self.gps_on = self.mag_on = self.baro_on = True
        self.plane = Plane(HOME)

    @property
    def t(self) -> float:
        return self.tick * TICK_US * 1e-6

    def get(self, name: str) -> tuple[float, ...]:
        offset, size = _native.STATE_FIELDS[name]
        return tuple(self.state[offset : offset + size].tolist())

    def _substep(self, dt: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Advance dt; returns angular rate and specific force in the body."""
        f = self.frame
        thrust, tx, ty, tz = 0.0, 0.0, 0.0, 0.0
        for i, (x, y, spin) in enumerate(f.rotors):
            u = self.controls.item(i)
            tau = f.tau_up if u > self.motor[i] else f.tau_down
            self.motor[i] += (u - self.motor[i]) * (1.0 - math.exp(-dt / tau))
            force = f.thrust_k * (1000.0 * self.motor[i]) ** 2
            thrust += force
            tx -= y * force
            ty += x * force
            tz += spin * f.moment_ratio * force
        air = tuple(v - w for v, w in zip(self.v, self.wind, strict=True))
        up = rotate(self.q, (0.0, 0.0, -thrust))
        force_N = [up[i] - f.drag * air[i] for i in range(3)]
        standing = self.p[2] > -1e-3
        if standing:
            push = max(0.0, 4000.0 * self.p[2] + 120.0 * self.v[2])
            force_N[2] -= push
            grip = min(1.0, push / 5.0) * 8.0
            force_N[0] -= grip * self.v[0]
            force_N[1] -= grip * self.v[1]
            # Legs: the ground levels the vehicle and stops its rotation, in proportion to the contact force.
            load = min(1.0, push / 10.0)
            down = unrotate(self.q, (0.0, 0.0, 1.0))
            tx += load * (-4.0 * down[1] - 0.6 * self.w[0])
            ty += load * (4.0 * down[0] - 0.6 * self.w[1])
            tz -= load * 0.5 * self.w[2]
        jx, jy, jz = f.inertia
        wx, wy, wz = self.w
        wx += (tx - (jz - jy) * wy * wz) / jx * dt
        wy += (ty - (jx - jz) * wz * wx) / jy * dt
        wz += (tz - (jy - jx) * wx * wy) / jz * dt
        self.w = (wx, wy, wz)
        specific_N = tuple(c / f.mass for c in force_N)
        a = (specific_N[0], specific_N[1], specific_N[2] + GRAVITY)
        self.p = tuple(p + v * dt + 0.5 * ai * dt * dt for p, v, ai in zip(self.p, self.v, a, strict=True))
        self.v = tuple(v + ai * dt for v, ai in zip(self.v, a, strict=True))
        angle = math.sqrt(wx * wx + wy * wy + wz * wz) * dt
        s = 0.5 * dt * (math.sin(angle / 2) / (angle / 2) if angle > 1e-9 else 1.0)
        c = math.cos(angle / 2)
        w, x, y, z = self.q
        half = self._times((w, x, y, z), (math.cos(angle / 4), 0.5 * s * wx, 0.5 * s * wy, 0.5 * s * wz))
        force_F = unrotate(half, specific_N)
        q = self._times((w, x, y, z), (c, s * wx, s * wy, s * wz))
        n = math.sqrt(sum(qi * qi for qi in q))
        self.q = tuple(qi / n for qi in q)
        return self.w, force_F

    @staticmethod
    def _times(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float, float, float]:
        return (
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        )

    def step(self) -> None:
        """Run one tick: physics on the last controls, sensors, the core."""
        self.tick += 1
        t_us = self.tick * TICK_US
        rates = [0.0, 0.0, 0.0]
        forces = [0.0, 0.0, 0.0]
        for _ in range(SUBSTEPS):
            w, f = self._substep(TICK_US * 1e-6 / SUBSTEPS)
            for i in range(3):
                rates[i] += w[i] / SUBSTEPS
                forces[i] += f[i] / SUBSTEPS
        n, gauss = self.noise, self.random.gauss
        if self.tick % 25 == 0:
            fix = [*self.p, *self.v]
            for i in range(3):
                fix[i] += gauss(0.0, n.gps_p)
                fix[i + 3] += gauss(0.0, n.gps_v)
            self.fixes.append((self.tick + n.gps_delay_ticks, tuple(fix)))
        while self.fixes and self.fixes[0][0] <= self.tick:
            fix = self.fixes.popleft()[1]
            if self.gps_on:
                lat, lon, alt = self.plane.geodetic(fix[0], fix[1], fix[2])
                self.core.update_gps(
                    t_us, lat, lon, alt, fix[3], fix[4], fix[5], max(n.gps_p, 0.01), max(n.gps_p, 0.01)
                )
        gyro = [rates[i] + n.gyro_bias[i] + gauss(0.0, n.gyro) for i in range(3)]
        accel = [forces[i] + n.accel_bias[i] + gauss(0.0, n.accel) for i in range(3)]
        self.core.step(t_us, *gyro, *accel)
        if self.tick % 5 == 0 and self.baro_on:
            self.core.update_baro(t_us, HOME[2] - self.p[2] + n.baro_offset + gauss(0.0, n.baro))
        if self.tick % 5 == 2 and self.mag_on:
            m = unrotate(self.q, FIELD_N)
            self.core.update_mag(t_us, *(mi + gauss(0.0, n.mag) for mi in m))
        log = self.log
        log.t.append(self.t)
        log.p.append(self.p)
        log.v.append(self.v)
        log.p_est.append(tuple(self.state[1:4].tolist()))
        log.tilt.append(math.acos(max(-1.0, min(1.0, rotate(self.q, (0, 0, 1))[2]))))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e6 / TICK_US)):
            self.step()

    def set(self, kind: int, **values: float) -> None:
        assert self.core.set_setpoint(kind, **values)

    def ready(self) -> None:
        """Return a flight on the ground, aligned, with a position."""
        self.set(OFF)
        self.run(3.0)
        assert self.core.state.item(_native.STATE_FIELDS["position_ok"][0]) == 1.0

    def take_off(self, height_m: float = 5.0, seconds: float = 8.0) -> None:
        self.set(IDLE)
        self.run(0.5)
        yaw = self.get("euler")[2]
        self.set(POSITION, x=self.get("p_NF")[0], y=self.get("p_NF")[1], z=-height_m, yaw=yaw)
        self.run(seconds)

    def offset(self) -> tuple[float, float, float]:
        """Return estimated minus true position: the origin is a noisy fix, which shifts the local frame."""
        o = self.plane.ned(*self.get("origin"))
        return (-o[0], -o[1], -o[2])


class Plane:
    """Geodetic <-> NED on WGS 84 by pymap3d, the oracle; linearised once for speed (error < 1 mm within 200 m)."""

    def __init__(self, home: tuple[float, float, float]) -> None:
        import pymap3d

        self.home = home
        step = 1e-3
        n1, _, _ = pymap3d.geodetic2ned(home[0] + step, home[1], home[2], *home)
        n0, _, _ = pymap3d.geodetic2ned(home[0] - step, home[1], home[2], *home)
        _, e1, _ = pymap3d.geodetic2ned(home[0], home[1] + step, home[2], *home)
        self.north_per_deg = float(n1 - n0) / (2 * step)
        self.east_per_deg = float(e1) / step

    def geodetic(self, n: float, e: float, d: float) -> tuple[float, float, float]:
        return self.home[0] + n / self.north_per_deg, self.home[1] + e / self.east_per_deg, self.home[2] - d

    def ned(self, lat: float, lon: float, alt: float) -> tuple[float, float, float]:
        return (
            (lat - self.home[0]) * self.north_per_deg,
            (lon - self.home[1]) * self.east_per_deg,
            self.home[2] - alt,
        )


def smooth_legs(
    points: list[tuple[float, float, float]], speed: float, accel: float
) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Return position and velocity per tick along straight legs, stopping at each point (trapezoidal speed)."""
    dt = TICK_US * 1e-6
    out = []
    for a, b in itertools.pairwise(points):
        length = math.dist(a, b)
        direction = [(q - p) / length for p, q in zip(a, b, strict=True)]
        top = min(speed, math.sqrt(length * accel))
        ramp = top / accel
        total = 2 * ramp + (length - top * ramp) / top
        for k in range(1, math.ceil(total / dt) + 1):
            t = min(k * dt, total)
            if t < ramp:
                s, v = 0.5 * accel * t * t, accel * t
            elif t < total - ramp:
                s, v = 0.5 * top * ramp + top * (t - ramp), top
            else:
                left = total - t
                s, v = length - 0.5 * accel * left * left, accel * left
            out.append((tuple(p + d * s for p, d in zip(a, direction, strict=True)), tuple(d * v for d in direction)))
    return out
