"""Raindrops on a camera's window: blurred spots that stay for a while.

A drop of diameter D on a window at distance d before a pupil of diameter A is far out of focus. At an angle theta
from its middle it covers the pupil by two discs, of D and A, whose middles are theta d apart. Taken as a ramp between
full cover and none, its opacity is

    a = min(1, (D / A)^2) clip(((D + A) / 2 - theta d) / min(D, A), 0, 1)

It refracts a wide view, upside down, into the spot: the picture seen through it is that of the angle -m theta, with m
= 3, blurred over a sixteenth of the picture (after Roser, Kurz and Geiger, "Realistic modeling of water droplets for
monocular adherent raindrop recognition", ACCV Workshops 2010, and von Bernuth, Volk and Bringmann, IV 2018). The blur
and m are choices.

Drops arrive at random. In a slot of 1.5 `stay_s` of simulated time their number is Poisson, with the mean

    mu = exposed (2 d tan(half width) + A)(2 d tan(half height) + A) 1.5 stay_s   integral of n(D) v(D) dD

from the distribution and fall speed of sim/scene/precipitation.py above `_LEAST_MM`; each has a place, a diameter,
and a time to stay from half to 1.5 `stay_s`, as functions of the seed, the camera's name and its number in the slot.
So the drops of a picture are a function of its time alone. They do not run and do not merge; snow does not stick.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from signals.noise import uniform_from_bits
from signals.time import NS_PER_S
from sim.frame.camera_model import CameraModel
from sim.frame.linear_picture import LinearPicture
from sim.scene.precipitation import Precipitation

_LEAST_MM = 0.3
_CLASSES = 128
_MOST_DROPS = 200  # in a slot
_INVERTED = 3.0  # m
_BLOCKS = 16  # across the blurred picture


class Drop(NamedTuple):
    """Drop on the window: place in the picture and size, in angles as tangents."""

    u_px: float
    v_px: float
    width_mm: float


class LensDrops:
    """Drops on the window of one camera."""

    def __init__(self, falling: Precipitation, camera: CameraModel, settings: Any, key: tuple[int, int]) -> None:
        """`settings`: sim.sensors.camera_parameters.LensDrops."""
        s = settings
        self._camera, self._pupil_mm, self._away_mm = camera, s.pupil_mm, s.distance_mm
        self._stay_ns, self._key = round(s.stay_s * NS_PER_S), np.array(key, np.uint64)
        edges = [
            _LEAST_MM + (falling.width_mm(falling.largest_mm) - _LEAST_MM) * k / _CLASSES for k in range(_CLASSES + 1)
        ]
        middles = [0.5 * (a + b) for a, b in pairwise(edges)]
        flux = [  # per m2 and s, of each class
            (falling.per_m3(a) - falling.per_m3(b)) * falling.fall_mps(middle)
            for a, b, middle in zip(edges, edges[1:], middles, strict=False)
        ]
        self.flux_per_m2_s = sum(flux)
        total = 0.0
        shares = []
        for part in flux:
            total += part
            shares.append(total)
        self._widths_mm, self._shares = middles, np.array(shares) / (total or 1.0)
        across_mm = 2.0 * s.distance_mm * 0.5 * camera.width / camera.fx + s.pupil_mm
        down_mm = 2.0 * s.distance_mm * 0.5 * camera.height / camera.fy + s.pupil_mm
        area_m2 = 1e-6 * across_mm * down_mm
        self.mean_in_slot = min(s.exposed * area_m2 * self.flux_per_m2_s * 1.5 * s.stay_s, 0.6 * _MOST_DROPS)
        self._counts = _poisson_shares(self.mean_in_slot)
        self._picture = LinearPicture(camera)

    def on_window(self, t_ns: int) -> list[Drop]:
        """Return the drops that are there at a time, in the order in which they came."""
        slot_ns = 3 * self._stay_ns // 2
        now = t_ns // slot_ns
        return [drop for slot in (now - 1, now) if slot >= -1 for drop in self._of_slot(slot, slot_ns, t_ns)]

    def _of_slot(self, slot: int, slot_ns: int, t_ns: int) -> list[Drop]:
        # Slot -1 is the time before the run, in which it rained as well.
        raw = np.random.Philox(key=self._key, counter=[0, 0, 0, slot + 1]).random_raw(1 + 5 * _MOST_DROPS)
        u = uniform_from_bits(raw)
        count = int(np.searchsorted(self._counts, u[0]))
        found, camera = [], self._camera
        margin_px = 0.5 * self._pupil_mm / self._away_mm * camera.fx
        for come, stays, x, y, size in u[1 : 1 + 5 * count].reshape(count, 5).tolist():
            from_ns = slot * slot_ns + int(come * slot_ns)
            if not from_ns <= t_ns < from_ns + int((0.5 + stays) * self._stay_ns):
                continue
            width_mm = self._widths_mm[min(int(np.searchsorted(self._shares, size)), _CLASSES - 1)]
            u_px = x * (camera.width + 2.0 * margin_px) - margin_px
            found.append(Drop(u_px, y * (camera.height + 2.0 * margin_px) - margin_px, width_mm))
        return found

    def draw(self, rgb: NDArray[np.uint8], t_ns: int) -> None:
        """Draw the drops at a time; pixels without one keep their bits."""
        drops = self.on_window(t_ns)
        if not drops:
            return
        self._picture.load(rgb)
        blurred = _blocks(self._picture.light)
        touched = np.zeros(rgb.shape[:2], bool)
        for drop in drops:
            self._draw_one(drop, blurred, touched)
        self._picture.store(rgb, touched)

    def _draw_one(self, drop: Drop, blurred: NDArray[np.float32], touched: NDArray[np.bool_]) -> None:
        camera, a, d = self._camera, self._pupil_mm, self._away_mm
        reach_px = 0.5 * (drop.width_mm + a) / d * camera.fx
        first, last = max(int(drop.u_px - reach_px), 0), min(int(drop.u_px + reach_px) + 2, camera.width)
        top, bottom = max(int(drop.v_px - reach_px), 0), min(int(drop.v_px + reach_px) + 2, camera.height)
        if first >= last or top >= bottom:
            return
        du = np.arange(first, last) + 0.5 - drop.u_px
        dv = np.arange(top, bottom) + 0.5 - drop.v_px
        away_mm = np.sqrt((du * du)[None, :] + (dv * dv)[:, None]) * (d / camera.fx)
        most = min(1.0, (drop.width_mm / a) * (drop.width_mm / a))
        ramp = (0.5 * (drop.width_mm + a) - away_mm) / min(drop.width_mm, a)
        opacity = (most * np.minimum(np.maximum(ramp, 0.0), 1.0)).astype(np.float32)
        rows, columns = blurred.shape[:2]
        above, below, down = _between((drop.v_px - _INVERTED * dv) * (rows / camera.height), rows)
        left, right, along = _between((drop.u_px - _INVERTED * du) * (columns / camera.width), columns)
        lines = blurred[above] + down[:, None, None] * (blurred[below] - blurred[above])
        seen = lines[:, left] + along[None, :, None] * (lines[:, right] - lines[:, left])
        area = self._picture.light[top:bottom, first:last]
        area += opacity[:, :, None] * (seen - area)
        touched[top:bottom, first:last] |= opacity > 0.0


def _between(
    place: NDArray[np.float64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return the two blocks next to each place, and the share of the second one; beyond the rim, the last block."""
    place = np.minimum(np.maximum(place - 0.5, 0.0), count - 1.0)
    first = place.astype(np.int64)
    return first, np.minimum(first + 1, count - 1), (place - first).astype(np.float32)


def _blocks(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the means of blocks of a picture; sums in a fixed order, because numpy's depend on the processor."""
    size = max(min(linear.shape[0], linear.shape[1]) // _BLOCKS, 1)
    rows, columns = linear.shape[0] // size, linear.shape[1] // size
    cut = linear[: rows * size, : columns * size]
    lines = cut[0::size].copy()
    for k in range(1, size):
        lines += cut[k::size]
    means = lines[:, 0::size].copy()
    for k in range(1, size):
        means += lines[:, k::size]
    means *= np.float32(1.0 / (size * size))
    return means


def _poisson_shares(mean: float) -> NDArray[np.float64]:
    """Return the probabilities of at most 0, 1, 2, ... drops; the last one is 1."""
    term = total = det_exp(-mean)
    shares = [total]
    for k in range(1, _MOST_DROPS):
        term *= mean / k
        total += term
        shares.append(total)
    return np.array([*shares, 1.0])
