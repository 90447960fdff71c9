"""Sky and sun of the path tracer: a clear sky (Hosek and Wilkie, SIGGRAPH 2012, as in Mitsuba's `sunsky`) and haze.

The model follows from the sun's elevation and the turbidity. The scene's light (sim/scene/light.py) scales it: its
colours relative to the defaults multiply the sun's and the sky's, so that a dim sun or an overcast sky of a scene stays
dim or overcast. Haze takes light from the sun and adds it to the sky, as in the raster.

The exposure is that of a fixed camera for this elevation: a white surface that lies flat, or faces the sun at 30
degrees when the sun is lower, has the value 1 before the tone curve. It depends on nothing in view, so pictures of one
scene compare with each other. White is the colour of this light, partly corrected when the sun is low.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sim.frame.path_traced.sky_request import SkyRequest
from sim.scene.weather import HAZE_M

_ROWS, _COLUMNS = 64, 192
_LEAST_ELEVATION_DEG = 1.5  # of the model; a lower sun has this sky and no light of its own
_LEAST_SINE = 0.5
_SUN_SOLID_ANGLE = 6.87e-5  # [sr]
_GROUND_ALBEDO = 0.18
_CLEAR_AIR_PER_M = 8e-5  # a visibility of 49 km
_SUN_AS_SEEN = 300.0  # of white: the disc itself is brighter than any camera can show


class Sky(NamedTuple):
    """Radiance of the sky and irradiance of the sun, in one unit."""

    map: np.ndarray  # (rows, columns, 3)
    to_sun: np.ndarray
    sun_rgb: np.ndarray  # irradiance across the rays
    disc_rgb: np.ndarray
    ground_rgb: np.ndarray
    extinction_per_m: float  # of haze; clear air adds its own
    clear_air_per_m: float
    haze_m: float
    white: float  # radiance of a white surface in the light that the exposure is set for
    balance: np.ndarray  # (3,) factors of the white balance


def make_sky(request: SkyRequest) -> Sky:
    """Return the sky, tabulated. Runs in the child process: the model is Mitsuba's."""
    import mitsuba as mi

    x, y, z = request.to_sun
    least = np.sin(np.radians(_LEAST_ELEVATION_DEG))
    up = max(z, least)
    across = np.sqrt(max(1.0 - up * up, 0.0)) / max(np.hypot(x, y), 1e-9)
    model_sun = [float(x * across), float(y * across), float(up)]
    model = {"type": "sunsky", "sun_direction": model_sun, "turbidity": request.turbidity, "albedo": _GROUND_ALBEDO}
    directions = _directions()
    sky = _radiance(mi.load_dict({**model, "sun_scale": 0.0}), directions.reshape(-1, 3)).reshape(directions.shape)
    sun = _radiance(mi.load_dict({**model, "sky_scale": 0.0}), np.array([model_sun]))[0] * _SUN_SOLID_ANGLE
    sun = np.maximum(sun, 0.0)
    reference = _irradiance(sky) + sun * max(up, _LEAST_SINE)  # of the default light in clear air
    sky *= np.array(request.ambient_rgb)
    clear_sun = sun * np.array(request.sun_rgb) * (z > 0.0)
    sun = clear_sun * np.array(request.haze_sun)
    sky = sky + clear_sun.mean() * request.haze_sky / np.pi * (z > 0.0)
    on_ground = _irradiance(sky) + sun * max(z, 0.0)
    white = float(reference.mean() / np.pi)
    colour = reference / reference.mean()
    return Sky(
        sky,
        np.array(request.to_sun),
        sun,
        np.minimum(sun / _SUN_SOLID_ANGLE, _SUN_AS_SEEN * white),
        _GROUND_ALBEDO * on_ground / np.pi,
        request.extinction_per_m,
        _CLEAR_AIR_PER_M,
        HAZE_M,
        white,
        colour**-0.8,
    )


def _directions() -> np.ndarray:
    """Return unit vectors (rows, columns, 3): rows equally spaced in the root of the sine of the elevation."""
    sine = (np.arange(_ROWS) / (_ROWS - 1)) ** 2
    sine = np.maximum(sine, 1e-4)
    azimuth = (np.arange(_COLUMNS) / _COLUMNS - 0.5) * 2.0 * np.pi
    flat = np.sqrt(1.0 - sine**2)[:, None]
    rows = np.broadcast_to(sine[:, None], (_ROWS, _COLUMNS))
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), rows], axis=-1)


def _radiance(emitter: Any, directions: np.ndarray) -> np.ndarray:
    import drjit as dr
    import mitsuba as mi

    at = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    at.wi = mi.Vector3f(-directions.T.astype(np.float32))
    return np.array(emitter.eval(at), np.float64).T


def _irradiance(sky: np.ndarray) -> np.ndarray:
    """Return the irradiance of level ground: the integral of L sin(e) over the hemisphere."""
    root = np.arange(_ROWS) / (_ROWS - 1)
    sine, step = root**2, 2.0 * root / (_ROWS - 1)  # d(sine) of a row
    weight = sine * step
    weight[-1] *= 0.5
    return 2.0 * np.pi * (sky.mean(axis=1) * weight[:, None]).sum(axis=0)
