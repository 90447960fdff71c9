"""Optical and radar properties of common materials.

Permittivity and conductivity at 60 GHz:

* concrete, brick, wood, glass, plasterboard, metal: Recommendation ITU-R P.2040-3 (2023), table 3,
  eps = a f^b, sigma = c f^d with f = 60 [GHz]. The row of brick ends at 40 GHz and is extrapolated to 60.
* gravel and soil: the same table, "very dry" and "medium dry ground", at 10 GHz, where the rows end.
* asphalt: eps = 3.18 - j 0.1 at 94 GHz (Li & Sarabandi, IEEE Trans. Antennas Propag. 47, 1999, p. 851).
* skin: dry skin at 60 GHz (Gabriel, Lau & Gabriel, Phys. Med. Biol. 41, 1996, p. 2271). Cloth is thinner than a
  wavelength, eps near 1.5, and transmits most of the wave, so CLOTH has the values of skin and the roughness of cloth.
* leaves: eps = 0.522 (1 - 1.32 m) eps_water + 0.51 + 3.84 m with dry matter m = 0.3 (Maetzler, IEEE Trans. Geosci.
  Remote Sens. 32, 1994, p. 947), and water at 20 degC from Recommendation ITU-R P.527-6: eps = 11.9 - j 19.5.
* rubber, plastic, sandbags (dry sand in cloth), carbon fibre (along its fibres) and propellers (polyamide with glass
  fibre): order-of-magnitude handbook values without a single source.

An imaginary part eps'' at 60 GHz is a conductivity of eps'' * 3.338 S/m.

Retroreflection is the least that EN 12899-1 (class RA2, white) asks of a road sign and ISO 7591 of a number plate.

Reflectivity at 905 nm is rounded from the ECOSTRESS spectral library (Meerdink et al., Remote Sens. Environ. 230,
2019); the values of paint and cloth, which vary with the dye, are averages. Roughness is an order of magnitude.
"""

from __future__ import annotations

from sim.scene.scene_map import Surface

CONCRETE = Surface(0.35, 5.24, 1.14, 3e-4)
PLASTER = Surface(0.60, 2.73, 0.398, 2e-4)
BRICK = Surface(0.38, 3.91, 0.0458, 5e-4)
ROOF_TILE = Surface(0.35, 3.91, 0.0458, 2e-3)  # fired clay, as brick, laid in steps
STONE = Surface(0.40, 5.24, 1.14, 3e-3)  # as concrete, rough
WOOD = Surface(0.45, 1.99, 0.378, 2e-4)
BARK = Surface(0.35, 1.99, 0.378, 5e-3)
GLASS = Surface(0.08, 6.31, 0.867, 1e-6)
METAL = Surface(0.50, 1.0, 1e7, 2e-6)
PAINTED_METAL = Surface(0.45, 1.0, 1e7, 1e-5)
ASPHALT = Surface(0.17, 3.18, 0.334, 5e-4)
ROAD_PAINT = Surface(0.75, 3.18, 0.334, 3e-4)
GRAVEL = Surface(0.30, 3.0, 0.0497, 5e-3)
SOIL = Surface(0.25, 11.9, 1.49, 5e-3)
SAND = Surface(0.40, 3.0, 0.0497, 1e-3)
SANDBAG = Surface(0.40, 2.5, 0.05, 5e-3)
GRASS = Surface(0.45, 5.41, 20.5, 2e-2)
LEAVES = Surface(0.50, 5.41, 20.5, 5e-2)
WATER = Surface(0.02, 11.9, 65.1, 1e-4)
SKIN = Surface(0.55, 7.98, 36.4, 1e-3)
CLOTH = Surface(0.45, 7.98, 36.4, 2e-3)
HAIR = Surface(0.25, 7.98, 36.4, 3e-3)
RUBBER = Surface(0.06, 5.0, 0.5, 1e-3)
PLASTIC = Surface(0.40, 2.6, 0.05, 1e-5)
BLACK_PLASTIC = Surface(0.06, 2.6, 0.05, 1e-5)  # coloured by carbon black
CARBON_FIBRE = Surface(0.06, 1.0, 1e4, 1e-5)
SIGN_SHEETING = Surface(0.75, 3.18, 0.334, 3e-4, retroreflection=250.0)  # otherwise as road paint
NUMBER_PLATE = Surface(0.40, 2.6, 0.05, 1e-5, retroreflection=70.0)  # otherwise as plastic
PROPELLER = Surface(0.06, 3.5, 0.1, 1e-5)  # of drones; radars tell rotor blades by it
# Surfaces by name, which a scene assigns to the materials of its MJCF.
_NAMES = """
    concrete brick wood metal glass asphalt soil grass water plastic plaster roof_tile stone painted_metal gravel sand
    rubber sign_sheeting number_plate
"""
SURFACES: dict[str, Surface] = {name: globals()[name.upper()] for name in _NAMES.split()}
SURFACES |= {"foliage": LEAVES, "skin_clothes": CLOTH}
NO_SURFACE = Surface(lidar_reflectivity=0.0, relative_permittivity=1.0, conductivity_s_per_m=0.0, roughness_m=0.0)
DEFAULT_SURFACE = SURFACES["concrete"]  # of geoms without a material, or with one that has no surface
MAX_SURFACES = 256  # a surface id is one byte
