"""Decoding of the networks' outputs, against closed forms."""

from __future__ import annotations

import numpy as np

from lab.realism import networks


def test_anchors_of_the_ssd() -> None:
    anchors = networks.ssd_anchors()
    assert len(anchors) == 19 * 19 * 3 + 6 * (100 + 25 + 9 + 4 + 1)
    np.testing.assert_allclose(anchors[0], [0.5 / 19, 0.5 / 19, 0.1, 0.1])
    np.testing.assert_allclose(anchors[-6], [0.5, 0.5, 0.95, 0.95])


def test_overlapping_boxes_are_reduced_to_the_best() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [1.0, 0.0, 11.0, 10.0], [30.0, 0.0, 40.0, 10.0]])
    assert networks.suppressed(boxes, np.array([0.5, 0.9, 0.1]), 0.45, None) == [1, 2]
    assert networks.suppressed(boxes, np.array([0.5, 0.9, 0.1]), 0.85, None) == [1, 0, 2]
