"""Simultaneous localisation and mapping: a Rao-Blackwellised particle filter over LiDAR, IMU and GPS.

Each frame:

    1  IMU        advances position, velocity and attitude (navigation/inertial.py)
    2  GPS, baro  correct velocity and height; GPS positions weigh the particles
    3  sweep      is motion-corrected and levelled (sweep.py) and reduced to two dimensions (scan.py)
    4  particles  move by the IMU; each is matched with its own map and sampled from the matched pose's covariance
    5  weights    come from the likelihood of the match; particles are resampled if too few are effective
    6  maps       get the sweep, each third of the particles in turn
    7  IMU filter is corrected by the particles' mean and predicted to the frame's time

Without a usable sweep the IMU filter continues with GPS alone and moves the particles, and `lidar_ok` is False. When
the LiDAR is back, a search in the maps (search.py) relocates the particles before they add anything to their maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hil_companion.explore.mapping.maps import GridView, Maps
from hil_companion.explore.mapping.matcher import Match, match
from hil_companion.explore.mapping.particles import Particles
from hil_companion.explore.mapping.scan import Scan, ground_offset_m, make_scan
from hil_companion.explore.mapping.search import search
from hil_companion.explore.mapping.slam_settings import SlamSettings
from hil_companion.explore.mapping.sweep import FreshSweeps, make_sweep
from hil_companion.navigation.geodesy import BaroHeights, GpsFixes
from hil_companion.navigation.inertial import SPEED, XY, YAW, InertialFilter, Z
from hil_companion.navigation.rotation import matrix_of, roll_pitch_yaw, wrapped

_TURNS = 3  # number of sweeps in which every particle's map is updated once
_STILL_M, _STILL_RAD, _STILL_FRAMES = 0.08, 0.04, 9  # motion, or frames, after which a map is updated again
_MIN_RETURNS = 200
_MIN_KNOWN, _MIN_INLIERS = 0.15, 0.35
_FLOOR_M, _FLOOR_RAD = 0.03, 0.004  # lower bound of a match's standard deviation
_STEP_M, _STEP_RAD, _TURN_SHARE = 0.01, 0.0005, 0.003  # noise of the IMU's motion between two sweeps
_WINDOW_M, _WINDOW_RAD = (1.0, 12.0), (0.06, 0.3)  # smallest and largest half width of a search
_MIN_SHARE = 0.5  # share of points on the map from which a search counts as successful
_GROUND_SIGMA_M = 0.15  # of the ground's height in a sweep: objects on it, tilt
_BARO_SIGMA_M = 0.25
_GPS_SPEED_SIGMA_MPS = 0.15
_GPS_GATE = 5.0
_GPS_LOST_S = 0.6
_SURE_M = 0.5  # largest standard deviation of a position at which a new part of the map may begin
_SETTLE = 8  # consecutive sweeps that must fit after a loss before maps are updated again
_IMU_LOST_S = 0.2
_REST_S = 3.0  # after a gap in the IMU's rows: timeout for fitting sweeps, then the IMU counts as usable without them
_LEVEL_RAD = 0.05  # with more tilt uncertainty a sweep is not used: at 30 m its heights would be 1.5 m off at 1 sigma
_RESAMPLE = 0.5  # effective share of the particles below which they are resampled


@dataclass(frozen=True)
class SlamEstimate:
    """State at the frame's own time, and the map."""

    t_ns: int
    p_W: np.ndarray  # (3,)
    v_W: np.ndarray  # (3,)
    yaw_rad: float
    roll: float
    pitch: float
    covariance_xy: np.ndarray  # (2, 2)
    lidar_ok: bool
    gps_ok: bool
    imu_ok: bool  # rows arrive, roll and pitch are known, and after a gap sweeps fit again
    grid: GridView
    inliers: float  # share of matched points on a surface of the map; 0 without a sweep
    particles_xy: np.ndarray  # (n, 2)


