"""Heights of the ground from a GeoTIFF: geographic coordinates (EPSG:4326, 4258, 4979), or UTM (326xx, 327xx, 258xx).

Format: OGC GeoTIFF 1.1 (19-008r4). UTM by Krueger's series to the third order, exact to 0.1 mm within a zone (Karney,
Journal of Geodesy 85, 2011). Heights are relative to that at the take-off place.
"""

from __future__ import annotations

import contextlib
import math
import struct
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from signals.documents.document import shown_path
from signals.errors import ConfigError
from signals.geodesy import E2, FLATTENING, SEMI_MAJOR_M, LocalFrame, Site
from signals.units import RAD_PER_DEG
from sim.scene.budget import Budget

Float64 = NDArray[np.float64]
MAX_BYTES = 300_000_000
_HEIGHT_BYTES = 30  # of a height while it is read
MAX_CELLS = 160  # of the terrain along a side
_LEAST_CELL_M = 2.0
_PIECES = ((273, 279), (324, 325))  # where strips and tiles begin, and their bytes
_PIXEL_SCALE, _TIE_POINT, _TRANSFORM, _KEYS, _NODATA = 33550, 33922, 34264, 34735, 42113
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}
_FORMATS = {3: "H", 4: "I", 8: "h", 9: "i", 11: "f", 12: "d"}


@dataclass(frozen=True)
class Terrain:
    """Heights [m] on a square grid in W, rows from the south; triangles as in `height_field_triangles`."""

    heights: Float64
    low: tuple[float, float]  # x, y of the first point
    cell_m: float

    def height(self, xy: Float64) -> Float64:
        """Return the height at points (n, 2); outside the grid that of its edge."""
        rows, columns = self.heights.shape
        at = (xy - np.array(self.low)) / self.cell_m
        at = np.clip(at, 0.0, (columns - 1.0, rows - 1.0))
        j, i = np.minimum(at[:, 0].astype(int), columns - 2), np.minimum(at[:, 1].astype(int), rows - 2)
        u, v = at[:, 0] - j, at[:, 1] - i
        h = self.heights
        corner, next_x, next_y, both = h[i, j], h[i, j + 1], h[i + 1, j], h[i + 1, j + 1]
        below = corner + u * (next_x - corner) + v * (both - next_x)
        above = corner + v * (next_y - corner) + u * (both - next_y)
        return np.where(u >= v, below, above)


