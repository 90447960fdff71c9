"""Temperatures of a scene: its air, sky, sunlight and surfaces, for thermal cameras.

Air. T_a is that of the site, without a change with height; relative humidity 50 %.

Sky. The emissivity of a clear sky in 8 to 14 um is (Idso, Water Resources Research 17, 1981; e_0: vapour pressure,
hPa)

    e_h = 0.24 + 2.98e-8 e_0^2 exp(3000 / T_a),    e_z = 1 - (1 - e_h)^(1 / 1.66)          of the hemisphere, the zenith
    e(el) = 1 - (1 - e_z)^(1 / sin el)                                                at an elevation, a slab of air

and clouds over a share c of the sky raise it to e + 0.84 c (1 - e) (Unsworth and Monteith, Q. J. R. Met. Soc. 101,
1975).

Sunlight. E_b = 1361 W/m2 0.7^(AM^0.678), AM = 1 / sin el (Meinel and Meinel, "Applied solar energy", 1976), as far as
haze lets it through (sim/scene/light.py); diffuse light of 0.1 E_b besides. Clouds cast no shadows, as in pictures.

Surfaces. A surface with the normal n has the sol-air temperature of ASHRAE (Handbook of Fundamentals; Mackey and
Wright, 1944), of which it reaches the share g, because it stores heat or evaporates water:

    T = T_a + g (a (E_b max(n . s, 0) lit + E_d F) - e dR F) / h,     F = (1 + n_z) / 2 the share of sky that it sees
    dR = sigma T_a^4 (1 - e_sky) of all wavelengths, e_sky = 0.52 + 0.065 sqrt(e_0) (Brunt 1932), clouds as above
    h  = 5.7 + 3.8 v + 4 sigma T_a^3                                  (McAdams 1954; v: wind, at least 1 m/s)

a: absorptance of sunlight. Equilibrium without a past: no warm walls at night, no cool ones in the morning.

People. Bare skin 306 K; clothes T_a + 0.39 (306 K - T_a), for an insulation of 1 clo = 0.155 m2 K/W and 10 W/(m2 K)
outside it (ISO 7730); hair in the middle. Vehicles that drive: bonnet 25 K, tyres 10 K over the air, besides the sun
(choices).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from signals._kernel import det_exp, det_log, det_pow
from signals.units import STEFAN_BOLTZMANN_W_PER_M2_K4
from sim.scene import surfaces
from sim.scene.atmosphere import ZERO_DEGC_K
from sim.scene.light import light_in_haze
from sim.scene.scene import Scene
from sim.scene.scene_map import Surface

SKIN_K = 306.0
CLOTHES_SHARE = 1.0 / (1.0 + 10.0 * 0.155)  # of the way from the air to the skin
HAIR_SHARE = 0.5
BONNET_K, TYRE_K = 25.0, 10.0  # over the air
HUMIDITY = 0.5
_SUN_W_PER_M2, _DIFFUSE = 1361.0, 0.1
_LEAST_WIND_MPS = 1.0
_LEAST_SINE = 0.02


class Heat(NamedTuple):
    """Thermal properties of a surface."""

    emissivity: float  # 8 to 14 um
    absorptance: float  # of sunlight
    share: float  # g


# Emissivity and absorptance (1 - albedo) after Oke, "Boundary layer climates" (1987), table 1.1, and ECOSTRESS;
# shares are choices.
_DEFAULT = Heat(0.93, 0.60, 0.6)
_HEAT: dict[Surface, Heat] = {
    surfaces.CONCRETE: Heat(0.94, 0.65, 0.6),
    surfaces.PLASTER: Heat(0.91, 0.40, 0.6),
    surfaces.BRICK: Heat(0.93, 0.68, 0.6),
    surfaces.ROOF_TILE: Heat(0.92, 0.75, 0.8),
    surfaces.STONE: Heat(0.93, 0.65, 0.5),
    surfaces.WOOD: Heat(0.90, 0.60, 0.8),
    surfaces.BARK: Heat(0.95, 0.75, 0.4),
    surfaces.GLASS: Heat(0.88, 0.15, 0.6),
    surfaces.METAL: Heat(0.25, 0.40, 0.8),
    surfaces.PAINTED_METAL: Heat(0.92, 0.60, 0.9),
    surfaces.ASPHALT: Heat(0.95, 0.88, 0.7),
    surfaces.ROAD_PAINT: Heat(0.92, 0.40, 0.7),
    surfaces.GRAVEL: Heat(0.94, 0.70, 0.6),
    surfaces.SOIL: Heat(0.94, 0.80, 0.5),
    surfaces.SAND: Heat(0.91, 0.62, 0.6),
    surfaces.SANDBAG: Heat(0.91, 0.62, 0.6),
    surfaces.GRASS: Heat(0.97, 0.78, 0.35),
    surfaces.LEAVES: Heat(0.97, 0.82, 0.15),
    surfaces.WATER: Heat(0.96, 0.93, 0.03),
    surfaces.SKIN: Heat(0.98, 0.65, 0.05),  # of skin and clothes, the share of the sun's and the sky's part alone
    surfaces.CLOTH: Heat(0.95, 0.65, 0.4),
    surfaces.HAIR: Heat(0.95, 0.80, 0.3),
    surfaces.RUBBER: Heat(0.94, 0.90, 0.6),
    surfaces.PLASTIC: Heat(0.92, 0.50, 0.8),
    surfaces.BLACK_PLASTIC: Heat(0.94, 0.92, 0.8),
    surfaces.SIGN_SHEETING: Heat(0.90, 0.50, 0.9),
    surfaces.NUMBER_PLATE: Heat(0.92, 0.40, 0.9),
}


def heat_of(surface: Surface) -> Heat:
    """Return the thermal properties of a surface; those of a scene's own surface are those of plain masonry."""
    return _HEAT.get(surface, _DEFAULT)


