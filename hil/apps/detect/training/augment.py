"""Augmentation of training pictures: mirroring, zoom, shift, lighting, noise, blur and mosaics of four.

A few examples show nothing, in one colour or in two that run into each other: recorded pictures always show something,
and a network that has seen only those takes a plain picture for a wall close by.

Each picture has its own random stream, numbered by epoch and picture, so the result does not depend on the thread that
prepares it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.detect.picture_store import PictureStore, Rgb

_FILL = (114, 114, 114)
# Training also uses objects that are too small to count in an evaluation: that doubles the number of objects. An object
# recorded with fewer than MIN_RECORDED_PX shows no detail at any scale.
MIN_TRAINED_PX, MIN_RECORDED_PX = 40, 20
_MIN_SHARE_LEFT = 0.35  # share of a box that must remain in the picture; below it the object is difficult


@dataclass(frozen=True)
class Example:
    """One picture at the network's input size, (height, width, 3), and its n objects."""

    rgb: Rgb
    boxes_px: NDArray[np.float32]  # (n, 4) x0, y0, x1, y1
    classes: NDArray[np.int64]  # (n,)
    area_px: NDArray[np.float32]  # (n,) visible

    @property
    def difficult(self) -> NDArray[np.bool_]:
        """(n,) True for objects with too small a visible area at the scale of this example."""
        return np.asarray(self.area_px < MIN_TRAINED_PX, np.bool_)


@dataclass(frozen=True)
class Strength:
    """Ranges of the random changes, and shares of the pictures to which they apply."""

    zoom: tuple[float, float] = (0.85, 2.2)
    stretch: float = 0.12  # natural logarithm of the factor by which width grows and height shrinks
    mosaic_share: float = 0.1
    plain_share: float = 0.02  # of examples without objects, in place of the picture
    brightness: float = 0.25
    contrast: float = 0.25
    saturation: float = 0.3
    hue: float = 0.04  # of a full turn of the colour circle
    noise_share: float = 0.15
    blur_share: float = 0.1


class Augmenter:
    """Maker of training examples. Classes are numbered as in `classes`; objects of other classes are dropped."""

    def __init__(self, store: PictureStore, classes: tuple[str, ...], seed: int, strength: Strength | None) -> None:
        self._store = store
        self._number = {name: i for i, name in enumerate(classes)}
        self._seed = seed
        self._strength = strength

    def example(self, index: int, epoch: int) -> Example:
        """Return picture `index` with the augmentation of `epoch`, or as it was recorded if there is no strength."""
        plain = self.plain(index)
        s = self._strength
        if s is None:
            return plain
        rng = np.random.Generator(np.random.Philox(key=[self._seed, (epoch << 32) | index]))
        kind = rng.random()
        if kind >= 1.0 - s.plain_share:
            example = _nothing(plain.rgb.shape, rng)
        elif kind < s.mosaic_share:
            others = rng.integers(0, len(self._store), 3)
            example = _mosaic([plain, *(self.plain(int(i)) for i in others)], rng)
        else:
            example = _zoomed(plain, s, rng)
        return Example(_recoloured(example.rgb, s, rng), example.boxes_px, example.classes, example.area_px)

    def plain(self, index: int) -> Example:
        """Return picture `index` as it was recorded."""
        picture = self._store.pictures[index]
        numbers = np.array([self._number.get(name, -1) for name in picture.labels], np.int64)
        known = numbers >= 0
        boxes, areas = self._store.boxes_px(index)[known], self._store.area_px(index)[known]
        areas = np.where(areas < MIN_RECORDED_PX, 0.0, areas).astype(np.float32)
        return Example(self._store.rgb(index), boxes, numbers[known], areas)


def _zoomed(e: Example, s: Strength, rng: np.random.Generator) -> Example:
    """Return the example zoomed, stretched, shifted and, with probability 0.5, mirrored."""
    height, width = e.rgb.shape[:2]
    zoom = float(np.exp(rng.uniform(np.log(s.zoom[0]), np.log(s.zoom[1]))))
    stretch = float(np.exp(rng.uniform(-s.stretch, s.stretch)))
    zoom_x, zoom_y = zoom * stretch, zoom / stretch
    # On each axis, a smaller picture lies anywhere within the input area; a larger one anywhere that leaves no gap.
    shift_x = float(rng.uniform(min(0.0, width * (1 - zoom_x)), max(0.0, width * (1 - zoom_x))))
    shift_y = float(rng.uniform(min(0.0, height * (1 - zoom_y)), max(0.0, height * (1 - zoom_y))))
    mirrored = bool(rng.random() < 0.5)
    edge_matrix = np.array([[zoom_x, 0.0, shift_x], [0.0, zoom_y, shift_y]])
    if mirrored:
        edge_matrix = np.array([[-zoom_x, 0.0, width - shift_x], [0.0, zoom_y, shift_y]])
    # The matrix maps pixel edges, as boxes use them; OpenCV's pixel indices are centres, half a pixel from the edges.
    centre_matrix = edge_matrix.copy()
    centre_matrix[:, 2] += edge_matrix[:, 0] * 0.5 + edge_matrix[:, 1] * 0.5 - 0.5
    rgb = cv2.warpAffine(e.rgb, centre_matrix, (width, height), flags=cv2.INTER_LINEAR, borderValue=_FILL)
    boxes = e.boxes_px * np.array([zoom_x, zoom_y] * 2, np.float32) + np.array([shift_x, shift_y] * 2, np.float32)
    if mirrored:
        boxes = np.stack([width - boxes[:, 2], boxes[:, 1], width - boxes[:, 0], boxes[:, 3]], axis=1)
    clipped, area, remains = _clip(boxes, e.area_px * np.float32(zoom_x * zoom_y), (width, height))
    return Example(np.asarray(rgb, np.uint8), clipped[remains], e.classes[remains], area[remains])


