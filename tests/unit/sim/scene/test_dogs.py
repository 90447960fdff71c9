"""Dogs: four legs in step on the ground, and ears that follow from the coat."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.objects.animals import add_dog
from sim.scene.maps.objects.dog_coat import COATS, EARS_UP
from sim.scene.random_generator import RandomGenerator
from tools.art.objects.dog import dog


def test_four_feet_stand_apart_on_the_ground() -> None:
    points = np.array(dog()["fur"].vertices)
    assert 0.0 <= points[:, 2].min() < 0.01
    soles = points[points[:, 2] < 0.02]
    feet = []
    for left in (True, False):
        x = np.sort(soles[(soles[:, 1] > 0.0) == left, 0])
        gap = int(np.argmax(np.diff(x)))
        assert x[gap + 1] - x[gap] > 0.15  # a front and a rear foot
        feet += [float(x[: gap + 1].mean()), float(x[gap + 1 :].mean())]
    rear_left, front_left, rear_right, front_right = feet
    # Seen from the side, no leg hides another: a dog with two legs was taken for a person.
    assert abs(front_left - front_right) > 0.10
    assert abs(rear_left - rear_right) > 0.10


def test_height_and_head() -> None:
    meshes = dog()
    points = np.array(meshes["fur"].vertices)
    withers = points[np.abs(points[:, 0] - 0.07) < 0.03][:, 2].max()
    assert withers == pytest.approx(0.6, abs=0.03)
    head = points[points[:, 0] > 0.30]
    assert head[:, 0].max() - 0.295 > 0.45 * withers  # occiput to nose
    up, down = (np.array(meshes[name].vertices)[:, 2] for name in ("ears_up", "ears_down"))
    assert up.max() > head[:, 2].max() + 0.05
    assert down.min() < head[:, 2].max() - 0.1


def test_ears_follow_from_the_coat() -> None:
    builder = MapBuilder("dogs")
    rng = RandomGenerator(1, "dogs")
    for k in range(24):
        add_dog(builder, rng, (2.0 * k, 0.0, 0.0), 0.0)
    mjcf = builder.build().mjcf
    seen = set()
    for body in re.findall(r'<body name="dog_\d+".*?</body>', mjcf, re.DOTALL):
        (coat,) = set(re.findall(r'material="fur_(\w+)"', body))
        seen.add(coat)
        assert ("dog_ears_up" in body) == (coat in EARS_UP)
        assert ("dog_ears_down" in body) != (coat in EARS_UP)
    assert seen == set(COATS)
