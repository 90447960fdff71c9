"""Echoes of a radar from the pictures of a camera at the same pose, one echo for each pixel.

Radar equation in its pixel form (paper, eq. (7)), for the solid angle dOmega of a pixel at incidence theta:

    P_r = P_t G_t(d) G_r(d) lambda^2 sigma0(theta) dA / ((4 pi)^3 R^4),    dA = R^2 dOmega / cos(theta)
    A   = counts_per_sqrt_watt sqrt(P_r) = W(d) sqrt(sigma0 / cos(theta)) / R

W(d) is computed once per camera and sqrt(sigma0 / cos) once per surface; the kernel combines them in one pass over the
picture (sim/native/radar/scatterers.hpp). Axes: x_R = z_C, y_R = -x_C, z_R = -y_C.

Pixels without an echo are dropped and counted in `last`: sky (infinite range), no surface, surfaces that face away,
pixels outside the mask, directions where the two-way antenna gain relative to the axis is below `PATTERN_FLOOR`, and
`invalid` pixels, whose range, normal or velocity is not finite.

With a pose, the echoes of the map's corner reflectors follow those of the pixels (sim/radar/corner_echoes.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim._kernels import collect_scatterers, pixel_solid_angles
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.radar.antenna import Antenna
from sim.radar.chirp import Chirp
from sim.radar.corner_echoes import CameraPixels, CornerEchoes
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.radar.receiver import Receiver
from sim.radar.reflection import Reflection
from sim.scene.world import World

Float64 = NDArray[np.float64]

PATTERN_FLOOR = 1e-6  # two-way gain relative to the axis: -60 dB
NO_MASK = Mask()
DEFAULT_REFLECTION = Reflection()
_LANES = 16  # pixels per block of the kernel
_FOUR_PI = 12.566370614359172
_MAX_RANGE_M = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class ScattererReport:
    """Counts of pixels by result; each pixel counts once, by the first reason that holds."""

    pixels: int
    window: int  # outside the mask's windows of angles
    pattern: int  # gain of the antennas below the floor
    invalid: int
    sky: int
    nothing: int  # no surface, or a surface without backscatter
    range: int  # beyond the mask's range
    classes: int  # class not in the mask
    away: int  # surface faces away from the radar
    kept: int
    corners: int = 0  # visible corner reflectors, whose echoes follow those of pixels


class Scatterers:
    """Conversion of one camera's pictures to echoes.

    Raises ValueError if the mask names an unknown class or leaves no pixel, or if the distortion cannot be inverted at
    the picture's corners. `isa`: instruction set of the kernels; all give the same bits.
    """

    def __init__(
        self,
        camera: CameraModel,
        world: World,
        chirp: Chirp,
        antenna: Antenna,
        receiver: Receiver,
        mask: Mask = NO_MASK,
        reflection: Reflection = DEFAULT_REFLECTION,
        isa: str = "",
    ) -> None:
        self.camera = camera
        self._isa = isa
        # Directions in which echoes leave matter only to transmitters away from the origin.
        self._places_matter = any(x != 0.0 for place in antenna.tx_positions_m for x in place)
        self._class_kept = mask.kept_classes(world.class_names)
        self._max_range_m = _MAX_RANGE_M if mask.max_range_m is None else mask.max_range_m
        self._curves = reflection.curves(world.surfaces, chirp.center_frequency_hz)
        rays_C = np.ascontiguousarray(camera.rays()).reshape(-1, 3)
        self.direction_R = np.stack([rays_C[:, 2], -rays_C[:, 0], -rays_C[:, 1]], axis=1)
        pixels = len(rays_C)

        inside = mask.in_window(self.direction_R)
        share = antenna.share(self.direction_R)
        active = inside & (share >= PATTERN_FLOOR)
        if not active.any():
            cause = "the mask's windows of angles leave" if not inside.any() else "mask and antenna pattern leave"
            raise ValueError(
                f"{cause} no pixel of the camera's {camera.width} x {camera.height}: "
                f"azimuth_deg {_words(mask.azimuth_deg)}, elevation_deg {_words(mask.elevation_deg)}; widen them"
            )
        self._window = int(np.count_nonzero(~inside))
        self._pattern = pixels - self._window - int(np.count_nonzero(active))

        scale = amplitude_scale(chirp, antenna, receiver)
        pixel_sr = solid_angles(camera)
        weight = scale * np.sqrt(share * pixel_sr.reshape(-1))
        # The kernel treats a weight of 0 as a dropped pixel, so float weights must not underflow.
        weight = np.where(active, np.clip(weight, 1e-30, 1e30), 0.0)
        self._blocks = _blocks(rays_C, weight)
        self.weight = weight  # of each pixel, as `direction_R`
        self._used = 0  # rows of echoes
        self._ways: Float64 | None = None  # directions in which they leave, where these matter

        self._corners = CornerEchoes(
            world.map.corners,
            CameraPixels(camera, rays_C.reshape(camera.height, camera.width, 3), pixel_sr),
            antenna,
            mask,
            pattern_floor=PATTERN_FLOOR,
            amplitude_scale=scale,
            wavelength_m=chirp.wavelength_m,
        )
        capacity = pixels + len(self._corners)
        self._out = Echoes(np.empty(capacity), np.empty(capacity), np.empty((capacity, 3)), np.empty(capacity))
        self.channels: tuple[str, ...] = ("range", "normal", "material", "radial_velocity")
        if self._class_kept is not None:
            self.channels += ("segmentation",)
        self.last = ScattererReport(pixels, self._window, self._pattern, 0, 0, 0, 0, 0, 0, 0)

    def collect(self, picture: Mapping[str, NDArray[Any]], pose: CameraPose | None = None) -> Echoes:
        """Return the echoes in the order of the pixels, as views that are valid until the next call.

        `pose`: pose of the picture; with it, the echoes of visible corner reflectors follow. Raises KeyError for a
        missing channel, ValueError for another size or an unknown surface, TypeError for arrays of another type.
        """
        for name in self.channels:
            if name not in picture:
                raise KeyError(f"the picture has no channel {name!r}; a radar needs {', '.join(self.channels)}")
        size = picture["range"].shape
        if size != (self.camera.height, self.camera.width):
            raise ValueError(f"a picture of shape {size}, not of the camera's {self.camera.height, self.camera.width}")
        out = self._out
        invalid, sky, nothing, unknown, far, classes, away, kept = collect_scatterers(
            self._blocks,
            self.direction_R,
            self._curves,
            self._class_kept,
            self._max_range_m,
            picture["range"],
            picture["normal"],
            picture["material"],
            picture["radial_velocity"],
            picture["segmentation"] if self._class_kept is not None else None,
            out.range_m,
            out.speed_mps,
            out.direction_R,
            out.amplitude,
            self._isa,
        )
        if unknown:
            raise ValueError(
                f"{unknown} pixels show a surface beyond the world's {len(self._curves)}: is the picture of this world?"
            )
        corners = self._corners.write(picture["range"], pose, out, kept) if pose is not None else 0
        self.last = ScattererReport(
            len(self.direction_R),
            self._window,
            self._pattern,
            invalid,
            sky,
            nothing,
            far,
            classes,
            away,
            kept,
            corners,
        )
        n = kept + corners
        self._used, self._ways = n, None
        return Echoes(out.range_m[:n], out.speed_mps[:n], out.direction_R[:n], out.amplitude[:n])

    def with_more(self, more: Echoes) -> Echoes:
        """Return the echoes since the last `collect` and others behind them, as views that are valid until the next."""
        first, last = self._used, self._used + len(more.range_m)
        if last > len(self._out.range_m):
            o, capacity = self._out, last + last // 8
            self._out = Echoes(
                _grown(o.range_m, first, capacity),
                _grown(o.speed_mps, first, capacity),
                _grown(o.direction_R, first, capacity),
                _grown(o.amplitude, first, capacity),
            )
        o = self._out
        o.range_m[first:last] = more.range_m
        o.speed_mps[first:last] = more.speed_mps
        o.direction_R[first:last] = more.direction_R
        o.amplitude[first:last] = more.amplitude
        self._used = last
        if self._places_matter and (more.out_direction_R is not None or self._ways is not None):
            leaves = more.direction_R if more.out_direction_R is None else more.out_direction_R
            self._ways = np.concatenate([o.direction_R[:first] if self._ways is None else self._ways, leaves])
        return Echoes(o.range_m[:last], o.speed_mps[:last], o.direction_R[:last], o.amplitude[:last], self._ways)


def _grown(array: Float64, used: int, capacity: int) -> Float64:
    """Return an array with more rows, the first `used` of them those of `array`."""
    grown = np.empty((capacity, *array.shape[1:]))
    grown[:used] = array[:used]
    return grown


def amplitude_scale(chirp: Chirp, antenna: Antenna, receiver: Receiver) -> float:
    """Return A R^2 of an echo on the axis per root of its cross-section [counts m]."""
    gain = antenna.tx.axis_gain * antenna.rx.axis_gain
    spread = chirp.wavelength_m * chirp.wavelength_m / (_FOUR_PI * _FOUR_PI * _FOUR_PI)
    return receiver.counts_per_sqrt_watt * sqrt(receiver.tx_power_w * gain * spread)


def solid_angles(camera: CameraModel) -> Float64:
    """Return the solid angle of each pixel [sr], between the rays of its corners, (height, width)."""
    x = (np.arange(camera.width + 1) - camera.cx) / camera.fx
    y = (np.arange(camera.height + 1) - camera.cy) / camera.fy
    corners = camera.directions(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    out = np.empty((camera.height, camera.width))
    pixel_solid_angles(np.ascontiguousarray(corners).reshape(camera.height + 1, camera.width + 1, 3), out)
    return out


def _blocks(rays_C: Float64, weight: Float64) -> NDArray[np.float32]:
    """Return direction and weight in blocks of 16 pixels, (blocks, 4, 16), padded with pixels of weight 0."""
    count = -(-len(rays_C) // _LANES)
    rows = np.zeros((count * _LANES, 4), np.float32)
    rows[: len(rays_C), :3] = rays_C
    rows[: len(rays_C), 3] = weight
    return np.ascontiguousarray(rows.reshape(count, _LANES, 4).transpose(0, 2, 1))


def _words(window: tuple[float, float] | None) -> str:
    return "all" if window is None else f"{window[0]:g} to {window[1]:g}"
