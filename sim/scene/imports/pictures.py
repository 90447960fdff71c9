"""Decode a picture of an imported file: its size is read from its head and charged before anything is decoded."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.scene.budget import Budget

_SAMPLE_BYTES = 8  # of a pixel while it is decoded: four channels of 16 bits


def picture_size(data: bytes | memoryview) -> tuple[int, int] | None:
    """Return width and height as a PNG, JPEG or WebP file states them; None for any other file, or a part of one."""
    head = bytes(data[:32])
    if head[:8] == b"\x89PNG\r\n\x1a\n":
        return _png_size(memoryview(data))
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP" and len(head) >= 30:
        return _webp_size(head)
    if head[:2] == b"\xff\xd8":
        return _jpeg_size(memoryview(data))
    return None


def _png_size(data: memoryview) -> tuple[int, int] | None:
    """Return the size of a PNG whose chunks lie within the file: OpenCV allocates what a chunk's head asks for."""
    size, at = None, 8
    while at + 12 <= len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if at + 12 + length > len(data) or (kind == b"IHDR") != (at == 8):
            return None
        if kind == b"IHDR":
            width, height = struct.unpack(">II", data[16:24])
            size = (width, height)
        if kind == b"IEND":
            return size
        at += 12 + length
    return None


def _webp_size(head: bytes) -> tuple[int, int] | None:
    kind = head[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(head[24:27], "little"), 1 + int.from_bytes(head[27:30], "little")
    if kind == b"VP8L":
        bits = int.from_bytes(head[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack("<HH", head[26:30])
        return width & 0x3FFF, height & 0x3FFF
    return None


def _jpeg_size(data: memoryview) -> tuple[int, int] | None:
    at = 2
    while at + 9 < len(data) and data[at] == 0xFF:
        kind, length = data[at + 1], struct.unpack(">H", data[at + 2 : at + 4])[0]
        if kind == 0xFF:  # fill
            at += 1
            continue
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + max(length, 2)
    return None


def decoded_picture(data: bytes | memoryview, budget: Budget, part: str) -> NDArray | None:
    """Return a PNG, JPEG or WebP file as OpenCV decodes it, blue first; None if it cannot be decoded.

    Raises ConfigError if it is too large for `budget`.
    """
    size = picture_size(data)
    if size is None:
        return None
    count = size[0] * size[1]
    budget.pixels(count, part)
    budget.at_once(_SAMPLE_BYTES * count, f"{part}, a picture of {size[0]} x {size[1]} pixels")
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError from None
        return None
