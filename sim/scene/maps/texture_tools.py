"""Tools of the procedural textures: noise on a torus, mixing, PNG. Pixels are 32-bit floats; a picture is (3, H, W)."""

from __future__ import annotations

import struct
import zlib
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from signals.noise import NoiseStream

SIDE_PX = 256
Image = NDArray[np.floating[Any]]
Size = tuple[int, int]  # rows, columns
Rgb = tuple[float, float, float]


@cache
def uniform(name: str, count: int) -> Image:
    """Return `count` values on (0, 1) of the stream `name`; not to be changed."""
    stream = NoiseStream(0, f"texture.{name}")
    blocks = [stream.uniform_block(b)[:, 0] for b in range(-(-count // 256))]
    return np.concatenate(blocks)[:count].astype(np.float32)


def _lattice(name: str, size: Size) -> Image:
    """Return values on (0, 1): a piece of one sheet of noise, large pieces with repeats, placed by the name."""
    sheet = uniform("sheet", SIDE_PX * SIDE_PX).reshape(SIDE_PX, SIDE_PX)
    down, across = (int(value * SIDE_PX) for value in uniform(name, 2))
    rows, columns = (np.arange(size[0]) + down) % SIDE_PX, (np.arange(size[1]) + across) % SIDE_PX
    lattice: Image = sheet[rows[:, None], columns]
    return lattice


def clouds(name: str, cells_x: int, cells_y: int | None = None, size: Size = (SIDE_PX, SIDE_PX)) -> Image:
    """Return smooth noise on (0, 1): random values on a torus of cells, blended by cubic B-splines.

    Cells of a few pixels are blended by the smoothstep 3u^2 - 2u^3 instead. `size`: rows and columns.
    """
    cells_y = cells_y or cells_x
    lattice = _lattice(f"{name}.{cells_x}.{cells_y}", (cells_y, cells_x))
    if cells_x * 10 > size[1] or cells_y * 10 > size[0]:
        return blended(lattice, size)
    # Splines keep some 60 % of the deviation of the lattice.
    result = _spline(np.ascontiguousarray(_spline(np.ascontiguousarray(lattice.T), size[1]).T), size[0])
    result -= 0.5
    result *= 1.65
    result += 0.5
    return np.clip(result, 0.0, 1.0, out=result)


def _spline(lattice: Image, pixels: int) -> Image:
    """Return the torus of cells enlarged along its first axis by uniform cubic B-splines."""
    cells, across = lattice.shape
    position = np.arange(pixels) * (cells / pixels)
    low = position.astype(np.int64)
    u = (position - low).astype(np.float32)[:, None]
    w = 1.0 - u
    pieces = (w * w * w, 4.0 - 3.0 * u * u * (1.0 + w), 4.0 - 3.0 * w * w * (1.0 + u), u * u * u)
    weights = [piece / 6.0 for piece in pieces]
    first = np.searchsorted(low, np.arange(cells + 1))  # pixel of each cell
    total = np.empty((pixels, across), np.float32)
    terms = np.empty((int(np.diff(first).max()), across), np.float32)
    for cell in range(cells):
        part = slice(first[cell], first[cell + 1])
        here, term = total[part], terms[: first[cell + 1] - first[cell]]
        np.multiply(lattice[cell - 1], weights[0][part], out=here)
        for k in range(3):
            here += np.multiply(lattice[(cell + k) % cells], weights[k + 1][part], out=term)
    result: Image = total
    return result


def blended(lattice: Image, size: Size) -> Image:
    """Return the values of a torus of cells, enlarged to `size`."""

    def weights(cells: int, pixels: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Image]:
        position = np.arange(pixels) * (cells / pixels)
        low = position.astype(np.int64)
        u = (position - low).astype(np.float32)
        return low, (low + 1) % cells, u * u * (3.0 - 2.0 * u)

    y0, y1, v = weights(lattice.shape[0], size[0])
    x0, x1, u = weights(lattice.shape[1], size[1])
    columns = lattice[:, x0]
    columns += u * (lattice[:, x1] - columns)
    result: Image = columns[y0]
    step_up = columns[y1]
    step_up -= result
    step_up *= v[:, None]
    result += step_up
    return result


@cache
def grain(name: str, size: Size = (SIDE_PX, SIDE_PX)) -> Image:
    """Return white noise on (0, 1). Beyond 256 x 256 the same values repeat, shifted from tile to tile."""
    tile = _lattice(f"{name}.grain", (SIDE_PX, SIDE_PX))
    rows, columns = size[0] // SIDE_PX, size[1] // SIDE_PX
    if rows * columns <= 1:
        return tile[: size[0], : size[1]]
    tiles = [[np.roll(tile, (97 * i + 31 * j, 61 * j + 17 * i), (0, 1)) for j in range(columns)] for i in range(rows)]
    return np.block(tiles)


def _rgb(rgb: Rgb) -> Image:
    return np.array(rgb, np.float32)[:, None, None]


def mix(a: Rgb, b: Rgb, t: Image) -> Image:
    """Return a picture: a where t = 0 and b where t = 1."""
    image: Image = np.clip(t, 0.0, 1.0) * (_rgb(b) - _rgb(a))
    image += _rgb(a)
    return image


def encoded_png(image: NDArray[np.uint8]) -> bytes:
    """Return an image (H, W, 3 or 4), blue first, as PNG, compressed."""
    return bytes(cv2.imencode(".png", np.ascontiguousarray(image))[1].tobytes())


def png_of(image: Image) -> bytes:
    """Return a picture as PNG, not compressed; a fourth channel is its alpha."""
    pixels = np.empty((*image.shape[1:], len(image)), np.uint8)
    for i, channel in enumerate(image):
        scaled = channel * np.float32(255.0)
        scaled += np.float32(0.5)
        pixels[..., i] = np.clip(scaled, 0.0, 255.0, out=scaled).astype(np.uint8)
    return png(pixels, level=0)  # compression would take longer than everything else


def png(pixels: NDArray[np.uint8], *, level: int) -> bytes:
    """Return pixels (H, W, 3 or 4), red first, as PNG without filters, compressed at a level of zlib's."""
    height, width, channels = pixels.shape
    rows = np.zeros((height, 1 + width * channels), np.uint8)  # each begins with the number of its filter, 0: none
    rows[:, 1:] = pixels.reshape(height, -1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))

    header = struct.pack(">IIBBBBB", width, height, 8, 6 if channels == 4 else 2, 0, 0, 0)
    body = zlib.compress(rows.data, level)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def grid(size: Size = (SIDE_PX, SIDE_PX)) -> tuple[Image, Image]:
    """Return u, to the right, and v, downwards, on [0, 1), as one row and one column."""
    across = ((np.arange(size[1]) + 0.5) / size[1]).astype(np.float32)
    down = ((np.arange(size[0]) + 0.5) / size[0]).astype(np.float32)
    return across[None, :], down[:, None]
