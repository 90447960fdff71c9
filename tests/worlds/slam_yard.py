"""A yard in closed form, and a companion's sensor samples of a flight in it: walls, a flat roof, a walker.

Walls are upright rectangles, rays meet them in closed form; the flight is a circle, so gyro and accelerometer are known
exactly. No noise, unless a test adds some.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.worlds.scripted_bench import CLIENT  # puts the client on the path

from hil_companion.frame import Sample  # isort: skip

assert CLIENT

G = 9.80665
RINGS_DEG = tuple(float(e) for e in range(-15, 16, 2))  # by ring, from the lowest
COLUMNS = 720
TOGETHER = 5  # columns that fire at the same time
IMU_NS = 4_000_000
FRAME_NS = 100_000_000
HEIGHT_M = 10.0
ROOF_M = 6.0
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.0, 8.0, 500.0

Float64 = NDArray[np.float64]
# x0, y0, x1, y1, height: a yard, a block in it, a low house with a flat roof
WALLS = np.array(
    [
        (-22.1, -17.2, 24.3, -17.2, 15.0), (24.3, -17.2, 24.3, 19.4, 15.0), (24.3, 19.4, -22.1, 19.4, 15.0),
        (-22.1, 19.4, -22.1, -17.2, 15.0), (12.0, 9.0, 16.0, 9.0, 13.0), (12.0, 9.0, 12.0, 13.0, 13.0),
        (-15.0, -12.0, -8.0, -12.0, ROOF_M), (-8.0, -12.0, -8.0, -6.0, ROOF_M), (-8.0, -6.0, -15.0, -6.0, ROOF_M),
        (-15.0, -6.0, -15.0, -12.0, ROOF_M),
    ]
)  # fmt: skip


class Frame(dict[str, Sample]):
    """Frame of samples by topic."""

    def __init__(self, t_ns: int) -> None:
        super().__init__()
        self.t_ns = t_ns


@dataclass
class Circle:
    """Trajectory: rest, then a circle with an eased speed, heading along it, banked like a quadrotor."""

    radius_m: float = 5.0
    speed_mps: float = 2.0
    rest_s: float = 1.0
    ease_s: float = 2.0
    lidar_p_BL: tuple[float, float, float] = (0.0, 0.0, 0.12)
    walker: Callable[[float], tuple[float, float]] | None = None  # position of a pillar of 0.6 m diameter, by time
    start: tuple[float, float, float, float] = field(init=False)

    def __post_init__(self) -> None:
        p, R = self.at(0.0)
        self.start = (p[0], p[1], p[2], float(np.arctan2(R[1, 0], R[0, 0])))

    def angle(self, t: Float64) -> Float64:
        """Return the angle along the circle [rad]; its speed rises as a half cosine."""
        s, w = np.maximum(t - self.rest_s, 0.0), self.speed_mps / self.radius_m
        eased = 0.5 * (s - self.ease_s / np.pi * np.sin(np.pi * np.minimum(s, self.ease_s) / self.ease_s))
        return w * np.where(s < self.ease_s, eased, s - 0.5 * self.ease_s)

    def places(self, t: Float64) -> Float64:
        """Return positions (n, 3)."""
        a = self.angle(t)
        return np.stack([self.radius_m * np.cos(a), self.radius_m * np.sin(a), np.full(a.shape, HEIGHT_M)], axis=-1)

    def place(self, t: float) -> Float64:
        """Return the position (3,)."""
        return self.places(np.array([t]))[0]

    def poses(self, t: Float64) -> tuple[Float64, Float64]:
        """Return positions and attitudes."""
        h = 1e-3
        p = self.places(t)
        up = (self.places(t + h) - 2.0 * p + self.places(t - h)) / (h * h) + (0.0, 0.0, G)
        up /= np.linalg.norm(up, axis=1)[:, None]
        heading = self.angle(t) + 0.5 * np.pi
        left = np.cross(up, np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=-1))
        left /= np.linalg.norm(left, axis=1)[:, None]
        return p, np.stack([np.cross(left, up), left, up], axis=-1)

    def at(self, t: float) -> tuple[Float64, Float64]:
        """Return position and attitude."""
        p, R = self.poses(np.array([t]))
        return p[0], R[0]

    def velocities(self, t: Float64) -> Float64:
        """Return velocities in W."""
        h = 1e-4
        return (self.places(t + h) - self.places(t - h)) / (2.0 * h)

    def velocity(self, t: float) -> Float64:
        """Return the velocity in W."""
        return self.velocities(np.array([t]))[0]

    def imu(self, times_ns: list[int]) -> tuple[list[list[float]], list[list[float]]]:
        """Return gyro and accelerometer rows, each the mean over the time since the row before."""
        t, dt = np.array(times_ns) * 1e-9, IMU_NS * 1e-9
        before, now, middle = (self.poses(t - back * dt)[1] for back in (1.0, 0.0, 0.5))
        turn = np.einsum("nji,njk->nik", before, now)
        gyro = np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], -1
        )
        a = (self.velocities(t) - self.velocities(t - dt)) / dt + (0.0, 0.0, G)
        return (0.5 * gyro / dt).tolist(), np.einsum("nji,nj->ni", middle, a).tolist()

    def sweep(self, t_ns: int) -> Sample:
        """Return the sweep of the 0.1 s before `t_ns`, each column fired from the vehicle's pose at its time."""
        up = np.radians(RINGS_DEG)
        azimuth = (np.arange(COLUMNS) + 0.5) * (2.0 * np.pi / COLUMNS)
        d_L = np.empty((COLUMNS, len(up), 3))
        d_L[:, :, 0], d_L[:, :, 1] = np.cos(azimuth)[:, None] * np.cos(up), np.sin(azimuth)[:, None] * np.cos(up)
        d_L[:, :, 2] = np.sin(up)
        groups = np.arange(COLUMNS) // TOGETHER
        offset_ns = -FRAME_NS + FRAME_NS * TOGETHER * np.arange(COLUMNS // TOGETHER) // COLUMNS
        p, R = self.poses((t_ns + offset_ns) * 1e-9)
        origin = (p + R @ np.array(self.lidar_p_BL))[groups]
        d_W = np.einsum("kij,krj->kri", R[groups], d_L)
        range_m = self._ranges(np.repeat(origin, len(up), axis=0), d_W.reshape(-1, 3), t_ns * 1e-9).reshape(COLUMNS, -1)
        met = np.isfinite(range_m)
        column, ring = np.nonzero(met)
        values = {
            "points_L": (range_m[met, None] * d_L[met]).astype(np.float32),
            "ring": ring.astype(np.uint8),
            "time_offset_ns": offset_ns[groups[column]].astype(np.int32),
        }
        return Sample("", 0, t_ns, t_ns, values, {})

    def frames(self, seconds: float) -> list[Frame]:
        """Yield frames at 10 Hz."""
        made = []
        for t_ns in range(0, round(seconds * 1e9), FRAME_NS):
            frame = Frame(t_ns)
            times = list(range(max(0, t_ns - FRAME_NS + IMU_NS), t_ns + 1, IMU_NS))
            gyro, accel = self.imu(times)
            frame["imu"] = Sample(
                "", 0, t_ns, t_ns, {"t_capture_ns": times, "gyro_radps": gyro, "accel_mps2": accel}, {}
            )
            frame["gps"] = self._gps(t_ns)
            baro = {"t_capture_ns": [t_ns], "pressure_altitude_m": [ALTITUDE_M + HEIGHT_M]}
            frame["baro"] = Sample("", 0, t_ns, t_ns, baro, {})
            frame["lidar"] = self.sweep(t_ns)
            made.append(frame)
        return made

    def _gps(self, t_ns: int) -> Sample:
        x, y, _ = self.place(t_ns * 1e-9)
        s = np.sin(np.radians(LATITUDE_DEG))
        n = 6378137.0 / np.sqrt(1.0 - 6.69437999014e-3 * s * s)
        m = n * (1.0 - 6.69437999014e-3) / (1.0 - 6.69437999014e-3 * s * s)
        h = ALTITUDE_M + HEIGHT_M
        row = {
            "t_capture_ns": t_ns,
            "latitude_deg": LATITUDE_DEG + np.degrees(y / (m + h)),
            "longitude_deg": LONGITUDE_DEG + np.degrees(x / ((n + h) * np.cos(np.radians(LATITUDE_DEG)))),
            "altitude_m": h,
            "v_W": tuple(self.velocity(t_ns * 1e-9)),
            "horizontal_accuracy_m": 1.5,
            "fix_type": 3,
        }
        return Sample("", 0, t_ns, t_ns, {name: [value] for name, value in row.items()}, {})

    def _ranges(self, origin: Float64, d: Float64, t: float) -> Float64:
        """Return the range to the nearest of walls, ground, roof and walker; inf without a hit."""
        walls = WALLS
        if self.walker is not None:
            x, y = self.walker(t)
            h = 0.3
            corners = [(x - h, y - h), (x + h, y - h), (x + h, y + h), (x - h, y + h)]
            pillar = [(*corners[i], *corners[(i + 1) % 4], 12.0) for i in range(4)]
            walls = np.concatenate([walls, np.array(pillar)])
        along = walls[:, 2:4] - walls[:, :2]
        off = walls[:, :2] - origin[:, None, :2]
        cross = d[:, None, 0] * along[:, 1] - d[:, None, 1] * along[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            r = (off[:, :, 0] * along[:, 1] - off[:, :, 1] * along[:, 0]) / cross
            s = (off[:, :, 0] * d[:, None, 1] - off[:, :, 1] * d[:, None, 0]) / cross
            z = origin[:, 2:] + r * d[:, None, 2]
            met = (r > 0.0) & (s >= 0.0) & (s <= 1.0) & (z > 0.0) & (z < walls[:, 4])
            best = np.where(met, r, np.inf).min(axis=1)
            for level, inside in ((0.0, None), (ROOF_M, (-15.0, -12.0, -8.0, -6.0))):
                r = (level - origin[:, 2]) / d[:, 2]
                p = origin[:, :2] + r[:, None] * d[:, :2]
                hit = (r > 0.0) & (r < 80.0)
                if inside is not None:
                    hit &= (p[:, 0] > inside[0]) & (p[:, 1] > inside[1]) & (p[:, 0] < inside[2]) & (p[:, 1] < inside[3])
                best = np.where(hit, np.minimum(best, r), best)
        return best


def wall_distance_m(xy: Float64) -> Float64:
    """Return the horizontal distance from the nearest wall."""
    best = np.full(len(xy), np.inf)
    for x0, y0, x1, y1, _ in WALLS:
        a, b = np.array([x0, y0]), np.array([x1, y1])
        s = np.clip(((xy - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(xy - a - s[:, None] * (b - a), axis=1))
    return best
