"""Pictures of a data set, read back bit for bit by other libraries."""

from __future__ import annotations

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from hil.apps.dataset.formats.pictures import (
    FARTHER,
    NOTHING,
    DepthScale,
    PictureEncoder,
    normal_values,
)
from hil.apps.dataset.formats.png import encode_png
from signals.errors import RecordingError

SIDES = st.integers(1, 40)


def read(data: bytes) -> NDArray[np.generic]:
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture[:, :, ::-1] if picture.ndim == 3 else picture


@st.composite
def pictures(draw: st.DrawFn) -> NDArray[np.generic]:
    """Generate pictures of few values, which compress well, or of any values."""
    height, width = draw(SIDES), draw(SIDES)
    shape = (height, width, 3) if draw(st.booleans()) else (height, width)
    dtype = np.uint8 if len(shape) == 3 else draw(st.sampled_from([np.uint8, np.uint16]))
    most = draw(st.sampled_from([0, 1, 3, np.iinfo(dtype).max]))
    return draw(arrays(dtype, shape, elements=st.integers(0, int(most))))


@settings(max_examples=150)
@given(picture=pictures(), sub=st.booleans())
def test_png_reads_back_bit_for_bit(picture: NDArray[np.uint8], sub: bool) -> None:
    data = encode_png(picture, sub=sub)
    assert np.array_equal(read(data), picture)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(data))), picture)


def test_png_holds_nothing_but_the_picture() -> None:
    data = encode_png(np.arange(12, dtype=np.uint8).reshape(3, 4))
    at, names = 8, []
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        body = data[at + 4 : at + 8 + length]
        names.append(body[:4])
        assert zlib.crc32(body) == struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0]
        at += 12 + length
    assert names == [b"IHDR", b"IDAT", b"IEND"]


@given(st.lists(st.floats(0.0, 65.5, width=32), min_size=1, max_size=50))
def test_depth_comes_back_to_half_a_millimetre(depths: list[float]) -> None:
    depth = np.array([depths], np.float32)
    scale = DepthScale()
    values = read(PictureEncoder(scale).depth_png(depth))
    near = depth < 0.0005
    assert np.all(values[near] == 1)  # something, however close
    error = np.abs(values * scale.step_m - depth.astype(np.float64))
    assert np.all(error[~near & (values != FARTHER)] <= 0.0005 + 1e-12)


def test_depth_marks_nothing_and_farther() -> None:
    depth = np.array([[np.inf, np.nan, 65.534, 65.54, 1e6, 0.0, -np.inf]], np.float32)
    assert DepthScale().values(depth).tolist() == [[NOTHING, NOTHING, 65534, FARTHER, FARTHER, 1, NOTHING]]
    assert DepthScale(1 / 256).values(np.array([[200.0]], np.float32)).tolist() == [[51200]]


def test_normals_come_back_and_nothing_stays_nothing() -> None:
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(40, 50, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    normal[:3] = 0.0
    normal[3, 0] = (-1.0, 0.0, 0.0)
    picture = normal.astype(np.float32)
    values = read(PictureEncoder().normal_png(picture)).astype(np.uint8)
    assert np.all(values[:3] == 0)
    assert values[3, 0].tolist() == [1, 128, 128]
    assert np.array_equal(values, normal_values(picture))
    back = np.where((values == 0).all(axis=2, keepdims=True), 0.0, (values.astype(float) - 128.0) / 127.0)
    assert np.abs(back - picture).max() <= 0.5 / 127 + 1e-6


def test_class_picture_with_palette_reads_as_ids_and_colours() -> None:
    ids = np.arange(12, dtype=np.uint8).reshape(3, 4) % 5
    palette = np.array([[0, 0, 0], [1, 2, 3], [4, 5, 6], [7, 8, 9], [255, 254, 253]], np.uint8)
    image = Image.open(io.BytesIO(PictureEncoder(palette=palette).indexed_png(ids)))
    assert image.mode == "P"
    assert np.array_equal(np.asarray(image), ids)
    assert np.array_equal(np.asarray(image.convert("RGB")), palette[ids])
    with pytest.raises(RecordingError, match="1 to 256 colours"):
        PictureEncoder(palette=palette[:0]).indexed_png(ids)
    with pytest.raises(RecordingError, match="palette has 2 colours"):
        PictureEncoder(palette=palette[:2]).indexed_png(ids)
    with pytest.raises(RecordingError, match="no palette"):
        PictureEncoder().indexed_png(ids)


@pytest.mark.parametrize(
    ("picture", "what"),
    [
        (np.zeros((0, 4, 3), np.uint8), "empty"),
        (np.zeros((4, 4), np.uint8), "must be uint8"),
        (np.zeros((4, 4, 3), np.float32), "must be uint8"),
        (np.zeros((4, 8, 3), np.uint8)[:, ::2], "copy it first"),
    ],
)
def test_invalid_pictures_are_refused(picture: NDArray[np.uint8], what: str) -> None:
    with pytest.raises(RecordingError, match=what):
        PictureEncoder().rgb_png(picture)


@pytest.mark.parametrize(
    ("picture", "what"),
    [
        (np.zeros((0, 4), np.uint8), "empty"),
        (np.zeros((4, 4), np.float32), "uint8 or uint16, not float32"),
        (np.zeros((4, 4, 2), np.uint8), "or .height, width, 3."),
    ],
)
def test_types_that_png_lacks_are_refused(picture: NDArray[np.uint8], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        encode_png(picture)


def test_refuses_an_impossible_depth_step() -> None:
    with pytest.raises(RecordingError, match="step"):
        DepthScale(0.0)