def _mosaic(examples: list[Example], rng: np.random.Generator) -> Example:
    """Combine four pictures at 0.6 of their size, each cropped to a quarter of the output."""
    height, width = examples[0].rgb.shape[:2]
    rgb = np.empty_like(examples[0].rgb)
    boxes, classes, areas = [], [], []
    scale = 0.6
    w, h = round(width * scale), round(height * scale)
    for quarter, example in enumerate(examples):
        x0, y0 = (quarter % 2) * (width // 2), (quarter // 2) * (height // 2)
        crop_x, crop_y = int(rng.integers(0, w - width // 2 + 1)), int(rng.integers(0, h - height // 2 + 1))
        small = cv2.resize(example.rgb, (w, h), interpolation=cv2.INTER_AREA)
        rgb[y0 : y0 + height // 2, x0 : x0 + width // 2] = small[
            crop_y : crop_y + height // 2, crop_x : crop_x + width // 2
        ]
        scaled = example.boxes_px * np.float32(scale) + np.array([-crop_x, -crop_y] * 2, np.float32)
        clipped, area, remains = _clip(scaled, example.area_px * np.float32(scale * scale), (width // 2, height // 2))
        boxes.append(clipped[remains] + np.array([x0, y0] * 2, np.float32))
        areas.append(area[remains])
        classes.append(example.classes[remains])
    return Example(rgb, np.concatenate(boxes), np.concatenate(classes), np.concatenate(areas))


def _nothing(shape: tuple[int, ...], rng: np.random.Generator) -> Example:
    """Return an example without objects, in one colour or, in half of the cases, in two that run into each other."""
    height, width = shape[:2]
    grey, tint = rng.uniform(0.0, 255.0, (2, 1)), rng.normal(0.0, 12.0, (2, 3))
    first, last = grey + tint
    if rng.random() < 0.5:
        last = first
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = (
        np.cos(angle) * np.linspace(-0.5, 0.5, width)[None, :] + np.sin(angle) * np.linspace(-0.5, 0.5, height)[:, None]
    )
    share = ((along - along.min()) / np.ptp(along))[:, :, None]
    rgb = np.clip(np.rint(first + share * (last - first)), 0.0, 255.0).astype(np.uint8)
    none = np.zeros(0, np.float32)
    return Example(rgb, none.reshape(0, 4), np.zeros(0, np.int64), none)


def _clip(
    boxes: NDArray[np.float32], area_px: NDArray[np.float32], size: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Clip boxes to a picture of width and height `size`; return boxes, visible areas, and True for boxes that remain.

    The visible area is assumed to be spread evenly over the box. It becomes 0 (difficult) if most of it is clipped.
    """
    clipped = np.clip(boxes, 0.0, np.array([size[0], size[1]] * 2, np.float32)).astype(np.float32)
    area = (clipped[:, 2] - clipped[:, 0]) * (clipped[:, 3] - clipped[:, 1])
    share = area / np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1e-6)
    visible = np.where(share < _MIN_SHARE_LEFT, 0.0, area_px * share).astype(np.float32)
    return clipped, visible, np.asarray(area > 4.0, np.bool_)


def _recoloured(rgb: Rgb, s: Strength, rng: np.random.Generator) -> Rgb:
    brightness = 1.0 + rng.uniform(-s.brightness, s.brightness)
    contrast = 1.0 + rng.uniform(-s.contrast, s.contrast)
    saturation = 1.0 + rng.uniform(-s.saturation, s.saturation)
    angle = 2.0 * np.pi * rng.uniform(-s.hue, s.hue)
    # Saturation and hue are one matrix in the plane normal to grey; brightness and contrast scale and shift it.
    grey = np.full((3, 3), 1.0 / 3.0)
    cross = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]]) / np.sqrt(3.0)
    colour_matrix = grey + saturation * (np.cos(angle) * (np.eye(3) - grey) + np.sin(angle) * cross)
    matrix = brightness * contrast * colour_matrix
    shift = np.full((3, 1), 128.0 * brightness * (1.0 - contrast))
    out = cv2.transform(rgb, np.hstack([matrix, shift]))
    if rng.random() < s.noise_share:
        sigma = float(rng.uniform(1.0, 7.0))
        noise = rng.standard_normal(rgb.shape, np.float32) * np.float32(sigma)
        out = np.clip(out.astype(np.float32) + noise, 0.0, 255.0).astype(np.uint8)
    if rng.random() < s.blur_share:
        out = cv2.GaussianBlur(out, (3, 3), 0.0)
    return np.asarray(out, np.uint8)
