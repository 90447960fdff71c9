"""Textures of the ground: lawn, soil, gravel, asphalt, streets, pavements, kerbs, road paint, manhole covers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.scene.maps.texture_tools import Image, Size, clouds, grain, grid, mix, uniform
from tools.art.textures.layers import cracks, over, step

_LARGE = (1024, 1024)
_MEDIUM = (512, 512)


def _grass() -> Image:
    """Return 16 m of lawn: blades, tufts, patches of dry and of lush grass, clover, daisies, fallen leaves."""
    size = _LARGE
    tufts = 0.5 * clouds("grass.tuft", 150, 150, size) + 0.5 * clouds("grass.clump", 56, 56, size)
    blades = 0.45 * grain("grass", size) + 0.3 * clouds("grass.blade", 340, 200, size) + 0.25 * tufts
    # Blades in the sun before the dark between them: the wide range is what tells grass from paint when it is near.
    t = 0.5 + 1.15 * (blades - 0.5) + 0.30 * (tufts - 0.5) + 0.3 * (clouds("grass.patch", 5, 5, size) - 0.45)
    image = mix((0.205, 0.240, 0.120), (0.565, 0.585, 0.390), t)
    far = 0.55 * clouds("grass.wide", 3, 3, size) + 0.45 * clouds("grass.mid", 11, 11, size)
    worn = step(0.50, 0.85, far + 0.28 * (tufts - 0.5))
    image = over(image, (0.495, 0.470, 0.300), 0.55 * worn * (0.45 + 0.8 * blades))
    clover = step(0.60, 0.74, clouds("grass.clover", 9, 9, size) + 0.25 * (tufts - 0.5))
    image = over(image, (0.235, 0.335, 0.165), 0.5 * clover * (1.3 - blades))
    # Daisies and fallen leaves of two to three texels, where the noise has its peaks.
    spots = clouds("grass.spots", 230, 230, size)
    image = over(image, (0.80, 0.80, 0.70), 1.0 * (spots > 0.965) * (clover + 0.25 > 0.3))
    return over(image, (0.40, 0.30, 0.17), 0.8 * (spots < 0.03) * (far > 0.5))


def _dry_ground() -> Image:
    """Return 16 m of dry soil: pebbles, damp patches, fine cracks, tracks blown over."""
    size = _LARGE
    t = 0.30 * clouds("earth", 9, 9, size) + 0.30 * clouds("earth.mid", 48, 48, size) + 0.40 * grain("earth", size)
    image = mix((0.375, 0.330, 0.265), (0.595, 0.540, 0.450), t)
    wide = 0.6 * clouds("earth.wide", 3, 3, size) + 0.4 * clouds("earth.patch", 13, 13, size)
    image = over(image, (0.64, 0.595, 0.505), 0.40 * step(0.55, 0.8, wide))
    image = over(image, (0.30, 0.255, 0.195), 0.45 * step(0.45, 0.2, wide))
    image *= 1.0 - 0.30 * cracks("earth.crack", 14, size, 0.012) * step(0.5, 0.7, wide)
    pebbles = clouds("earth.pebble", 256, 256, size)
    image = over(image, (0.56, 0.53, 0.47), 0.7 * step(0.90, 0.95, pebbles))
    image = over(image, (0.26, 0.225, 0.18), 0.7 * step(0.14, 0.08, pebbles))
    weeds = step(0.66, 0.80, clouds("earth.weed", 21, 21, size)) * step(
        0.45, 0.75, clouds("earth.blade", 180, 180, size)
    )
    return over(image, (0.33, 0.35, 0.19), 0.7 * weeds)


def _gravel() -> Image:
    """Return 4 m of fine gravel, trodden, with sand in places."""
    size = _MEDIUM
    stones = 0.55 * clouds("gravel.stone", 170, 170, size) + 0.45 * grain("gravel", size)
    t = 0.25 * clouds("gravel", 5, 5, size) + 0.15 * clouds("gravel.mid", 24, 24, size) + 0.6 * stones
    image = mix((0.37, 0.335, 0.28), (0.68, 0.635, 0.555), t)
    sand = step(0.5, 0.8, clouds("gravel.sand", 4, 4, size))
    image = over(image, (0.56, 0.505, 0.415), 0.4 * sand)
    return over(image, (0.28, 0.25, 0.21), 0.7 * step(0.16, 0.08, clouds("gravel.dark", 128, 128, size)))


def _asphalt_grain(name: str, size: Size, cells: int) -> Image:
    t = 0.18 * clouds(name, cells, cells, size) + 0.22 * clouds(f"{name}.mid", 9 * cells, 9 * cells, size)
    return mix((0.25, 0.25, 0.255), (0.50, 0.495, 0.485), t + 0.6 * grain("asphalt", size))


def _asphalt() -> Image:
    """Return 6 m of old asphalt: stones, patches of dirt, cracks, spots of oil."""
    size = _MEDIUM
    image = _asphalt_grain("asphalt", size, 3)
    image *= 1.0 - 0.16 * step(0.55, 0.75, clouds("asphalt.dirt", 5, 5, size))
    image *= 1.0 - 0.4 * cracks("asphalt.crack", 5, size, 0.006) * step(0.5, 0.65, clouds("asphalt.where", 3, 3, size))
    oil = step(0.9, 1.0, clouds("asphalt.oil", 14, 14, size))
    return over(image, (0.15, 0.15, 0.15), 0.5 * oil)


def _near(line: Image, middle: float, reach: float) -> slice:
    """Return the part of an ascending column of numbers that is within `reach` of `middle`."""
    low, high = np.searchsorted(line[:, 0], (middle - reach, middle + reach))
    return slice(int(low), int(high))


def _street() -> Image:
    """Return 14 m of a street of two lanes, v across its 7 m.

    Gutters of small stones at the edges, wheel tracks, drips of oil between them, patches, sealed and open cracks.
    """
    size = (512, 1024)
    image = _asphalt_grain("street", size, 4)
    u, v = grid(size)
    across, along = v * 7.0, u * 14.0  # [m]
    sway, track_tone = clouds("street.sway", 4, 2, size) - 0.5, 0.5 + clouds("street.track", 6, 24, size)
    oil, cut = 0.4 + clouds("street.oil", 40, 60, size), 0.03 * (clouds("street.cut", 90, 90, size) - 0.5)
    for lane in (1.75, 5.25):
        for track in (-0.78, 0.78):
            rows = _near(across, lane + track, 0.40)
            off = across[rows] - (lane + track) - 0.10 * sway[rows]
            image[:, rows] *= 1.0 - 0.13 * step(0.34, 0.10, np.abs(off)) * track_tone[rows]
        rows = _near(across, lane, 0.40)
        drip = step(0.30, 0.02, np.abs(across[rows] - lane - 0.12 * sway[rows]))
        image[:, rows] *= 1.0 - 0.12 * drip * oil[rows]
    image = over(image, (0.48, 0.47, 0.44), 0.35 * step(0.5, 0.85, clouds("street.dust", 7, 14, size)))
    # Patches of younger asphalt with a sealed edge: begin and end along and across [m].
    for a0, a1, c0, c1 in ((1.6, 4.3, 0.9, 2.6), (9.1, 12.9, 4.4, 5.5)):
        rows, columns = (
            _near(across, 0.5 * (c0 + c1), 0.5 * (c1 - c0) + 0.1),
            _near(along.T, 0.5 * (a0 + a1), 0.5 * (a1 - a0) + 0.1),
        )
        x, y = along[:, columns], across[rows]
        edge = np.minimum(np.minimum(x - a0, a1 - x), np.minimum(y - c0, c1 - y))
        edge = edge + cut[rows, columns]
        patch = image[:, rows, columns]
        over(
            patch,
            (0.25, 0.25, 0.252),
            0.28 * step(-0.01, 0.02, edge) * (0.55 + 0.75 * grain("asphalt", size)[rows, columns]),
        )
        over(patch, (0.18, 0.18, 0.182), 0.4 * step(0.05, 0.02, np.abs(edge)))
    seal = cracks("street.seal", 3, size, 0.006)
    image = over(
        image, (0.13, 0.13, 0.135), 0.75 * step(0.2, 0.6, seal) * step(0.45, 0.6, clouds("street.where", 3, 4, size))
    )
    fine = cracks("street.crack", 9, size, 0.010)
    image *= 1.0 - 0.5 * fine * step(0.62, 0.72, clouds("street.craze", 4, 6, size))
    # Joint of the two lanes.
    rows = _near(across, 3.5, 0.1)
    joint = step(0.03, 0.01, np.abs(across[rows] - 3.5))
    image[:, rows] *= 1.0 - 0.4 * joint * step(0.3, 0.5, clouds("street.joint", 9, 2, size)[rows])
    side = np.minimum(across, 7.0 - across)
    stones = mix(
        (0.36, 0.355, 0.34),
        (0.50, 0.49, 0.47),
        0.5 * grain("street.stone", size) + 0.5 * clouds("street.set", 56, 32, size),
    )
    stones[:, ((along * 4.0) % 1.0 < 0.10) | (np.abs(side - 0.16) < 0.012)] *= 0.66
    image = np.where((side < 0.32), stones, image)
    grime = step(0.55, 0.0, side - 0.12 * clouds("street.grime", 30, 8, size))
    return over(image, (0.235, 0.215, 0.18), 0.5 * grime * (0.35 + clouds("street.silt", 60, 60, size)))


def _paving() -> Image:
    """Return 4.8 m of pavement, 8 x 8 slabs, each with a tone of its own; some cracked, with moss in the joints."""
    size = _MEDIUM
    u, v = grid(size)
    tone = uniform("paving.slab", 64).reshape(8, 8).repeat(64, 0).repeat(64, 1)
    t = 0.42 * tone + 0.33 * grain("paving", size) + 0.25 * clouds("paving.mid", 40, 40, size)
    image = mix((0.43, 0.42, 0.40), (0.625, 0.61, 0.58), t)
    image *= 1.0 - 0.20 * step(0.5, 0.8, clouds("paving.stain", 6, 6, size))
    image *= 1.0 - 0.35 * cracks("paving.crack", 4, size, 0.007) * (tone > 0.78)
    gum = clouds("paving.gum", 100, 100, size)
    image = over(image, (0.27, 0.265, 0.26), 0.8 * step(0.93, 0.96, gum))
    x, y = (u * 8) % 1.0, (v * 8) % 1.0
    edge = np.minimum(np.minimum(x, 1.0 - x), np.minimum(y, 1.0 - y))
    image *= 0.90 + 0.10 * step(0.0, 0.10, edge)
    joint = step(0.028, 0.014, edge)
    image = over(image, (0.22, 0.21, 0.19), 0.85 * joint)
    return over(image, (0.22, 0.25, 0.14), 0.8 * joint * step(0.5, 0.7, clouds("paving.moss", 7, 7, size)))


def _kerb() -> Image:
    """Return 8 kerb stones of 1 m along u, with dark joints, scuffed."""
    size = (64, 1024)
    u, v = grid(size)
    stone = uniform("kerb.tone", 8).repeat(128)[None, :].repeat(64, 0)
    t = 0.4 * stone + 0.35 * grain("kerb", (256, 1024))[:64] + 0.25 * clouds("kerb.mid", 90, 6, size)
    image = mix((0.45, 0.445, 0.43), (0.64, 0.63, 0.605), t)
    image = over(image, (0.22, 0.21, 0.20), 0.7 * step(0.6, 0.9, clouds("kerb.scuff", 40, 3, size)) * step(0.5, 0.8, v))
    image[:, :, (u[0] * 8) % 1.0 < 0.014] *= 0.45
    return image


def _road_paint() -> Image:
    """Return 2 m of old road paint: white, rubbed off down to the asphalt in cracks and spots."""
    wear = 0.45 * clouds("paint", 6) + 0.35 * clouds("paint.fine", 40) + 0.2 * grain("paint")
    image = mix((0.74, 0.735, 0.71), (0.87, 0.865, 0.845), 1.4 * clouds("paint.tone", 9) - 0.2)
    gone = np.maximum(step(0.60, 0.70, wear), 0.9 * cracks("paint.crack", 4, (256, 256), 0.02))
    return over(image, (0.31, 0.31, 0.31), 0.85 * gone)


def _manhole() -> Image:
    """Return a cast iron cover within its square: rim, ring of concrete, studs."""
    size = (128, 128)
    u, v = grid(size)
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    r2 = x * x + y * y
    image = mix((0.16, 0.155, 0.15), (0.27, 0.26, 0.25), 0.6 * grain("cover", size) + 0.4 * clouds("cover", 6, 6, size))
    stud = (((u * 12) % 1.0 - 0.5) ** 2 + ((v * 12) % 1.0 - 0.5) ** 2) < 0.07
    image[:, stud & (r2 < 0.5)] *= 1.45
    image[:, np.abs(r2 - 0.62) < 0.035] *= 0.45
    image[:, r2 > 0.80] = mix((0.38, 0.375, 0.36), (0.50, 0.49, 0.475), grain("ring", size))[:, r2 > 0.80]
    return image


def _worn_spot() -> Image:
    """Return two spots of worn grass with holes round them: left trodden to the soil, right only dry."""
    size = (512, 1024)
    u, v = grid(size)
    x, y = 4.0 * ((u * 2.0) % 1.0) - 2.0, 4.0 * v - 2.0
    fine = clouds("spot.fine", 170, 90, size)
    r = (
        np.sqrt(x * x + y * y)
        + 1.1 * (clouds("spot", 16, 8, size) - 0.5)
        + 0.7 * (clouds("spot.mid", 60, 30, size) - 0.5)
    )
    r = r + 0.5 * (fine - 0.5)
    dry = mix((0.33, 0.345, 0.185), (0.53, 0.505, 0.33), 0.5 * fine + 0.5 * grain("grass", size))
    soil = mix((0.30, 0.255, 0.195), (0.47, 0.40, 0.305), 0.5 * fine + 0.5 * grain("spot", size))
    image = np.where((u < 0.5) & (r < 0.95), soil, dry)
    edge = np.where(u < 0.5, 1.55, 1.30)
    return np.concatenate([image, (r < edge).astype(np.float32)[None]])


MAKERS: dict[str, Callable[[], Image]] = {
    "grass": _grass,
    "worn_spot": _worn_spot,
    "earth": _dry_ground,
    "gravel": _gravel,
    "asphalt": _asphalt,
    "clean_asphalt": lambda: _asphalt_grain("asphalt", _MEDIUM, 3),  # without marks that repeat, for wide areas
    "street": _street,
    "paving": _paving,
    "kerb": _kerb,
    "road_paint": _road_paint,
    "manhole": _manhole,
}
