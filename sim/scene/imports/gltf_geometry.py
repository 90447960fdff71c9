"""Triangles and placements of the meshes of a glTF file.

glTF has y up and +z towards the viewer; W has z up. Vertices are turned by A: (x, y, z) -> (x, -z, y). A node's matrix
M becomes A M A^-1, split into a rotation and scales along the mesh's axes where these are at right angles; otherwise
it is applied to the vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.scene.imports.gltf_file import GltfFile
from sim.scene.imports.gltf_schema import Node, Primitive

Float64 = NDArray[np.float64]
_A = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_A4 = np.block([[_A, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
_MAX_DEPTH = 200
_MAX_ENTRY = 1e12  # of a matrix: products of two are far from overflow
_INSTANCE_BYTES = 2000  # of a place until it is an element of the map
_TRIANGLE_BYTES = 200  # of its corners and normals while its mesh is read


@dataclass(frozen=True)
class Surfaces:
    """Triangles of one primitive, as glTF has them: vertices (n, 3) and what belongs to each; triangles (m, 3)."""

    vertex: Float64
    triangle: NDArray[np.int64]
    normal: Float64 | None
    uv: tuple[Float64 | None, Float64 | None]
    colour: Float64 | None  # (n, 3), linear
    material: int | None


@dataclass(frozen=True)
class Placed:
    """A mesh at a place: p_W = position + R scales v, with v turned z up. Without right angles R is the identity."""

    name: str  # of the node; of the mesh, if the node has none
    mesh: int
    position: Float64  # (3,)
    R: Float64  # (3, 3)
    scales: Float64  # (3, 3), diagonal if the axes are at right angles


@dataclass
class Notes:
    """Counts of what was left out."""

    lines: int = 0  # primitives of points and lines
    flat: int = 0  # triangles without an area
    skinned: int = 0


def placed_meshes(file: GltfFile, scale: float, turn: Float64, notes: Notes) -> Iterator[Placed]:
    """Yield every mesh of the default scene at its place; `turn`: rotation about z, (3, 3)."""
    gltf = file.gltf
    base = np.eye(4)
    base[:3, :3] = scale * turn
    base = base @ _A4
    roots = _roots(file)
    pending = [(index, base, 0) for index in reversed(roots)]
    seen: set[int] = set()
    while pending:
        index, above, depth = pending.pop()
        if index >= len(gltf.nodes):
            raise file.error("", f"names nodes[{index}], which does not exist")
        if index in seen or depth > _MAX_DEPTH:
            raise file.error(f"nodes[{index}]", "is below itself, has two parents, or is nested too deeply")
        seen.add(index)
        node = gltf.nodes[index]
        M = above @ _matrix(node, file, f"nodes[{index}]")
        pending += [(child, M, depth + 1) for child in reversed(node.children)]
        if node.mesh is None:
            continue
        if node.mesh >= len(gltf.meshes):
            raise file.error(f"nodes[{index}]", f"names meshes[{node.mesh}], which does not exist")
        notes.skinned += node.skin is not None
        name = node.name or gltf.meshes[node.mesh].name or f"node_{index}"
        for own in _instances(file, node, f"nodes[{index}]"):
            yield _placed(name, node.mesh, M @ own, file, f"nodes[{index}]")


def _roots(file: GltfFile) -> list[int]:
    gltf = file.gltf
    if gltf.scenes:
        number = gltf.scene or 0
        if number >= len(gltf.scenes):
            raise file.error("", f"names scenes[{number}], which does not exist")
        return gltf.scenes[number].nodes
    children = {child for node in gltf.nodes for child in node.children}
    return [index for index in range(len(gltf.nodes)) if index not in children]


def _matrix(node: Node, file: GltfFile, part: str) -> Float64:
    """Return the matrix of a node; it is affine, and within what a map can hold."""
    M = _local(node)
    if not np.abs(M).max() <= _MAX_ENTRY or np.abs(M[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-6:
        raise file.error(part, "has a transform that is not a rotation, scale and translation", "export the file again")
    return M


def _local(node: Node) -> Float64:
    if node.matrix is not None:
        return np.array(node.matrix).reshape(4, 4).T
    return _transform(np.array(node.translation), np.array(node.rotation), np.array(node.scale))


def _transform(t: Float64, q: Float64, s: Float64) -> Float64:
    """Return T R S; `q` is x, y, z, w."""
    length = np.sqrt(q @ q)
    x, y, z, w = q / length if length > 0.0 else (0.0, 0.0, 0.0, 1.0)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = R * s, t
    return M


def _instances(file: GltfFile, node: Node, part: str) -> list[Float64]:
    """Return the matrices of EXT_mesh_gpu_instancing; one that changes nothing without it."""
    extension = node.extensions.get("EXT_mesh_gpu_instancing")
    if not isinstance(extension, dict):
        return [np.eye(4)]
    arrays = {}
    attributes = extension.get("attributes", {})
    for key, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)):
        index = attributes.get(key) if isinstance(attributes, dict) else None
        if isinstance(index, int) and index >= 0:
            arrays[key] = file.array(index, part).astype(np.float64)
            if arrays[key].shape[1] != width or not np.isfinite(arrays[key]).all():
                raise file.error(part, f"has instances whose {key} is wrong")
    count = min((len(array) for array in arrays.values()), default=0)
    file.budget.objects(count, part)
    file.budget.memory(_INSTANCE_BYTES * count, part)
    still, none, one = np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), np.ones((count, 3))
    rows = zip(arrays.get("TRANSLATION", still), arrays.get("ROTATION", none), arrays.get("SCALE", one), strict=False)
    return [_transform(*row) for row in rows]


def _placed(name: str, mesh: int, M: Float64, file: GltfFile, part: str) -> Placed:
    if not np.abs(M).max() <= _MAX_ENTRY:  # NaN is none
        raise file.error(part, "has a transform with numbers that are too large or none", "export the file again")
    linear = M[:3, :3] @ _A.T
    s = np.sqrt((linear * linear).sum(axis=0))
    R = linear / np.where(s > 0.0, s, 1.0)
    if np.linalg.det(R) < 0.0:
        R[:, 0], s[0] = -R[:, 0], -s[0]
    if not np.allclose(R.T @ R, np.eye(3), atol=1e-6):
        return Placed(name, mesh, M[:3, 3], np.eye(3), linear)
    return Placed(name, mesh, M[:3, 3], R, np.diag(s))


def surfaces_of(file: GltfFile, mesh: int, notes: Notes) -> list[Surfaces]:
    """Return the triangles of every primitive of a mesh."""
    found = []
    for number, primitive in enumerate(file.gltf.meshes[mesh].primitives):
        part = f"meshes[{mesh}].primitives[{number}]"
        if primitive.mode < 4 or "POSITION" not in primitive.attributes:
            notes.lines += 1
            continue
        if "KHR_draco_mesh_compression" in primitive.extensions:
            index = primitive.attributes["POSITION"]
            if index >= len(file.gltf.accessors) or file.gltf.accessors[index].bufferView is None:
                raise file.error(
                    part, "needs KHR_draco_mesh_compression, which is not read", "export without compression"
                )
        found.append(_surfaces(file, primitive, part, notes))
    return [surfaces for surfaces in found if len(surfaces.triangle)]


def _surfaces(file: GltfFile, primitive: Primitive, part: str, notes: Notes) -> Surfaces:
    def attribute(key: str, widths: tuple[int, ...]) -> Float64 | None:
        index = primitive.attributes.get(key)
        if index is None:
            return None
        values = file.array(index, f"{part}.{key}").astype(np.float64, copy=False)
        if values.shape[1] not in widths:
            raise file.error(f"{part}.{key}", f"has {values.shape[1]} numbers for each vertex")
        bad = int((~np.isfinite(values)).any(axis=1).sum())
        if bad:
            raise file.error(f"{part}.{key}", f"has {bad} values that are not finite numbers", "repair the mesh")
        return values

    vertex = attribute("POSITION", (3,))
    assert vertex is not None
    n = len(vertex)
    others = {key: attribute(key, widths) for key, widths in _ATTRIBUTES}
    for key, values in others.items():
        if values is not None and len(values) != n:
            raise file.error(f"{part}.{key}", f"has {len(values)} values for {n} vertices")
    if primitive.indices is None:
        index = np.arange(n)
    else:
        raw = file.array(primitive.indices, f"{part}.indices")
        if raw.shape[1] != 1 or raw.dtype.kind != "i":
            raise file.error(f"{part}.indices", "are not whole numbers")
        index = raw[:, 0]
        if len(index) and not 0 <= int(index.min()) <= int(index.max()) < n:
            raise file.error(f"{part}.indices", f"name vertex {int(index.max())} of {n}")
    triangle = _triangles(index, primitive.mode)
    file.budget.triangles(len(triangle), part)
    file.budget.memory(_TRIANGLE_BYTES * len(triangle), part)
    corners = vertex[triangle]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = max(float(np.ptp(vertex, axis=0).max(initial=0.0)), 1e-12)
    has_area = np.sqrt((cross * cross).sum(axis=1)) > 1e-12 * size * size
    notes.flat += int((~has_area).sum())
    colour = others["COLOR_0"]
    return Surfaces(
        vertex,
        triangle[has_area],
        others["NORMAL"],
        (others["TEXCOORD_0"], others["TEXCOORD_1"]),
        None if colour is None else colour[:, :3],
        primitive.material,
    )


_ATTRIBUTES = (("NORMAL", (3,)), ("TEXCOORD_0", (2,)), ("TEXCOORD_1", (2,)), ("COLOR_0", (3, 4)))


def _triangles(index: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return the triangles (m, 3) of a list (mode 4), a strip (5) or a fan (6)."""
    if mode == 4:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    if len(index) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == 6:
        return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1)
    strip = np.stack([index[:-2], index[1:-1], index[2:]], axis=1)
    strip[1::2] = strip[1::2][:, [1, 0, 2]]
    return strip
