"""Triangles of round shapes: closed, outward, close to the shape and of its volume."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.frame.tessellation import Facets, box, capsule, cylinder, ellipsoid, plane, sphere

SHAPES = {
    "sphere": (sphere(0.12), 4.0 / 3.0 * math.pi * 0.12**3),
    "large sphere": (sphere(3.0), 4.0 / 3.0 * math.pi * 27.0),
    "ellipsoid": (ellipsoid((0.5, 1.5, 2.0)), 4.0 / 3.0 * math.pi * 1.5),
    "capsule": (capsule(0.1, 0.4), math.pi * 0.01 * 0.8 + 4.0 / 3.0 * math.pi * 1e-3),
    "cylinder": (cylinder(0.3, 1.0), math.pi * 0.09 * 2.0),
    "box": (box((0.5, 1.0, 2.0)), 8.0),
}


def volume(shape: Facets) -> float:
    a, b, c = (shape.corner[:, i] for i in range(3))
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("name", SHAPES)
def test_the_triangles_are_closed_and_face_outwards(name: str) -> None:
    shape, expected = SHAPES[name]
    assert volume(shape) == pytest.approx(expected, rel=3e-3)
    # The sum of the area vectors of a closed surface is zero.
    area = 0.5 * np.cross(shape.corner[:, 1] - shape.corner[:, 0], shape.corner[:, 2] - shape.corner[:, 0])
    assert np.abs(area.sum(axis=0)).max() < 1e-9 * max(1.0, np.abs(area).sum())
    assert (np.einsum("nki,ni->nk", shape.normal, area) > 0.0).all()
    assert np.abs(np.linalg.norm(shape.normal, axis=-1) - 1.0).max() < 1e-9


@pytest.mark.parametrize("segments", [12, 24])
def test_with_a_number_of_segments_the_vertices_lie_on_the_shape(segments: int) -> None:
    assert np.linalg.norm(sphere(2.0, segments).corner, axis=-1) == pytest.approx(2.0)
    assert np.linalg.norm(cylinder(0.3, 1.0, segments).corner[: 2 * segments, :, :2], axis=-1) == pytest.approx(0.3)
    shape = capsule(0.1, 0.4, segments)
    gap = shape.corner - np.clip(shape.corner, (0.0, 0.0, -0.4), (0.0, 0.0, 0.4))
    assert np.linalg.norm(gap, axis=-1) == pytest.approx(0.1)
    assert len(sphere(2.0, segments).corner) == segments * (segments - 2)


@pytest.mark.parametrize("radius_m", [0.02, 0.12, 1.0, 3.0])
def test_a_sphere_is_within_a_millimetre_of_its_triangles(radius_m: float) -> None:
    corner = sphere(radius_m).corner
    points = np.concatenate([corner.reshape(-1, 3), corner.mean(axis=1)])
    assert np.abs(np.linalg.norm(points, axis=1) - radius_m).max() < min(9e-4, 0.02 * radius_m)


def test_an_infinite_plane_reaches_the_horizon() -> None:
    assert np.abs(plane(0.0, 0.0).corner[..., :2]).min() >= 10_000.0
    assert np.ptp(plane(3.0, 2.0).corner.reshape(-1, 3), axis=0).tolist() == [6.0, 4.0, 0.0]