@dataclass(frozen=True)
class Climate:
    """Air, sky and sunlight of a scene, and how they heat a surface."""

    air_k: float
    sky_zenith: float  # e_z, clear
    clouds: float
    beam_w_per_m2: float  # E_b
    diffuse_w_per_m2: float
    loss_w_per_m2: float  # dR
    exchange_w_per_m2_k: float  # h
    to_sun_W: tuple[float, float, float]

    def sky_emissivity(self, sine: float) -> float:
        """Return that of the sky in 8 to 14 um at an elevation, by its sine."""
        clear = 1.0 - det_pow(1.0 - self.sky_zenith, 1.0 / max(sine, _LEAST_SINE))
        return clear + 0.84 * self.clouds * (1.0 - clear)

    @property
    def sky_hemisphere(self) -> float:
        """Emissivity of the whole sky in 8 to 14 um."""
        clear = 1.0 - det_pow(1.0 - self.sky_zenith, 1.66)
        return clear + 0.84 * self.clouds * (1.0 - clear)


def vapour_pressure_hpa(air_k: float) -> float:
    """Return that of air of 50 % humidity: Magnus' formula (WMO, CIMO guide, annex 4.B)."""
    t = air_k - ZERO_DEGC_K
    return HUMIDITY * 6.112 * det_exp(17.62 * t / (243.12 + t))


def climate_of(scene: Scene) -> Climate:
    """Return the climate of a scene."""
    air_k, light = scene.site.air_degc + ZERO_DEGC_K, scene.light
    e0 = vapour_pressure_hpa(air_k)
    hemisphere = min(0.24 + 2.98e-8 * e0 * e0 * det_exp(3000.0 / air_k), 1.0)
    haze = light_in_haze(light, scene.extinction_per_m)
    sine, beam = light.to_sun_W[2], 0.0
    if light.sun_elevation_deg > 0.0 and max(light.sun_rgb) > 0.0:
        share = max(haze.sun_rgb) / max(light.sun_rgb)
        air_mass = 1.0 / max(sine, _LEAST_SINE)
        beam = share * _SUN_W_PER_M2 * det_exp(det_log(0.7) * det_pow(air_mass, 0.678))
    sky = 0.52 + 0.065 * math.sqrt(e0)
    sky += 0.84 * light.clouds * (1.0 - sky)
    wind = math.sqrt(sum(component * component for component in scene.wind_W_mps))
    cube = air_k * air_k * air_k
    return Climate(
        air_k=air_k,
        sky_zenith=1.0 - det_pow(1.0 - hemisphere, 1.0 / 1.66),
        clouds=light.clouds,
        beam_w_per_m2=beam,
        diffuse_w_per_m2=_DIFFUSE * beam,
        loss_w_per_m2=STEFAN_BOLTZMANN_W_PER_M2_K4 * cube * air_k * (1.0 - sky),
        exchange_w_per_m2_k=5.7 + 3.8 * max(wind, _LEAST_WIND_MPS) + 4.0 * STEFAN_BOLTZMANN_W_PER_M2_K4 * cube,
        to_sun_W=light.to_sun_W,
    )
