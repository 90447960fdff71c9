"""Random light and haze.

With E the light on level ground in the open, s the sky's share of E, and e the sun's elevation:

    ambient = E s c_sky,    sun = E (1 - s) c_sun / max(sin e, 0.35)

The lower limit of the sine keeps walls that face a low sun from saturating. c_sun is the colour of a black body of the
drawn temperature. As s grows, c_sky, zenith and horizon change from the blue of a clear sky to the grey of an overcast
one; under a low sun the horizon takes some of its colour.
"""

from __future__ import annotations

from sim.randomize.settings import HazeLimits, LightLimits
from sim.scene.light import Light, Rgb
from sim.scene.random_generator import feature_rng
from sim.scene.weather import Weather

_CLEAR_E = 1.05  # E of ambient light 0.4 and the default sun at 45 degrees
_MIN_SINE = 0.35
_CLEAR_SHARE, _OVERCAST_SHARE = 0.35, 0.8  # shares s of a clear and of an overcast sky
# Colours at brightness 1.
_BLUE_ZENITH: Rgb = (0.16, 0.34, 0.70)
_BLUE_HORIZON: Rgb = (0.62, 0.74, 0.88)
_GREY_ZENITH: Rgb = (0.60, 0.63, 0.67)
_GREY_HORIZON: Rgb = (0.74, 0.76, 0.79)
_BLUE_LIGHT: Rgb = (0.88, 0.98, 1.13)
_GREY_LIGHT: Rgb = (0.97, 1.0, 1.03)
_LUMINANCE: Rgb = (0.2126, 0.7152, 0.0722)
_MAX_CHANNEL = 10.0  # greatest value that a colour of `Light` accepts


def draw_light(limits: LightLimits, seed: int) -> Light:
    """Draw sun and sky, as a pure function of the arguments."""
    rng = feature_rng(seed, "light")
    azimuth_deg = rng.between(*limits.sun_azimuth_deg)
    elevation_deg = rng.between(*limits.sun_elevation_deg)
    brightness = rng.between(*limits.brightness)
    sun_colour = black_body(rng.between(*limits.colour_temperature_k))
    share = rng.between(*limits.ambient_share)
    sine = Light(sun_elevation_deg=elevation_deg).to_sun_W[2]
    level = _CLEAR_E * brightness
    grey = min(max((share - _CLEAR_SHARE) / (_OVERCAST_SHARE - _CLEAR_SHARE), 0.0), 1.0)
    horizon = _mix(_BLUE_HORIZON, _GREY_HORIZON, grey)
    glow = _mix(horizon, _times(sun_colour, 0.75), 0.35 * (1.0 - sine) * (1.0 - grey))
    return Light(
        sun_azimuth_deg=azimuth_deg,
        sun_elevation_deg=elevation_deg,
        sun_rgb=_times(sun_colour, level * (1.0 - share) / max(sine, _MIN_SINE)),
        ambient_rgb=_times(_mix(_BLUE_LIGHT, _GREY_LIGHT, grey), level * share),
        sky_zenith_rgb=_times(_mix(_BLUE_ZENITH, _GREY_ZENITH, grey), brightness),
        sky_horizon_rgb=_times(glow, brightness),
        clouds=0.25 + 0.75 * grey,
    )


def draw_weather(weather: Weather, limits: HazeLimits, seed: int) -> Weather:
    """Return the weather in another haze, as a pure function of the arguments."""
    rng = feature_rng(seed, "haze")
    clear = rng.chance(limits.clear_share)
    visibility_m = rng.log_between(*limits.visibility_m)
    return weather.model_copy(update={"visibility_m": None if clear else visibility_m})


def black_body(temperature_k: float) -> Rgb:
    """Return the linear sRGB colour of a black body, of luminance 1; channels outside the gamut are 0.

    Chromaticity by the cubics of Kim, Kim, Choe & Kang (US patent 7,024,034, 2006), 1667 to 25,000 K.
    """
    k = 1000.0 / temperature_k
    if temperature_k <= 4000.0:
        x = ((-0.2661239 * k - 0.2343589) * k + 0.8776956) * k + 0.179910
    else:
        x = ((-3.0258469 * k + 2.1070379) * k + 0.2226347) * k + 0.240390
    if temperature_k <= 2222.0:
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
    elif temperature_k <= 4000.0:
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
    else:
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483
    X, Z = x / y, (1.0 - x - y) / y
    rgb = (
        max(3.2404542 * X - 1.5371385 - 0.4985314 * Z, 0.0),
        max(-0.9692660 * X + 1.8760108 + 0.0415560 * Z, 0.0),
        max(0.0556434 * X - 0.2040259 + 1.0572252 * Z, 0.0),
    )
    return _times(rgb, 1.0 / (_LUMINANCE[0] * rgb[0] + _LUMINANCE[1] * rgb[1] + _LUMINANCE[2] * rgb[2]))


def _times(rgb: Rgb, factor: float) -> Rgb:
    return tuple(min(factor * channel, _MAX_CHANNEL) for channel in rgb)  # type: ignore[return-value]


def _mix(a: Rgb, b: Rgb, share: float) -> Rgb:
    return tuple(p + share * (q - p) for p, q in zip(a, b, strict=True))  # type: ignore[return-value]