@dataclass(frozen=True)
class GeoTiff:
    """Heights of a file: pixel (row, column) of a place is `to_pixel` applied to its coordinates in `epsg`."""

    source: str
    heights: Float64  # NaN: unknown
    epsg: int
    origin: tuple[float, float]  # of the centre of the first pixel
    step: tuple[float, float]  # per column and per row

    def at(self, latitude_deg: Float64, longitude_deg: Float64) -> Float64:
        """Return the heights at places, bilinear; NaN outside."""
        if self.epsg in _GEOGRAPHIC:
            beyond = longitude_deg - (self.origin[0] + 0.5 * self.heights.shape[1] * self.step[0])
            x, y = longitude_deg - 360.0 * np.round(beyond / 360.0), latitude_deg  # also across the date line
        else:
            x, y = utm(latitude_deg, longitude_deg, self.epsg % 100, south=self.epsg // 100 == 327)
        column, row = (x - self.origin[0]) / self.step[0], (y - self.origin[1]) / self.step[1]
        rows, columns = self.heights.shape
        inside = (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)
        column, row = np.clip(column, 0.0, columns - 1.0), np.clip(row, 0.0, rows - 1.0)
        j, i = np.minimum(column.astype(int), max(columns - 2, 0)), np.minimum(row.astype(int), max(rows - 2, 0))
        j1, i1 = np.minimum(j + 1, columns - 1), np.minimum(i + 1, rows - 1)
        u, v = column - j, row - i
        h = self.heights
        z = (h[i, j] * (1 - u) + h[i, j1] * u) * (1 - v) + (h[i1, j] * (1 - u) + h[i1, j1] * u) * v
        return np.where(inside, z, np.nan)

    def middle(self) -> tuple[float, float, float]:
        """Return latitude, longitude and height of the known height nearest to the middle. Raises ConfigError."""
        rows, columns = self.heights.shape
        known = np.argwhere(np.isfinite(self.heights))
        if not len(known):
            raise ConfigError.at(self.source, "holds no known height", "cut it out where it has heights")
        row, column = known[np.abs(known - (0.5 * (rows - 1), 0.5 * (columns - 1))).sum(axis=1).argmin()].tolist()
        x, y = self.origin[0] + column * self.step[0], self.origin[1] + row * self.step[1]
        latitude_deg, longitude_deg = (y, x) if self.epsg in _GEOGRAPHIC else self._geodetic(x, y)
        longitude_deg -= 360.0 if longitude_deg > 180.0 else 0.0
        return round(latitude_deg, 7), round(longitude_deg, 7), round(float(self.heights[row, column]), 2)

    def _geodetic(self, x: float, y: float) -> tuple[float, float]:
        """Return latitude and longitude of a UTM place, by steps along the meridian and the parallel."""
        zone, south = self.epsg % 100, self.epsg // 100 == 327
        latitude_deg, longitude_deg = (y - (1e7 if south else 0.0)) / 111_000.0, 6.0 * zone - 183.0
        for _ in range(20):
            at_x, at_y = (
                float(v[0]) for v in utm(np.array([latitude_deg]), np.array([longitude_deg]), zone, south=south)
            )
            latitude_deg += (y - at_y) / 111_000.0
            longitude_deg += (x - at_x) / (111_320.0 * math.cos(math.radians(latitude_deg)))
        return latitude_deg, longitude_deg


_GEOGRAPHIC = (4326, 4258, 4979, 4269)


def read_geotiff(path: Path, budget: Budget | None = None) -> GeoTiff:
    """Read a GeoTIFF. Raises ConfigError."""
    source = shown_path(path)

    def wrong(message: str, hint: str = "") -> ConfigError:
        return ConfigError.at(source, message, hint)

    try:
        if path.stat().st_size > MAX_BYTES:
            raise wrong(f"is longer than the {MAX_BYTES / 1e6:g} MB that are read", "cut out the district")
        data = path.read_bytes()
    except OSError as error:
        raise wrong(f"cannot be read: {error.strerror or error}") from None
    try:
        tags = _tags(data)
    except (struct.error, KeyError, ValueError, IndexError):
        raise wrong(
            "is not a TIFF file, or it is cut off", "a BigTIFF is not read: gdal_translate -co BIGTIFF=NO"
        ) from None
    width, height = (_whole(tags.get(key)) for key in (256, 257))
    if width <= 0 or height <= 0:
        raise wrong(f"has {width} x {height} heights")
    end = _end_of_heights(tags)
    if end > len(data):
        raise wrong(f"is cut off: its heights reach to byte {end}, and it has {len(data)}", "copy or write it again")
    budget = budget or Budget(source)
    budget.pixels(width * height, f"{source}, {width} x {height} heights")
    budget.memory(_HEIGHT_BYTES * width * height, f"{source}, {width} x {height} heights")
    scale, tie = _numbers(tags.get(_PIXEL_SCALE)), _numbers(tags.get(_TIE_POINT))
    if _TRANSFORM in tags or len(scale) < 2 or len(tie) < 6:
        raise wrong("has no place on Earth, or one that is turned", "gdalwarp -t_srs EPSG:4326 IN.tif OUT.tif")
    numbers = np.array([*scale[:2], *tie[:6]], float)
    if not np.isfinite(numbers).all() or not (numbers[:2] > 0.0).all():
        raise wrong(f"has a damaged place on Earth: scale {scale[:2]}, tie point {tie[:6]}", "write the file again")
    epsg, pixel_is_point = _system(_numbers(tags.get(_KEYS)))
    if epsg not in _GEOGRAPHIC and epsg // 100 not in (326, 327, 258):
        message = f"is in EPSG:{epsg}, which is not read" if epsg else "does not state its coordinate system"
        raise wrong(message, "gdalwarp -t_srs EPSG:4326 IN.tif OUT.tif")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.ndim != 2:
        raise wrong(
            "holds no single band of heights", "gdal_translate -b 1 -ot Float32 -co COMPRESS=DEFLATE IN.tif OUT.tif"
        )
    heights = image.astype(np.float64)
    nodata = tags.get(_NODATA)
    heights[~np.isfinite(heights) | (heights < -12_000.0) | (heights > 9_000.0)] = np.nan
    if isinstance(nodata, str):
        with contextlib.suppress(ValueError):
            heights[np.isclose(heights, float(nodata))] = np.nan
    shift = 0.0 if pixel_is_point else 0.5
    origin = (tie[3] + (shift - tie[0]) * scale[0], tie[4] - (shift - tie[1]) * scale[1])
    return GeoTiff(source, heights, epsg, origin, (scale[0], -scale[1]))


def _tags(data: bytes) -> dict:
    """Return the tags of the first image: numbers as tuples, text as str."""
    order = {b"II": "<", b"MM": ">"}[data[:2]]
    magic, at = struct.unpack_from(order + "HI", data, 2)
    if magic != 42:
        raise ValueError("not a classic TIFF")
    (count,) = struct.unpack_from(order + "H", data, at)
    tags: dict = {}
    for k in range(count):
        tag, kind, n = struct.unpack_from(order + "HHI", data, at + 2 + 12 * k)
        size = _SIZES.get(kind, 1) * n
        if size > 1_000_000:
            continue
        place = at + 2 + 12 * k + 8
        if size > 4:
            (place,) = struct.unpack_from(order + "I", data, place)
        raw = data[place : place + size]
        if kind == 2:
            tags[tag] = raw.rstrip(b"\0 ").decode("ascii", "replace")
        elif kind in _FORMATS:
            tags[tag] = struct.unpack(f"{order}{n}{_FORMATS[kind]}", raw)
    return tags


def _end_of_heights(tags: dict) -> int:
    """Return the number of bytes up to the end of the last strip or tile, as far as they are stated."""
    pieces = (zip(_numbers(tags.get(at)), _numbers(tags.get(size)), strict=False) for at, size in _PIECES)
    return max((begin + count for piece in pieces for begin, count in piece), default=0)


def _numbers(value: object) -> tuple:
    """Return the numbers of a tag; () for text and without the tag."""
    return value if isinstance(value, tuple) else ()


def _whole(value: object) -> int:
    return int(value[0]) if isinstance(value, tuple) and value and isinstance(value[0], int) else 0


def _system(keys: tuple[int, ...]) -> tuple[int, bool]:
    """Return the EPSG code, 0 if none is stated, and True if a pixel's value is that at its corner point."""
    found = {keys[i]: keys[i + 3] for i in range(4, len(keys) - 3, 4) if keys[i + 1] == 0}
    return int(found.get(3072, 0) or found.get(2048, 0)), found.get(1025) == 2


def utm(latitude_deg: Float64, longitude_deg: Float64, zone: int, *, south: bool) -> tuple[Float64, Float64]:
    """Return easting and northing [m] in a UTM zone."""
    n = FLATTENING / (2.0 - FLATTENING)
    n2, n3 = n * n, n * n * n
    a = 0.9996 * SEMI_MAJOR_M / (1.0 + n) * (1.0 + n2 / 4.0)
    phi = latitude_deg * RAD_PER_DEG
    lam = (longitude_deg - (6.0 * zone - 183.0)) * RAD_PER_DEG
    e = np.sqrt(E2)
    sin_phi = np.sin(phi)
    t = np.sinh(np.arctanh(sin_phi) - e * np.arctanh(e * sin_phi))
    xi, eta = np.arctan2(t, np.cos(lam)), np.arctanh(np.sin(lam) / np.sqrt(1.0 + t * t))
    alpha = (n / 2.0 - 2.0 * n2 / 3.0 + 5.0 * n3 / 16.0, 13.0 * n2 / 48.0 - 3.0 * n3 / 5.0, 61.0 * n3 / 240.0)
    east = eta + sum(c * np.cos(2 * k * xi) * np.sinh(2 * k * eta) for k, c in enumerate(alpha, 1))
    north = xi + sum(c * np.sin(2 * k * xi) * np.cosh(2 * k * eta) for k, c in enumerate(alpha, 1))
    return 500_000.0 + a * east, a * north + (10_000_000.0 if south else 0.0)


def make_terrain(tiff: GeoTiff, site: Site, half_m: float) -> Terrain:
    """Return the terrain round a site; its height at the site is 0. Raises ConfigError without heights there."""
    frame = LocalFrame(site)
    pixel_m = abs(tiff.step[1]) * (111_000.0 if tiff.epsg in _GEOGRAPHIC else 1.0)
    cell = max(_LEAST_CELL_M, min(pixel_m, half_m / 8.0), 2.0 * half_m / MAX_CELLS)
    cells = int(np.ceil(2.0 * half_m / cell))
    cells += cells % 2
    line = (np.arange(cells + 1) - cells // 2) * cell
    places = np.array([[frame.geodetic_from_enu((x, y, 0.0))[:2] for x in line.tolist()] for y in line.tolist()])
    z = tiff.at(places[:, :, 0].ravel(), places[:, :, 1].ravel()).reshape(cells + 1, cells + 1)
    middle = z[cells // 2, cells // 2]
    if not np.isfinite(middle):
        message = (
            f"has no height at the take-off place, latitude {site.latitude_deg:.6f}, longitude {site.longitude_deg:.6f}"
        )
        latitude_deg, longitude_deg, _ = tiff.middle()
        hint = f"its middle is at latitude_deg: {latitude_deg:.6f}, longitude_deg: {longitude_deg:.6f}"
        raise ConfigError.at(tiff.source, message, hint)
    z = np.round(_filled(z) - middle, 4)
    # The take-off place is level, so that the vehicle stands.
    near = np.abs(line) <= max(2.0, 0.75 * cell)
    z[np.ix_(near, near)] = 0.0
    return Terrain(z, (float(line[0]), float(line[0])), float(cell))


def _filled(z: Float64) -> Float64:
    """Return heights with the unknown ones (NaN) taken from the nearest known ones along rows and columns."""
    z = z.copy()
    while np.isnan(z).any():
        for into, source in ((z[1:], z[:-1]), (z[:-1], z[1:]), (z[:, 1:], z[:, :-1]), (z[:, :-1], z[:, 1:])):
            into[:] = np.where(np.isnan(into), source, into)
    return z
