"""LiDAR: the cloud of points of one sweep, each with its time, ring, intensity and class.

The sweep ends at the capture: it covers [t_capture - period, t_capture). Ray i fires at `time_offset_ns[i]` (< 0) from
the capture, from the vehicle's pose at that time (sim/sensors/sweep_motion.py states the error). A sweep is divided
into `subsweeps` parts, and people and vehicles of the scene are posed at the middle of each part. With ten parts of a
sweep of 0.1 s, a limb at 5 m/s is displaced by at most 25 mm, a walking body by 8 mm. Actors that no ray of a part can
reach are not posed for that part. With `rolling: false` the whole sweep happens at the capture, and all offsets are 0.

`points_L` is the output of the device: range times direction in its own frame L (forward, left, up) at the ray's time.
The cloud of a moving vehicle is therefore distorted, and the receiver has to correct it. p_WL and q_WL are the pose at
the capture. Rays without a return are left out.

Surfaces beyond the range, rays without a geom in reach, and actors out of reach are skipped, which changes no bit of
the sample (a test compares `RayCaster.cast` with and without `tree` and `max_range`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signals._kernel import rotate_into_world
from signals.rotation import cross, matrix_of
from signals.samples import PointCloudSample, TruthState
from sim._kernels import RayCaster, Vicinity, extinguish, lambert_strength, sweep_rays
from sim.frame.mount import Mount
from sim.sensors.lidar_drops import FalseReturns
from sim.sensors.lidar_echo import Echoes, Receiver, choose_echoes, single_echoes
from sim.sensors.lidar_fog import fog_returns
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.lidar_pattern import MAX_POINTS, Sweep, casting_order
from sim.sensors.lidar_retro import Retroreflectors
from sim.sensors.lidar_sun import SunNoise, with_true_intensity
from sim.sensors.sensor import Installation, InstalledSensor, Kind
from sim.sensors.sweep_motion import Motion, at_rest, sweep_motion

Float64 = NDArray[np.float64]

# Footprint of a beam: its middle and four rays at half its radius, each with a fifth of the light.
_FOOTPRINT = ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5))


@dataclass(frozen=True)
class _Rays:
    """Rays of a sweep in B, in the order in which they are cast.

    Within a part, rays of similar direction are neighbours, because intersections are computed for eight rays at once.
    """

    sweep: Sweep  # in firing order
    fired_ns: NDArray[np.int32]  # in firing order
    place: NDArray[np.int32]  # index of each ray of `sweep` in the arrays below
    directions_B: list[Float64]  # (n, 3) for each ray of the footprint
    origins_B: Float64  # (n, 3)
    offset_ns: NDArray[np.int32]
    parts: list[slice]  # one for each pose of the scene
    orders: list[NDArray[np.int32]]  # 0, 1, 2, ... of each part


class Lidar(InstalledSensor):
    """One LiDAR on the vehicle."""

    sample_type = PointCloudSample

    def __init__(self, installation: Installation, parameters: LidarParameters) -> None:
        """Raises ValueError without `installation.frames`, or for more than `MAX_POINTS` points per sweep."""
        p, frames = parameters, installation.geometry_for("a LiDAR")
        super().__init__(installation, p.latency_s, {"range_m": p.range_resolution_m})
        count = p.pattern.points(self.period_ns)
        if count > MAX_POINTS:
            raise ValueError(
                f"sensor '{self.name}': {count} points per sweep are more than {MAX_POINTS}; raise its rate_hz"
            )
        self._p = p
        self.sweep_ns = self.period_ns if p.rolling else 0  # duration of a sweep
        self.ring_elevations_deg = p.pattern.ring_elevations_deg
        self._frames = frames
        self._caster: RayCaster = frames.geometry.caster
        world = frames.geometry.world
        self._two_way_per_m = 2.0 * installation.scene.extinction_per_m
        self._class = np.append(np.array(world.geom_class, dtype=np.uint8), np.uint8(0))  # and of a drop
        by_surface = np.array([surface.lidar_reflectivity for surface in world.surfaces])
        self._reflectivity = by_surface[np.array(world.geom_surface)]
        self.mount = Mount(p.mount_m, p.mount_rpy_deg, optical=False)
        self._pattern = p.pattern.over(self.period_ns)
        self._receiver = Receiver(p, rays=count, seed=installation.seed, name=self.name)
        self._retro = Retroreflectors.of(world) if p.retroreflectors else None
        self._sun: SunNoise | None = None
        if p.sunlight is not None:
            of_geom = np.append(self._reflectivity, 0.0)  # and of a drop
            self._sun = SunNoise.of(installation.scene, p, of_geom, seed=installation.seed, name=self.name)
        self._drops = self._false_returns(installation)
        self._fog = fog_returns(
            installation.scene.haze_per_m, p, seed=installation.seed, name=self.name, geom_of_drop=len(self._class) - 1
        )
        self._footprint = _FOOTPRINT if p.beam_divergence_rad > 0.0 else _FOOTPRINT[:1]
        m = len(self._footprint)
        self._range = np.empty((m, count))
        self._geom = np.empty((m, count), np.int32)
        self._normal = np.empty((count, 3))
        self._strength = np.empty((m, count))
        self._origins_W = np.empty((count, 3))
        self._directions_W = np.empty((count, 3))
        self._rays: _Rays | None = None
        self._before: TruthState | None = None
        self.sweeps = self.returns = 0  # so far; returns of all sweeps

    def set_previous_truth(self, before: TruthState | None) -> None:
        """Set the true state at the previous sweep, for callers that do not take sweeps in order."""
        self._before = before

    def sample(self, truth: TruthState, seq: int) -> PointCloudSample:
        """Return sweep `seq`. The first sweep assumes motion with constant accelerations."""
        p, t_ns = self._p, truth.t_ns
        rays = self._ready(seq)
        motion = sweep_motion(truth, self._recent(t_ns)) if p.rolling else at_rest(truth)
        self._before = truth
        for i, part in enumerate(rays.parts):
            if part.start != part.stop:
                self._cast(rays, i, motion, self._middle_ns(i, len(rays.parts), t_ns))
        self._frames.expect(t_ns)
        echoes = self._echoes(rays, seq)
        dimmed = None
        if self._sun is not None:
            n = len(rays.place)
            seen = self._sun.seen(echoes, self._normal[:n], self._directions_W[:n], rays.place, seq)
            echoes, dimmed = seen.echoes, seen.dimmed
        self._measured = rays, echoes.geom, motion
        cloud = self._receiver.measure(
            echoes,
            seq,
            sweep=rays.sweep,
            place=rays.place,
            offset_ns=rays.fired_ns,
            geom_class=self._class,
        )
        if dimmed is not None:
            cloud = with_true_intensity(cloud, dimmed[rays.place[self._receiver.reported]])
        self.sweeps += 1
        self.returns += len(cloud[0])
        p_WL, q_WL = self.mount.place(truth)
        return PointCloudSample(seq, t_ns, t_ns + self.latency_ns, p_WL, q_WL, *cloud)

    def instances(self) -> NDArray[np.uint16]:
        """Return the instance of each point of the last sample: an index of the world's `instance_names`."""
        rays, geom, _ = self._measured
        of_geom = np.append(np.asarray(self._frames.geometry.world.geom_instance, np.uint16), np.uint16(0))  # of a drop
        return of_geom[geom[rays.place[self._receiver.reported]]]

    def points_at_capture(self, sample: PointCloudSample) -> NDArray[np.float32]:
        """Return the points of the last sample, (n, 3) [m], as if all rays had been fired at the capture, in L.

        Each point keeps its measured range along its ray: the motion of the vehicle is taken out, that of what was hit
        is not.
        """
        rays, _, motion = self._measured
        n = len(rays.offset_ns)
        origins_W, directions_W = np.empty((n, 3)), np.empty((n, 3))
        sweep_rays(motion, rays.offset_ns, rays.origins_B, rays.directions_B[0], origins_W, directions_W)
        ray = rays.place[self._receiver.reported]
        points_W = origins_W[ray] + sample.range_m[:, None].astype(np.float64) * directions_W[ray]
        R_WL = np.array(matrix_of(sample.q_WL)).reshape(3, 3)
        return ((points_W - np.array(sample.p_WL)) @ R_WL).astype(np.float32)

    def _recent(self, t_ns: int) -> TruthState | None:
        """Return the previous truth if it is recent enough to give the motion during this sweep, else None."""
        before = self._before
        return before if before is not None and 0 < t_ns - before.t_ns <= 2 * self.period_ns else None

    def _ready(self, seq: int) -> _Rays:
        """Return the rays of sweep `seq`, prepared anew only if they differ from the previous sweep's."""
        sweep = self._pattern.sweep(seq)
        if self._rays is None or self._rays.sweep is not sweep:
            self._rays = self._prepare(sweep)
        return self._rays

    def _prepare(self, sweep: Sweep) -> _Rays:
        p, mount = self._p, self.mount
        rotation = [rotate_into_world(mount.q_BC, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        columns = np.array(rotation)  # row i: axis i of L, in B
        d = sweep.directions_L
        origins_B = np.array(p.mount_m) + sweep.origin_z_m[:, None] * columns[2]
        across, upward = _perpendicular(d)
        directions_B = []
        for a, b in self._footprint:
            radius = 0.5 * p.beam_divergence_rad  # of the cone, as an angle; the tangent is taken as equal
            tilted = _unit(d + (a * radius) * across + (b * radius) * upward) if a or b else d
            directions_B.append(tilted[:, :1] * columns[0] + tilted[:, 1:2] * columns[1] + tilted[:, 2:] * columns[2])
        n = len(d)
        offset_ns = sweep.time_offset_ns if p.rolling else np.zeros(n, np.int32)
        parts = [slice(0, n)]
        if p.rolling and p.subsweeps > 1:
            edges = [-self.period_ns + self.period_ns * k // p.subsweeps for k in range(1, p.subsweeps)]
            starts = [0, *np.searchsorted(offset_ns, edges).tolist(), n]
            parts = [slice(a, b) for a, b in pairwise(starts)]
        order = np.concatenate([part.start + casting_order(d[part], sweep.ring[part]) for part in parts])
        place = np.empty(n, np.int32)
        place[order] = np.arange(n, dtype=np.int32)
        return _Rays(
            sweep,
            offset_ns,
            place,
            [directions[order] for directions in directions_B],
            origins_B[order],
            offset_ns[order],
            parts,
            [np.arange(part.stop - part.start, dtype=np.int32) for part in parts],
        )

    def _middle_ns(self, i: int, count: int, t_ns: int) -> int:
        """Return the time at which the scene is posed for part `i` of `count`."""
        if not self._p.rolling:
            return t_ns
        return max(0, t_ns - self.period_ns + self.period_ns * (2 * i + 1) // (2 * count))

    def _cast(self, rays: _Rays, i: int, motion: Motion, t_ns: int) -> None:
        """Cast part `i` of the sweep, every ray of the footprint, in the scene at `t_ns`."""
        part, farthest = rays.parts[i], self._receiver.farthest_m
        origins_W, directions_W, normal = self._origins_W[part], self._directions_W[part], self._normal[part]
        for k, directions_B in enumerate(rays.directions_B):
            box = sweep_rays(
                motion, rays.offset_ns[part], rays.origins_B[part], directions_B[part], origins_W, directions_W
            )
            if k == 0:  # the rays of a footprint have the same origin
                self._frames.expect(t_ns)
                self._frames.geometry.pose_within(Vicinity(*box, farthest))
            range_m, geom = self._range[k, part], self._geom[k, part]
            self._caster.cast(origins_W, directions_W, 0.0, farthest, range_m, geom, normal, order=rays.orders[i])
            strength = self._strength[k, part]
            lambert_strength(geom, normal, directions_W, self._reflectivity, strength)
            if self._retro is not None:
                self._retro.add(geom, normal, directions_W, strength)
            if self._two_way_per_m > 0.0:
                extinguish(range_m, self._two_way_per_m, strength)

    def _echoes(self, rays: _Rays, seq: int) -> Echoes:
        p = self._p
        if len(self._footprint) == 1:
            echoes = single_echoes(self._range[0], self._strength[0], self._geom[0])
        else:
            echoes = choose_echoes(
                self._range, self._strength, self._geom, which=p.echo, separation_m=p.echo_separation_m
            )
        if self._drops is not None:
            echoes = self._drops.added(echoes, rays.place, seq * len(rays.place))
        return echoes if self._fog is None else self._fog.added(echoes, rays.place, seq)

    def _false_returns(self, installation: Installation) -> FalseReturns | None:
        falling = installation.scene.weather.precipitation
        if falling is None:
            return None
        return FalseReturns(
            falling,
            self._p,
            extinction_per_m=installation.scene.extinction_per_m,
            seed=installation.seed,
            name=self.name,
            geom_of_drop=len(self._class) - 1,
        )


def _unit(v: Float64) -> Float64:
    return v / np.sqrt(v[:, :1] * v[:, :1] + v[:, 1:2] * v[:, 1:2] + v[:, 2:] * v[:, 2:])


def _perpendicular(d: Float64) -> tuple[Float64, Float64]:
    """Return two unit vectors across each direction: one level, one upward."""
    level = np.zeros_like(d)
    level[:, 0], level[:, 1] = -d[:, 1], d[:, 0]
    steep = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] < 1e-12  # straight up or down: any level direction is valid
    level[steep] = (0.0, 1.0, 0.0)
    level = _unit(level)
    return level, np.stack(cross(d.T, level.T), axis=-1)


KIND = Kind(Lidar, LidarParameters)
