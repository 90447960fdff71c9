"""A receiver in a scene: from the satellites above it to the errors, kind and accuracy of a fix.

Each sample, in this order: directions of the satellites (satellite_orbit.hpp), their signals (signals.py), locks
(tracking.py), ranges and least squares (position.py), and the kind of the fix (solution.py).

A preset's own errors stay, and the geometry scales them by axis, against the open sky at the same instant:

    k_i = sqrt(Q_ii / Q_ii of all satellites above the mask with w = sin^2(elevation))

so k = 1 exactly in the open with the vehicle level. The error of the position by reflections passes a filter of
`smoothing_s` (15 times as long for an RTK float solution, whose ambiguities average the code); a fixed solution has the
error of the carriers alone. RTK takes the satellites that the base sees too, directly and above 30 dB-Hz. Reported
accuracies are the preset's times k, and the RMS of the residuals times the dilution on top. A receiver without a fix
counts the satellites that it tracks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_exp, det_sin, rotate_into_world
from signals.geodesy import ecef_from_geodetic
from signals.samples import Quat, Vec3
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim._kernels import satellite_directions
from sim.frame.geometry import FrameGeometry
from sim.gnss.constellations import nominal_orbits
from sim.gnss.interference import BANDS, SIGNAL_DBW, Emitter, Spoofer
from sim.gnss.orbit import Orbit, orbit_table
from sim.gnss.parameters import ReceiverParameters, SkyParameters, start_gps_s
from sim.gnss.position import Position, open_variance, ranges_of, solve
from sim.gnss.signals import NO_SIGNAL, Listener, Signal
from sim.gnss.solution import FIX_2D, FIX_3D, FIXED, FLOAT, NO_FIX, SolutionState
from sim.gnss.surroundings import Surroundings
from sim.gnss.systems import SYSTEMS
from sim.gnss.tracking import Tracking
from sim.scene.scene import Scene

_UP_B: Vec3 = (0.0, 0.0, 1.0)
_ZERO: Vec3 = (0.0, 0.0, 0.0)
_ONE: Vec3 = (1.0, 1.0, 1.0)
_COMMON_DBHZ = 30.0  # above which a carrier counts for RTK
_FLOAT_SMOOTHING = 15.0  # times as long as that of code alone
_VERTICAL = 1.5  # errors of a height over those of a horizontal axis, as in the presets
_HELD_ACCURACY_M = 50.0  # reported of a height that is held
_SPOOFED_OVER_DB = -3.0  # of the signals of a spoofer over those of satellites at the zenith


class SatelliteView(NamedTuple):
    """One satellite above the mask in the last sample."""

    name: str
    direction: Vec3  # east, north, up
    state: str  # "used", "reflected" (used so), "visible" (not used) or "hidden"
    cn0_dbhz: float  # -inf: no signal


class SkyFix(NamedTuple):
    """Fix of one sample, and how the sky was for it."""

    fix_type: int
    satellites: int
    scale: Vec3  # k of east, north, up
    shift_m: Vec3  # error of the position besides the preset's
    speed_shift_mps: Vec3
    drift_m: tuple[float, float]  # least slow error of a horizontal axis and of the height at this kind of fix
    residual_m: tuple[float, float]  # in the accuracies besides, horizontal and vertical
    hdop: float
    vdop: float
    pdop: float
    in_view: int  # above the mask
    visible: int  # of these, not behind a solid
    reflected: int  # used by a reflection alone
    mean_cn0_dbhz: float  # of those used; 0 without one
    jamming_db: float  # greatest J/S for a satellite at the zenith; 0 without a transmitter
    spoofed: bool


class SkyReceiver:
    """Receiver of one vehicle."""

    def __init__(
        self,
        scene: Scene,
        geometry: FrameGeometry,
        receiver: ReceiverParameters,
        sky: SkyParameters,
        *,
        best_fix: int,
        period_ns: int,
    ) -> None:
        """`best_fix`: the preset's kind of fix."""
        self._p, self._sky = receiver, sky
        self._start_s = start_gps_s(sky, scene.light)
        self.orbits = _orbits(receiver, sky, self._start_s)
        self._table = orbit_table(self.orbits, self._start_s)
        self._systems = [SYSTEMS[orbit.system] for orbit in self.orbits]
        site = scene.site
        phi, lam = site.latitude_deg * RAD_PER_DEG, site.longitude_deg * RAD_PER_DEG
        sp, cp, sl, cl = det_sin(phi), det_cos(phi), det_sin(lam), det_cos(lam)
        self._R_WE = [-sl, cl, 0.0, -sp * cl, -sp * sl, cp, cp * cl, cp * sl, sp]
        self._origin_E = ecef_from_geodetic(site.latitude_deg, site.longitude_deg, site.altitude_m)
        mask_sine = det_sin(sky.elevation_mask_deg * RAD_PER_DEG)
        surroundings = Surroundings.of(geometry, smallest_face_m2=sky.smallest_face_m2)
        self.faces = len(surroundings.faces)
        self.listener = Listener(surroundings, receiver, sky, mask_sine=mask_sine)
        self._tracking = Tracking(receiver, len(self.orbits), start=sky.start)
        self._solution = SolutionState(best_fix, receiver.rtk_start_s, started=sky.start == "tracking")
        self._best = best_fix
        period_s = period_ns / NS_PER_S
        self._follow = _share(period_s, sky.smoothing_s)
        self._follow_float = _share(period_s, sky.smoothing_s * _FLOAT_SMOOTHING)
        self._directions = np.empty((len(self.orbits), 3))
        self._smooth: Vec3 | None = None
        self._height_error_m = 0.0
        self._captured_ns: int | None = None
        self.jammers: tuple[Emitter, ...] = ()
        self.spoofers: tuple[Spoofer, ...] = ()
        self.views: tuple[SatelliteView, ...] = ()  # of the last sample

    def deaf(self, t_ns: int) -> None:
        """Take notice of a sample without any signal of a satellite."""
        self._tracking.update(t_ns, [NO_SIGNAL] * len(self.orbits))
        self._kind(t_ns, None, 0, 0.0, 0.0)
        self._smooth, self._captured_ns = None, None

    def directions(self, t_ns: int, antenna_W: Vec3) -> NDArray[np.float64]:
        """Return the unit vectors to all satellites, east, north, up (n, 3), valid until the next call."""
        e, n, u = antenna_W
        R, origin = self._R_WE, self._origin_E
        place = [origin[k] + R[k] * e + R[3 + k] * n + R[6 + k] * u for k in range(3)]
        satellite_directions(self._table, self._start_s + t_ns / NS_PER_S, place, R, self._directions)
        return self._directions

    def observe(self, t_ns: int, antenna_W: Vec3, v_W: Vec3, q_WB: Quat) -> SkyFix:
        """Return the fix of a sample. `v_W`: velocity of the antenna."""
        p, sky = self._p, self._sky
        up_W = rotate_into_world(q_WB, _UP_B)
        every = self.directions(t_ns, antenna_W)
        emitters = (*(spoofer.emitter for spoofer in self.spoofers), *self.jammers)
        powers = [self.listener.received_dbw(emitter, antenna_W, up_W) for emitter in emitters]
        received = [(power_dbw, BANDS[emitter.band]) for power_dbw, emitter in zip(powers, emitters, strict=True)]
        signals = self.listener.listen(antenna_W, up_W, every, self._systems, received)
        jamming_db = max(powers) - SIGNAL_DBW if powers else 0.0
        holder = _captor(self.spoofers, powers[: len(self.spoofers)])
        if holder is not None:
            return self._spoofed(t_ns, holder, signals, jamming_db)
        self._captured_ns = None
        levels = [NO_SIGNAL] * len(self.orbits)
        for signal in signals:
            levels[signal.satellite] = signal.cn0_dbhz
        locked = self._tracking.update(t_ns, levels)
        tracked = [signal for signal in signals if locked[signal.satellite]]
        ranges = ranges_of(tracked, v_W, p)
        position = solve(tracked, ranges, residual_limit_m=sky.residual_limit_m, height_error_m=self._height_error_m)
        used = [tracked[i] for i in position.used]
        common = [i for i in position.used if tracked[i].image is None and tracked[i].cn0_dbhz >= _COMMON_DBHZ]
        square = 0.0
        for i in common:
            square += ranges.carrier_m[i] * ranges.carrier_m[i]
        rms_m = math.sqrt(square / len(common)) if common else 0.0
        pdop = math.sqrt(sum(position.dilution[:3]))
        kind = self._kind(t_ns, position if position.solved else None, len(common), rms_m, pdop)
        if kind >= FLOAT:  # only carriers in common with the base, seen directly, take part
            used = [tracked[i] for i in common]
            position = solve(used, ranges_of(used, v_W, p), residual_limit_m=math.inf, height_error_m=0.0)
            kind = kind if position.solved else NO_FIX
        self._look(signals, used)
        if kind < FIX_2D:
            self._smooth = None
            return self._lost(signals, len(tracked), jamming_db)
        return self._fixed(kind, position, signals, used, jamming_db)

    def _kind(self, t_ns: int, position: Position | None, common: int, rms_m: float, pdop: float) -> int:
        used = 0 if position is None else len(position.used)
        return self._solution.update(
            t_ns, used=used, solved=position is not None, pdop=pdop, common=common, phase_rms_m=rms_m
        )

    def _fixed(
        self, kind: int, position: Position, signals: list[Signal], used: list[Signal], jamming_db: float
    ) -> SkyFix:
        reference = open_variance(signals)
        scale = tuple(math.sqrt(a / b) for a, b in zip(position.variance, reference, strict=True))
        if kind >= FIXED:
            self._smooth = None
            shift = position.carrier_shift_m
        else:
            share = self._follow_float if kind == FLOAT else self._follow
            shift = self._smoothed(position.shift_m, share)
        self._height_error_m = shift[2]
        residual_up = 0.0
        if kind == FIX_2D:  # the height is that of the last fix: it has no dilution
            scale, residual_up = (scale[0], scale[1], 1.0), _HELD_ACCURACY_M
        east, north, up, _ = position.dilution
        a, b, c = position.variance
        horizontal, vertical = math.sqrt(a + b), math.sqrt(c)
        reflected = sum(signal.image is not None for signal in used)
        level = sum(signal.cn0_dbhz for signal in used) / len(used)
        residual = position.residual_m if kind < FIXED else 0.0
        return SkyFix(
            kind,
            len(used),
            (scale[0], scale[1], scale[2]),
            shift,
            position.speed_shift_mps,
            self._least(kind),
            (residual * horizontal, max(residual * vertical, residual_up)),
            math.sqrt(east + north),
            math.sqrt(up),
            math.sqrt(east + north + up),
            len(signals),
            sum(not signal.hidden for signal in signals),
            reflected,
            level,
            jamming_db,
            False,
        )

    def _least(self, kind: int) -> tuple[float, float]:
        """Return the least slow error of a kind of fix that is worse than the preset's."""
        p = self._p
        if self._best < FLOAT or kind == self._best:
            return 0.0, 0.0
        error = p.rtk_float_error_m if kind == FLOAT else p.standalone_error_m
        return error, _VERTICAL * error

    def _smoothed(self, shift: Vec3, share: float) -> Vec3:
        before = self._smooth
        if before is not None:
            shift = (
                before[0] + share * (shift[0] - before[0]),
                before[1] + share * (shift[1] - before[1]),
                before[2] + share * (shift[2] - before[2]),
            )
        self._smooth = shift
        return shift

    def _lost(self, signals: list[Signal], tracked: int, jamming_db: float) -> SkyFix:
        visible = sum(not signal.hidden for signal in signals)
        nothing = (0.0, 0.0)
        return SkyFix(
            NO_FIX, tracked, _ONE, _ZERO, _ZERO, nothing, nothing, 99.99, 99.99, 99.99,
            len(signals), visible, 0, 0.0, jamming_db, False,
        )  # fmt: skip

    def _spoofed(self, t_ns: int, spoofer: Spoofer, signals: list[Signal], jamming_db: float) -> SkyFix:
        """Return the fix of a receiver that a spoofer holds: a whole sky of signals, all of them false."""
        since_ns = t_ns if self._captured_ns is None else self._captured_ns
        self.deaf(t_ns)  # the true signals are lost, and have to be found again
        self._captured_ns = since_ns
        away_s = (t_ns - since_ns) / NS_PER_S
        o, v = spoofer.offset_m, spoofer.velocity_mps
        self._look(signals, signals)
        kind = min(self._best, FIX_3D)  # the base does not hear the false signals: no corrections fit
        return SkyFix(
            kind,
            len(signals),
            _ONE,
            (o[0] + v[0] * away_s, o[1] + v[1] * away_s, o[2] + v[2] * away_s),
            v,
            self._least(kind),
            (0.0, 0.0),
            1.0,
            1.0,
            math.sqrt(2.0),
            len(signals),
            sum(not signal.hidden for signal in signals),
            0,
            self._p.zenith_cn0_dbhz + _SPOOFED_OVER_DB,
            jamming_db,
            True,
        )

    def _look(self, signals: list[Signal], used: list[Signal]) -> None:
        chosen = {signal.satellite for signal in used}
        views = []
        for signal in signals:
            state = "hidden" if signal.hidden else "visible"
            if signal.satellite in chosen:
                state = "used" if signal.image is None else "reflected"
            name = self.orbits[signal.satellite].name
            views.append(SatelliteView(name, signal.direction, state, signal.cn0_dbhz))
        self.views = tuple(views)


def _captor(spoofers: tuple[Spoofer, ...], powers_dbw: list[float]) -> Spoofer | None:
    """Return the strongest spoofer that is strong enough to hold the receiver."""
    able = [
        (power_dbw, -number)
        for number, (spoofer, power_dbw) in enumerate(zip(spoofers, powers_dbw, strict=True))
        if power_dbw >= SIGNAL_DBW + spoofer.capture_db
    ]
    return spoofers[-max(able)[1]] if able else None


def _share(period_s: float, time_constant_s: float) -> float:
    """Return the share of a new value in a low-pass."""
    return 1.0 if time_constant_s <= 0.0 else 1.0 - det_exp(-period_s / time_constant_s)


def _orbits(receiver: ReceiverParameters, sky: SkyParameters, start_s: float) -> tuple[Orbit, ...]:
    """Return the satellites: those of the almanac, and nominal ones of the systems that it does not have."""
    systems = receiver.systems if sky.systems is None else sky.systems
    listed = tuple(orbit for orbit in sky.orbits if orbit.system in systems)
    missing = [system for system in systems if system not in {orbit.system for orbit in listed}]
    return listed + nominal_orbits(missing, start_s=start_s, gps_satellites=sky.gps_satellites, seed=sky.seed)
