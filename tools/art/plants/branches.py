"""Branches of a bough as tubes."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh
from sim.scene.maps.plants.bark import tube
from tools.art.plants.growth import Skeleton


def branches(skeleton: Skeleton, *, least_radius: float) -> Mesh:
    """Return the branches of at least this radius, as tubes of 3 to 6 sides; each continues its thickest child."""
    children: list[list[int]] = [[] for _ in skeleton.nodes]
    for node, above in enumerate(skeleton.parent):
        if above >= 0 and skeleton.radius[node] >= least_radius:
            children[above].append(node)
    mesh = Mesh.empty()
    starts = [(0, -1)]  # first node of a tube, and the node that it grows from
    while starts:
        node, base = starts.pop()
        chain = [base] if base >= 0 else []
        radii = [0.9 * skeleton.radius[node]] if base >= 0 else []
        while True:
            chain.append(node)
            radii.append(skeleton.radius[node])
            if not children[node]:
                break
            thickest = max(children[node], key=lambda child: (skeleton.radius[child], -child))
            starts += [(child, node) for child in children[node] if child != thickest]
            node = thickest
        if len(chain) > 1:
            sides = 6 if radii[0] > 4.0 * least_radius else 4 if radii[0] > 1.8 * least_radius else 3
            points = [skeleton.nodes[k] for k in chain]
            tube(mesh, points, radii, sides)
    return mesh