class Slam:
    """The particle filter. `start_W`: x, y, z [m], yaw [rad] of the vehicle at rest; the map is centred on it."""

    def __init__(self, settings: SlamSettings, *, start_W: tuple[float, float, float, float], seed: int) -> None:
        x, y, z, yaw = (float(c) for c in start_W)
        s = settings
        self.settings = s
        self._inertial = InertialFilter((x, y, z, yaw))
        self.particles = Particles(s.particles, (x, y, yaw), seed)
        self.maps = Maps(s.particles, s.cell_m, s.area_m, s.map_range_m, (x, y))
        self._gps, self._baro = GpsFixes(np.array([x, y, z])), BaroHeights(z)
        self._fresh = FreshSweeps()
        self._sweep_ns: int | None = None
        self._last_fix_ns: int | None = None
        self._fixes: list[tuple[int, np.ndarray, float]] = []  # pending: time, position, standard deviation
        self._speeds: list[tuple[int, np.ndarray]] = []
        self._heights: list[tuple[int, float, float]] = []
        self._fitted = 0  # consecutive sweeps that fitted
        self._tilted_ns: int | None = None  # last time at which roll and pitch were unknown
        self._turn = 0
        self._inserted = np.full((s.particles, 3), np.inf)
        self._waited = np.zeros(s.particles, int)
        self._inliers = 0.0
        self._view = self.maps.view(0)
        self._viewed: tuple[int, int] = (0, 0)

    def update(self, frame: Any) -> SlamEstimate:
        """Update with a frame and return the estimate; call once for each frame, in order."""
        t_ns = int(frame.t_ns)
        self._read_imu(frame)
        self._read_gps(frame)
        self._read_baro(frame)
        sweep_ns = self._new_sweep(frame)
        self._inliers = 0.0
        if sweep_ns is not None:
            self._with_sweep(frame[self.settings.lidar_topic], sweep_ns)
        elif self._lidar_late(t_ns):
            self._without_sweep(t_ns)
        return self._estimate(t_ns)

    # --- reading sensors ---

    def _read_imu(self, frame: Any) -> None:
        if "imu" in frame:
            imu = frame["imu"]
            self._inertial.add_rows(imu["t_capture_ns"], imu["gyro_radps"], imu["accel_mps2"], upto_ns=int(frame.t_ns))

    def _read_gps(self, frame: Any) -> None:
        if "gps" not in frame:
            return
        for t_ns, p_W, v_W, sigma_m in self._gps.usable(frame["gps"]):
            sigma_m = max(0.2, sigma_m if self.settings.gps_sigma_m is None else self.settings.gps_sigma_m)
            if p_W is None:
                self.particles.first_fix(sigma_m * sigma_m)
                self._last_fix_ns = t_ns
                continue
            self._fixes.append((t_ns, p_W, sigma_m))
            self._speeds.append((t_ns, v_W))
        del self._fixes[:-64], self._speeds[:-64]

    def _read_baro(self, frame: Any) -> None:
        height = self._baro.height(frame["baro"]) if "baro" in frame else None
        if height is not None:
            self._heights.append((*height, _BARO_SIGMA_M**2))
            del self._heights[:-64]

    def _new_sweep(self, frame: Any) -> int | None:
        """Return the capture time of a new sweep; None if the frame has none."""
        topic = self.settings.lidar_topic
        if topic not in frame:
            return None
        t_ns = int(frame[topic].t_capture_ns)
        if not self._fresh.is_new(frame[topic], now_ns=int(frame.t_ns), p_W=self._inertial.p):
            return None
        if self._inertial.t_ns is not None and t_ns < self._inertial.t_ns:
            return None  # the filter has already advanced past it
        return t_ns

    def _lidar_late(self, t_ns: int) -> bool:
        return self._sweep_ns is None or (t_ns - self._sweep_ns) * 1e-9 > self.settings.lidar_lost_s

    # --- updating the filter ---

    def _with_sweep(self, lidar: Any, sweep_ns: int) -> None:
        s = self.settings
        before = self._snapshot()
        self._inertial.advance(sweep_ns)
        self._inertial.level_by_gravity()
        self._apply_aiding()
        sweep = make_sweep(self._inertial, lidar, s)
        predicted, motion = self._predicted(before)
        if sweep.returns < _MIN_RETURNS or self._inertial.tilt_sigma_rad > _LEVEL_RAD:
            self.particles.pose = predicted
            self._continue_with_gps()
            return
        too_high_m = ground_offset_m(sweep, z_m=float(self._inertial.p[2]), ground_z_m=s.ground_z_m)
        if too_high_m is not None:
            self._inertial.correct_states(Z, np.array([-too_high_m]), np.array([_GROUND_SIGMA_M**2]))
        scan = make_scan(sweep, s, float(self._inertial.p[2]))
        if not self.maps.version:
            self.particles.pose = predicted
            self._sweep_ns = sweep_ns
            self._insert(scan, all_particles=True)
            self._fitted = _SETTLE
            return
        late = self._lidar_late(sweep_ns)
        if late:
            self._fitted = 0
            predicted, motion = self._relocalise(predicted, motion, scan)
        found = match(self.maps, predicted, np.linalg.inv(motion), scan.match_xy, scan.normal_xy)
        if not self._fits(found, late=late):
            predicted, motion = self._relocalise(predicted, motion, scan)
            found = match(self.maps, predicted, np.linalg.inv(motion), scan.match_xy, scan.normal_xy)
            if not self._fits(found, late=late):
                # Nothing fits: the IMU's motion is safer than a match with the wrong wall.
                self.particles.pose = predicted
                self._continue_with_gps()
                return
        self._sweep_ns = sweep_ns
        self._sample(found)
        self._fitted += 1
        if self._fitted >= _SETTLE:
            self._insert(scan, all_particles=False)
        self._correct_inertial(scan)

    def _fits(self, found: Match, *, late: bool) -> bool:
        """Return True if the scan lies on the map of the best particle.

        In an unmapped area every scan fits; after a loss (`late`) only if the position is known by other sensors.
        """
        best = self.particles.best
        self._inliers = float(found.inliers[best])
        if float(found.known[best]) < _MIN_KNOWN:
            return not late or self._sigma_m < _SURE_M
        return self._inliers >= _MIN_INLIERS

    @property
    def _sigma_m(self) -> float:
        i = self._inertial
        return math.sqrt(max(0.0, float(max(i.cov[0, 0], i.cov[1, 1]))))

    def _relocalise(self, predicted: np.ndarray, motion: np.ndarray, scan: Scan) -> tuple[np.ndarray, np.ndarray]:
        """Search in the best particle's map; return the shifted poses and their covariance, or both unchanged."""
        i, best = self._inertial, self.particles.best
        window_m = min(_WINDOW_M[1], max(_WINDOW_M[0], 3.0 * self._sigma_m))
        window_rad = min(_WINDOW_RAD[1], max(_WINDOW_RAD[0], 3.0 * math.sqrt(max(0.0, float(i.cov[8, 8])))))
        found = search(
            self.maps.hit_xy(best, 2),
            scan.match_xy,
            predicted[best],
            window_m=window_m,
            window_rad=window_rad,
            cell_m=self.settings.cell_m,
        )
        if found.share < _MIN_SHARE:
            return predicted, motion
        wide = np.diag([self.settings.cell_m**2, self.settings.cell_m**2, 0.01**2])
        return predicted + (found.pose - predicted[best]), motion + wide

    def _snapshot(self) -> tuple[np.ndarray, float, int, float]:
        i = self._inertial
        return i.p[:2].copy(), i.yaw_rad, i.t_ns or 0, float(i.cov[8, 8])

    def _predicted(self, before: tuple[np.ndarray, float, int, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return the poses moved by the IMU since `before`, and the covariance (3, 3) of that motion."""
        i = self._inertial
        shift, turn = i.p[:2] - before[0], i.yaw_rad - before[1]
        dt_s = max(1e-3, ((i.t_ns or 0) - before[2]) * 1e-9)
        pose = self.particles.pose.copy()
        # Each particle's motion is turned by the difference of its heading to the IMU filter's.
        off = pose[:, 2] - before[1]
        c, s = np.cos(off), np.sin(off)
        pose[:, 0] += c * shift[0] - s * shift[1]
        pose[:, 1] += s * shift[0] + c * shift[1]
        turn = wrapped(turn)
        pose[:, 2] += turn
        speed_variance = float(max(i.cov[3, 3], i.cov[4, 4]))
        # Variance of the turn: the gyro's bias and, over a gap in the rows, the growth of the heading's variance.
        drift_variance = float(i.cov[11, 11]) * dt_s * dt_s + max(0.0, float(i.cov[8, 8]) - before[3])
        xy = _STEP_M**2 + speed_variance * dt_s * dt_s
        yaw = _STEP_RAD**2 + drift_variance + (_TURN_SHARE * turn) ** 2
        return pose, np.diag([xy, xy, yaw])

    def _sample(self, found: Match) -> None:
        """Weigh and sample the particles, and resample them if too few are effective."""
        particles = self.particles
        particles.weigh(found.log_likelihood)
        particles.sample(found.pose, found.spread)
        self._weigh_by_fixes()
        if len(particles) > 1 and particles.n_eff < _RESAMPLE * len(particles):
            ancestors = particles.resample()
            self.maps.resample(ancestors)
            self._inserted, self._waited = self._inserted[ancestors], self._waited[ancestors]

    def _weigh_by_fixes(self) -> None:
        """Weigh the particles by the pending GPS positions, each moved on by the motion since its fix."""
        here = self._inertial.p[:2]
        for t_ns, position, sigma_m in self._fixes:
            then = self._inertial.state_at(t_ns)
            if then is None or self._last_fix_ns is None:
                continue
            dt_s = max(0.0, (t_ns - self._last_fix_ns) * 1e-9)
            self._last_fix_ns = t_ns
            self.particles.add_fix(position[:2], here - np.array(then.p[:2]), sigma_m * sigma_m, dt_s)
        self._fixes.clear()

    def _insert(self, scan: Scan, *, all_particles: bool) -> None:
        """Add the scan to the maps of the particles whose turn it is and that have moved or waited enough."""
        self._turn = (self._turn + 1) % _TURNS
        pose = self.particles.pose
        n = len(pose)
        has_turn = np.arange(n) % _TURNS == self._turn if n > 1 else np.ones(n, bool)
        self._waited += 1
        off = np.abs(pose - self._inserted)
        moved = (np.hypot(off[:, 0], off[:, 1]) > _STILL_M) | (off[:, 2] > _STILL_RAD) | (self._waited >= _STILL_FRAMES)
        due = np.flatnonzero((has_turn & moved) | all_particles)
        self.maps.insert(due, pose[due], scan)
        self._inserted[due] = pose[due]
        self._waited[due] = 0

    def _correct_inertial(self, scan: Scan) -> None:
        i, mean, cov = self._inertial, self.particles.mean(), self.particles.covariance()
        above_m, spread_m = scan.above_m
        variance = np.diag(cov)[:2] + _FLOOR_M**2 + (spread_m * i.tilt_sigma_rad) ** 2
        i.correct_place(mean[:2] - i.p[:2], variance, above_m=above_m)
        off = wrapped(float(mean[2]) - i.yaw_rad)
        i.correct_states(YAW, np.array([off]), np.array([float(cov[2, 2]) + _FLOOR_RAD**2]))

    def _without_sweep(self, t_ns: int) -> None:
        before = self._snapshot()
        self._inertial.advance(t_ns)
        self._inertial.level_by_gravity()
        self._apply_aiding()
        self.particles.pose, _ = self._predicted(before)
        self._continue_with_gps()

    def _continue_with_gps(self) -> None:
        """Correct the IMU filter by GPS positions, and shift the particles with it."""
        i = self._inertial
        before = i.p[:2].copy()
        shift = self.particles.weights @ self.particles.shift
        for fix_ns, position, sigma_m in self._fixes:
            then = i.state_at(fix_ns)
            if then is not None:
                variance = sigma_m * sigma_m + self.particles.shift_variance
                i.correct_states(XY, position[:2] - shift - np.array(then.p[:2]), np.full(2, variance), _GPS_GATE)
                self._last_fix_ns = fix_ns
        self._fixes.clear()
        self.particles.pose[:, :2] += i.p[:2] - before

    def _apply_aiding(self) -> None:
        """Correct the velocity by GPS and the height by barometer."""
        i = self._inertial
        variance = np.full(3, _GPS_SPEED_SIGMA_MPS**2)
        for t_ns, speed in self._speeds:
            then = i.state_at(t_ns)
            if then is not None:
                i.correct_states(SPEED, speed - np.array(then.v), variance, _GPS_GATE)
        self._speeds.clear()
        for t_ns, height_m, height_variance in self._heights:
            then = i.state_at(t_ns)
            if then is not None:
                i.correct_states(Z, np.array([height_m - then.p[2]]), np.array([height_variance]))
        self._heights.clear()

    # --- the estimate ---

    def _estimate(self, t_ns: int) -> SlamEstimate:
        i, particles = self._inertial, self.particles
        now = i.predict(t_ns)
        roll, pitch, yaw = roll_pitch_yaw(matrix_of(now.q))
        best = particles.best
        if self._viewed != (self.maps.version, best):
            self._view = self.maps.view(best)
            self._viewed = (self.maps.version, best)
        lidar_ok = self._sweep_ns is not None and (t_ns - self._sweep_ns) * 1e-9 <= self.settings.lidar_lost_s
        gps_ok = self._last_fix_ns is not None and (t_ns - self._last_fix_ns) * 1e-9 <= _GPS_LOST_S
        imu_ok = i.last_imu_ns is not None and (t_ns - i.last_imu_ns) * 1e-9 <= _IMU_LOST_S
        if not imu_ok or i.tilt_sigma_rad > _LEVEL_RAD:
            imu_ok, self._tilted_ns = False, t_ns
        elif self._tilted_ns is not None and (t_ns - self._tilted_ns) * 1e-9 < _REST_S:
            imu_ok = self._fitted >= _SETTLE
        return SlamEstimate(
            t_ns=t_ns,
            p_W=np.array(now.p),
            v_W=np.array(now.v),
            yaw_rad=yaw,
            roll=roll,
            pitch=pitch,
            covariance_xy=particles.covariance()[:2, :2] + i.cov[:2, :2],
            lidar_ok=lidar_ok,
            gps_ok=gps_ok,
            imu_ok=imu_ok,
            grid=self._view,
            inliers=self._inliers,
            particles_xy=particles.pose[:, :2].copy(),
        )
