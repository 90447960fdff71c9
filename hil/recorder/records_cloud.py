"""Arrays of records as sensor_msgs/PointCloud2: every field of a record becomes one of the cloud's.

Foxglove and RViz draw a cloud by its fields x, y and z. So the coordinates of a position in a frame F, `x_F` or the
three of `p_F_m`, go by those names, and the three of a velocity `v_F_mps` by vx, vy, vz. The bytes stay those of the
array.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

# sensor_msgs/PointField datatypes
DATATYPES = {"|i1": 1, "|u1": 2, "<i2": 3, "<u2": 4, "<i4": 5, "<u4": 6, "<f4": 7, "<f8": 8}
_VECTORS = {"p": ("x", "y", "z"), "v": ("vx", "vy", "vz")}


class CloudField(NamedTuple):
    """One field of a cloud."""

    name: str
    offset: int
    datatype: int


def cloud_fields(dtype: np.dtype[Any]) -> list[CloudField]:
    """The fields of a cloud of such records."""
    fields = []
    for name, kind, offset in _scalars(dtype):
        little = kind.newbyteorder("<").str
        fields.append(CloudField(name, offset, DATATYPES[little]))
    return fields


def _scalars(dtype: np.dtype[Any]) -> Iterator[tuple[str, np.dtype[Any], int]]:
    for name in dtype.names or ():
        kind, offset = dtype.fields[name][:2]  # type: ignore[index]
        vector = re.fullmatch(r"([pv])_[A-Z](_m|_mps)?", name)
        if kind.shape == (3,) and vector:
            names: tuple[str, ...] = _VECTORS[vector[1]]
        elif kind.shape:
            names = tuple(f"{name}_{i}" for i in range(int(np.prod(kind.shape))))
        else:
            names = (re.sub(r"^([xyz])_[A-Z]$", r"\1", name),)
        for i, part in enumerate(names):
            yield part, kind.base, offset + i * kind.base.itemsize
