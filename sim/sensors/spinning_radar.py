"""Spinning radar: a narrow beam that turns once about z_L in a revolution, and codes of power by azimuth and range.

A revolution ends at the capture: azimuth k of K is measured at t_capture - period (1 - (k + 1/2) / K), clockwise from
ahead as seen from above, from the vehicle's pose at that time; people and vehicles of the scene are posed at the middle
of each of `subsweeps` parts. Power: sim/radar/spinning.py.

The sample is the cloud of the strongest peaks over range of each azimuth: cells above the noise by `threshold_db`, not
weaker than both neighbours, `max_points` at most. A point lies in the plane of the beam's axis (z_L = 0), for elevation
is not measured; its intensity is code / 255, its class that of its strongest echo. `polar` has all codes of the last
revolution.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import rotate_into_world
from signals.noise import noise_key
from signals.rotation import dot, matrix_of
from signals.samples import PointCloudSample, TruthState
from sim._kernels import Vicinity, sweep_rays
from sim.frame.mount import Mount
from sim.radar.spinning import CODES, Beam, SpinningBeam
from sim.sensors.sensor import Attitude, Installation, InstalledSensor, Kind, Position
from sim.sensors.sweep_motion import Motion, at_rest, sweep_motion

_ZERO = (0.0, 0.0, 0.0)


class SpinningRadarParameters(Beam):
    """A beam and its receiver, and what of a revolution becomes points."""

    threshold_db: Annotated[float, Field(ge=0.0, le=100.0)] = 15.0  # of a point over the mean noise
    max_points: Annotated[int, Field(ge=1, le=256)] = 12  # of an azimuth
    rolling: bool = True  # false: the whole revolution at the instant of capture
    subsweeps: Annotated[int, Field(ge=1, le=16)] = 10
    mount_m: Position = _ZERO
    mount_rpy_deg: Attitude = _ZERO
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class SpinningRadar(InstalledSensor):
    """One spinning radar on the vehicle."""

    sample_type = PointCloudSample

    def __init__(self, installation: Installation, parameters: SpinningRadarParameters) -> None:
        """Raises ValueError without `installation.frames`."""
        p, frames = parameters, installation.geometry_for("a spinning radar")
        super().__init__(installation, p.latency_s, {"range_m": p.bin_m})
        self._p, self._frames = p, frames
        world = frames.geometry.world
        self.mount = Mount(p.mount_m, p.mount_rpy_deg, optical=False)
        self.sweep_ns = self.period_ns if p.rolling else 0
        self.beam: Beam = p
        self._beam = SpinningBeam(p, tuple(world.surfaces))
        self._surface = np.append(np.asarray(world.geom_surface, np.int64), 0)  # and of no hit
        self._class = np.append(np.asarray(world.geom_class, np.uint8), np.uint8(0))
        self._instance = np.append(np.asarray(world.geom_instance, np.uint16), np.uint16(0))
        axes = [rotate_into_world(self.mount.q_BC, axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))]
        self._axes_B = np.array(axes)  # rows: axes of L
        d, (x, y, z) = self._beam.directions_L, self._axes_B
        self._directions_B = d[:, :1] * x + d[:, 1:2] * y + d[:, 2:] * z
        n = len(d)
        self._origins_B = np.tile(np.array(p.mount_m), (n, 1))
        columns, azimuth = self._beam.columns, np.arange(p.azimuths)
        column = np.clip(self._beam.column, 0, columns - 1)
        offset_ns = -self.period_ns + self.period_ns * (2 * column + 1) // (2 * columns)
        self._offset_ns = (offset_ns if p.rolling else np.zeros(n)).astype(np.int32)
        of_azimuth = -self.period_ns + self.period_ns * (2 * azimuth + 1) // (2 * p.azimuths)
        self._azimuth_ns = (of_azimuth if p.rolling else np.zeros(p.azimuths)).astype(np.int32)
        count = p.subsweeps if p.rolling else 1
        edges = [0, *np.searchsorted(column, [columns * i // count for i in range(1, count)]).tolist(), n]
        self._parts = [slice(a, b) for a, b in pairwise(edges)]
        self._range, self._geom = np.empty(n), np.empty(n, np.int32)
        self._normal, self._origins_W, self._directions_W = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
        self._key = noise_key(installation.seed, f"{self.name}.power")
        self._before: TruthState | None = None
        self.polar: NDArray[np.uint8] = np.zeros(self._beam.shape, np.uint8)  # codes of the last revolution
        self.power_w = np.zeros(self._beam.shape)  # the same without noise
        self._point_geom = np.empty(0, np.int64)
        self._point_azimuth = np.empty(0, np.int64)
        self._motion: Motion | None = None

    def set_previous_truth(self, before: TruthState | None) -> None:
        """Set the true state at the previous revolution, for callers that do not take samples in order."""
        self._before = before

    def sample(self, truth: TruthState, seq: int) -> PointCloudSample:
        """Return revolution `seq`. The first one assumes motion with constant accelerations."""
        p, t_ns = self._p, truth.t_ns
        before = self._before
        recent = before if before is not None and 0 < t_ns - before.t_ns <= 2 * self.period_ns else None
        motion = sweep_motion(truth, recent) if p.rolling else at_rest(truth)
        self._before = truth
        for i, part in enumerate(self._parts):
            box = sweep_rays(
                motion, self._offset_ns[part], self._origins_B[part], self._directions_B[part],
                self._origins_W[part], self._directions_W[part],
            )  # fmt: skip
            middle_ns = t_ns - self.sweep_ns + self.sweep_ns * (2 * i + 1) // (2 * len(self._parts))
            self._frames.expect(max(0, middle_ns))
            self._frames.geometry.pose_within(Vicinity(*box, p.max_range_m))
            self._frames.geometry.caster.cast(
                self._origins_W[part], self._directions_W[part], 0.0, p.max_range_m, self._range[part],
                self._geom[part], self._normal[part],
            )  # fmt: skip
        self._frames.expect(t_ns)
        cosine = -dot(self._normal.T, self._directions_W.T)
        some, power_w = self._beam.echoes(self._range, self._surface[self._geom], cosine)
        spans = self._beam.spans(self._range, self._geom.astype(np.int64), self._normal)
        self.power_w = self._beam.power(some, power_w, self._range, spans)
        bits = np.random.Philox(key=np.array(self._key, np.uint64), counter=[0, 0, seq, 0])
        self.polar = self._beam.codes(self.power_w, bits.random_raw(self.power_w.size).reshape(self.power_w.shape))
        azimuth, bin_number = self._peaks()
        self._point_azimuth, self._motion = azimuth, motion
        self._point_geom = self._strongest(some, power_w, azimuth * p.bins + bin_number)
        cloud = (
            (self._beam.azimuth_L[azimuth] * (bin_number * p.bin_m)[:, None]).astype(np.float32),
            (bin_number * p.bin_m).astype(np.float32),
            (self.polar[azimuth, bin_number] / (CODES - 1.0)).astype(np.float32),
            np.zeros(len(azimuth), np.uint8),
            self._azimuth_ns[azimuth],
            self._class[self._point_geom],
        )
        for array in cloud:
            array.flags.writeable = False
        p_WL, q_WL = self.mount.place(truth)
        return PointCloudSample(seq, t_ns, t_ns + self.latency_ns, p_WL, q_WL, *cloud)

    def instances(self) -> NDArray[np.uint16]:
        """Return the instance of each point of the last sample: an index of the world's `instance_names`."""
        return self._instance[self._point_geom]

    def points_at_capture(self, sample: PointCloudSample) -> NDArray[np.float32]:
        """Return the points of the last sample, (n, 3) [m], as if all had been measured at the capture, in L."""
        n, azimuth = len(self._point_azimuth), self._point_azimuth
        origins_W, directions_W = np.empty((n, 3)), np.empty((n, 3))
        if self._motion is None or not n:
            return sample.points_L
        axes_B = np.ascontiguousarray(self._beam.azimuth_L[azimuth] @ self._axes_B)
        mounted = np.tile(np.array(self._p.mount_m), (n, 1))
        sweep_rays(self._motion, self._azimuth_ns[azimuth], mounted, axes_B, origins_W, directions_W)
        points_W = origins_W + sample.range_m[:, None].astype(np.float64) * directions_W
        R_WL = np.array(matrix_of(sample.q_WL)).reshape(3, 3)
        return ((points_W - np.array(sample.p_WL)) @ R_WL).astype(np.float32)

    def _peaks(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return azimuths and bins of the points, azimuth by azimuth, near ones first."""
        p, codes = self._p, self.polar
        least = (p.noise_dbm + p.threshold_db - p.floor_dbm) / p.step_db
        peak = np.zeros(codes.shape, np.bool_)
        inner = codes[:, 1:-1]
        peak[:, 1:-1] = (inner >= least) & (inner > codes[:, :-2]) & (inner >= codes[:, 2:])
        azimuths, bins = [], []
        for azimuth in np.flatnonzero(peak.any(axis=1)).tolist():
            found = np.flatnonzero(peak[azimuth])
            if len(found) > p.max_points:
                strongest = np.argsort(-codes[azimuth, found].astype(np.int64), kind="stable")[: p.max_points]
                found = np.sort(found[strongest])
            bins.append(found)
            azimuths.append(np.full(len(found), azimuth))
        none = np.empty(0, np.int64)
        return np.concatenate([none, *azimuths]), np.concatenate([none, *bins])

    def _strongest(
        self, some: NDArray[np.int64], power_w: NDArray[np.float64], cell: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the geom with the strongest echo in or beside each cell; -1: noise."""
        geom_of = np.full(self.polar.size, -1, np.int64)
        wanted = np.zeros(self.polar.size, np.bool_)
        wanted[cell] = True
        if len(some) and len(cell):
            cells, shares = self._beam.cells(some, self._range[some], taps=1)
            geom = np.broadcast_to(self._geom[some].astype(np.int64), cells.shape)
            strength = shares * power_w
            hit = wanted[cells]
            order = np.argsort(strength[hit], kind="stable")  # the strongest is written last
            geom_of[cells[hit][order]] = geom[hit][order]
        return geom_of[cell]


KIND = Kind(SpinningRadar, SpinningRadarParameters)
