"""Earth's magnetic field at a site, from the World Magnetic Model."""

from __future__ import annotations

import pygeomag

from hil.signals.samples import Vec3
from sim.scene.scene import Site

# Fixed, so that a run repeats next year: the field turns by about 0.2 degrees a year at mid latitudes.
EPOCH_YEAR = 2026.0

_TESLA_PER_NANOTESLA = 1e-9


def magnetic_field_W_tesla(site: Site) -> Vec3:
    """Field at `site` in W (ENU) [T], by WMM2025 at `EPOCH_YEAR`.

    Rounded to 1e-12 T, 100,000 times finer than the model's own error: pygeomag uses the C library's sin and cos,
    whose last bit depends on the CPU, and rounding takes that bit away. Constant over a scene: a kilometre changes
    the field by some 1e-8 T.
    """
    field = pygeomag.GeoMag().calculate(
        glat=site.latitude_deg, glon=site.longitude_deg, alt=site.altitude_m / 1000.0, time=EPOCH_YEAR
    )
    north, east, down = float(field.x), float(field.y), float(field.z)  # nT
    return (
        round(east * _TESLA_PER_NANOTESLA, 12),
        round(north * _TESLA_PER_NANOTESLA, 12),
        round(-down * _TESLA_PER_NANOTESLA, 12),
    )
