"""Branch skeletons by space colonisation.

Runions, Lane & Prusinkiewicz, Eurographics Workshop on Natural Phenomena 2007: targets attract the nearest node of the
tree; each attracted node grows a step towards the mean direction of its targets, bent downwards by `droop`. A target
that a node has come near is a tip. Radii follow from Leonardo's rule: the cross-section of a branch is the sum of those
of its continuations. Only + - * / and sqrt: the same bits everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from signals.rotation import unit
from signals.samples import Vec3

_MAX_STEPS = 60


@dataclass
class Skeleton:
    """Tree of nodes; node 0 is the root, and a parent stands before its children."""

    nodes: list[Vec3]
    parent: list[int]  # -1 of the root
    radius: list[float]
    tips: list[int]  # node of each target


def grow(root: Vec3, targets: Sequence[Vec3], *, step: float, tip_radius: float, droop: float = 0.0) -> Skeleton:
    """Return the skeleton that reaches all `targets` from `root`. `droop`: downward share of each step."""
    nodes: list[Vec3] = [root]
    parent = [-1]
    tips = [-1] * len(targets)
    goal = np.array(targets, np.float64)
    nearest = np.zeros(len(targets), np.int64)
    distance2 = _distance2(goal, root)
    near2 = (1.3 * step) * (1.3 * step)
    for _ in range(_MAX_STEPS):
        pulls: dict[int, list[int]] = {}
        for k, node in enumerate(nearest.tolist()):
            if tips[k] < 0:
                pulls.setdefault(node, []).append(k)
        if not pulls:
            break
        grown: list[int] = []
        for node, pulling in pulls.items():
            x, y, z = nodes[node]
            sx, sy, sz = 0.0, 0.0, -droop * len(pulling)
            for k in pulling:
                tx, ty, tz = targets[k]
                ux, uy, uz = unit((tx - x, ty - y, tz - z))
                sx, sy, sz = sx + ux, sy + uy, sz + uz
            dx, dy, dz = unit((sx, sy, sz))
            grown.append(len(nodes))
            nodes.append((x + step * dx, y + step * dy, z + step * dz))
            parent.append(node)
        for node in grown:
            d2 = _distance2(goal, nodes[node])
            closer = d2 < distance2
            nearest = np.where(closer, node, nearest)
            distance2 = np.where(closer, d2, distance2)
        for k, reached in enumerate((distance2 < near2).tolist()):
            if reached and tips[k] < 0:
                tips[k] = len(nodes)
                nodes.append(targets[k])
                parent.append(int(nearest[k]))
    for k in range(len(targets)):
        if tips[k] < 0:
            tips[k] = len(nodes)
            nodes.append(targets[k])
            parent.append(int(nearest[k]))
    return _without_dead_ends(nodes, parent, tips, tip_radius)


def _distance2(points: np.ndarray, node: Vec3) -> np.ndarray:
    x, y, z = points[:, 0] - node[0], points[:, 1] - node[1], points[:, 2] - node[2]
    return np.asarray(x * x + y * y + z * z)


def _without_dead_ends(nodes: list[Vec3], parent: list[int], tips: list[int], tip_radius: float) -> Skeleton:
    """Keep the nodes on the way to a tip, and give them radii."""
    section = [0.0] * len(nodes)
    for node in tips:
        section[node] = tip_radius * tip_radius
    for node in range(len(nodes) - 1, 0, -1):
        section[parent[node]] += section[node]
    number = {-1: -1}
    kept = Skeleton([], [], [], [])
    for node, area in enumerate(section):
        if area > 0.0:
            number[node] = len(kept.nodes)
            kept.nodes.append(nodes[node])
            kept.parent.append(number[parent[node]])
            kept.radius.append(sqrt(area))
    kept.tips = [number[node] for node in tips]
    return kept
