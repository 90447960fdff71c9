"""Make a map of a glTF file: what is drawn, and what the vehicle collides with.

Each node with a mesh is one object. Its geoms, one for each material, are only visible; convex pieces in group 3 are
solid (contact_pieces.py).
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin
from signals.samples import Quat
from signals.units import RAD_PER_DEG
from sim.scene import surfaces as named_surfaces
from sim.scene.budget import Budget
from sim.scene.imports.class_patterns import ClassPatterns
from sim.scene.imports.contact_pieces import Pieces, contact_pieces
from sim.scene.imports.gltf_file import GltfFile
from sim.scene.imports.gltf_geometry import Notes, Placed, Surfaces, placed_meshes, surfaces_of
from sim.scene.imports.msh import msh
from sim.scene.maps.imported.gltf_materials import Look, decoded, look_of, png_of, srgb_of
from sim.scene.maps.imported.imported_map import ImportedMap
from sim.scene.maps.map_builder import Body, MapBuilder
from sim.scene.scene_map import Surface
from sim.scene.work_progress import progress

Float64 = NDArray[np.float64]

MAX_PIECES = 16_000  # solid pieces of a map
MAX_WIDE = 64_000  # of these, if they are walls
_MAX_MESH_PIECES, _MIN_MESH_PIECES = 8_000, 12
MAX_EXTENT_M = 50_000.0
MAX_ORIGIN_M = 100_000.0  # of map.origin_m
_NO_MESH = "export it again with its meshes, not hidden, as triangles"
_DRAWN_BYTES = 150  # of a triangle in MuJoCo's format
_USUAL_M = (5.0, 5_000.0)  # width of a map; beyond, the file may be in another unit
_MAX_COLOURS = 48  # of the vertices of one primitive
_ROUND_ORIGIN_M = np.array([(x, y) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 0.0, 3.0)])
_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y up to z up


@dataclass(frozen=True)
class GltfOptions:
    """Options by which a file becomes a map."""

    scale: float = 1.0
    yaw_deg: float = 0.0
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ground: bool | None = None  # None: where the file has none round the take-off place
    classes: Mapping[str, Sequence[str]] | None = None
    surfaces: Mapping[str, Surface] | None = None  # patterns of material names
    contact_error_m: float = 0.2


def map_of_gltf(file: GltfFile, options: GltfOptions) -> ImportedMap:
    """Return the map of a file. Raises ConfigError."""
    return _MapMaker(file, options).make()


class _Builder(MapBuilder):
    """A builder that charges a budget for every geom."""

    def __init__(self, budget: Budget) -> None:
        super().__init__("gltf", flat_meshes=True)
        self._budget = budget

    def claim_geom(self, name: str) -> None:
        self._budget.objects(1, f"geom {name[:80]!r}")
        super().claim_geom(name)


class _MapMaker:
    def __init__(self, file: GltfFile, options: GltfOptions) -> None:
        self._file, self._options = file, options
        self._builder = _Builder(file.budget)
        self._notes = Notes()
        self._surfaces: dict[int, list[Surfaces]] = {}
        self._looks: dict[int | None, Look] = {}
        self._materials: dict[tuple[int | None, tuple[float, ...]], str] = {}
        self._material_names: set[str] = set()
        self._textures: dict[tuple[int, float | None], str] = {}
        self._meshes: dict[object, list[tuple[str, str, tuple[float, float, float], str]]] = {}
        self._pieces: dict[object, Pieces] = {}
        self._stems: dict[int, str] = {}  # of the assets of solid pieces
        self._bodies: dict[str, int] = {}
        self._classes: dict[str, list[str]] = {}
        self._patterns = ClassPatterns(options.classes)
        self._used_surfaces: set[str] = set()
        self._error_m = options.contact_error_m
        self._low_m, self._high_m = np.full(3, np.inf), np.full(3, -np.inf)
        self._covered = np.zeros(len(_ROUND_ORIGIN_M), bool)

    def make(self) -> ImportedMap:
        options = self._options
        angle = options.yaw_deg * RAD_PER_DEG
        c, s = det_cos(angle), det_sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        placed = list(placed_meshes(self._file, options.scale, turn, self._notes))
        if not placed:
            raise self._file.error("", "shows no mesh: its scene has no node with a mesh", _NO_MESH)
        self._budget = min(max(MAX_PIECES // len(placed), _MIN_MESH_PIECES), _MAX_MESH_PIECES)
        self._wide = min(max(MAX_WIDE // len(placed), self._budget), MAX_WIDE // 2)
        for number, one in enumerate(placed):
            progress.tell("objects", number, len(placed))
            self._add(one)
        if not self._bodies:
            raise self._file.error("", "has no triangles to show", _NO_MESH)
        if options.ground or (options.ground is None and not self._covered.all()):
            self._builder.material("ground", named_surfaces.SOIL, rgb=(0.45, 0.43, 0.38), specular=0.0)
            self._builder.ground("plane", (0.0, 0.0, 1.0), material="ground")
            self._classes.setdefault("ground", []).append("ground")
        built = self._builder.build()
        scene_map = replace(
            built,
            classes={name: tuple(names) for name, names in self._classes.items()},
            notes=tuple(self._note_lines()),
        )
        gltf = self._file.gltf
        names = [part.name for parts in (gltf.nodes, gltf.meshes, gltf.materials) for part in parts if part.name]
        return ImportedMap(
            scene_map,
            self._patterns.unmatched,
            tuple(name for name in options.surfaces or {} if name not in self._used_surfaces),
            tuple(dict.fromkeys(names)),
        )

    def _note_lines(self) -> list[str]:
        notes, lines = self._notes, []
        if any(self._options.origin_m):
            x, y, z = self._options.origin_m
            lines.append(f"the take-off place is ({x:g}, {y:g}, {z:g}) m in the file (map.origin_m)")
        size_m = self._high_m - self._low_m
        if not _USUAL_M[0] <= size_m[:2].max() <= _USUAL_M[1]:
            x, y, z = size_m.tolist()
            size = f"{x:.6g} m by {y:.6g} m, {z:.6g} m high"
            lines.append(f"the map is {size}: set map.scale if the file is not in metres")
        if notes.flat:
            lines.append(f"{notes.flat} triangles without an area are left out")
        if notes.lines:
            lines.append(f"{notes.lines} primitives of points and lines are left out")
        if notes.skinned:
            lines.append(f"{notes.skinned} skinned meshes stand as they are stored, without their joints")
        if self._error_m > self._options.contact_error_m:
            lines.append(f"what is solid reaches up to {self._error_m:g} m beyond the finest meshes (contact_error_m)")
        return lines

    def _of(self, mesh: int) -> list[Surfaces]:
        if mesh not in self._surfaces:
            self._surfaces[mesh] = surfaces_of(self._file, mesh, self._notes)
        return self._surfaces[mesh]

    def _look(self, index: int | None) -> Look:
        if index not in self._looks:
            self._looks[index] = look_of(self._file, index)
        return self._looks[index]

    def _add(self, placed: Placed) -> None:
        """Add a mesh at its place: a body for each class of its materials; the first holds what is solid."""
        shown = [s for s in self._of(placed.mesh) if self._look(s.material).visible]
        if not shown:
            return
        mesh_name = self._file.gltf.meshes[placed.mesh].name
        position = placed.position - np.array(self._options.origin_m)
        low, high = _bounds(shown, placed)
        self._low_m, self._high_m = np.minimum(self._low_m, low), np.maximum(self._high_m, high)
        origin = np.array(self._options.origin_m)
        if not max(np.abs(low - origin).max(), np.abs(high - origin).max()) <= MAX_EXTENT_M:  # NaN is none
            message = f"goes beyond {MAX_EXTENT_M / 1000:g} km from the take-off place"
            hint = _within_reach(self._options, low, high)
            raise self._file.error(f"node {placed.name[:60]!r}", message, hint)
        by_class: dict[str, list[Surfaces]] = {}
        for part in shown:
            name = self._patterns.class_of((placed.name, mesh_name, self._look(part.material).name), "")
            by_class.setdefault(name, []).append(part)
        x, y, z = position.tolist()
        bodies = []
        for name, parts in by_class.items():
            body_name = self._body_name(placed.name)
            body = self._builder.named_body(body_name, (x, y, z), _quat_of(placed.R))
            bodies.append(body)
            if name:
                self._classes.setdefault(name, []).append(body_name)
            for asset, material, centre, label in self._drawn(placed, parts):
                body.geom("mesh", asset=asset, material=material, pos=centre, solid=False, part=label)
        pieces = self._solid(placed, shown)
        self._add_pieces(bodies[0], pieces, classified="" not in by_class)
        self._error_m = max(self._error_m, pieces.error_m)
        self._look_under_origin(shown, placed, position)

    def _look_under_origin(self, shown: list[Surfaces], placed: Placed, position: Float64) -> None:
        """Note which places round the take-off place have a surface below them, or at most 1 m above."""
        for part in shown:
            corners = (part.vertex @ _TURN.T @ placed.scales.T @ placed.R.T + position)[part.triangle]
            corners = corners[corners[:, :, 2].min(axis=1) < 1.0]
            for i in np.flatnonzero(~self._covered).tolist():
                a, b, c = (corners[:, k, :2] - _ROUND_ORIGIN_M[i] for k in range(3))
                turns = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))]
                inside = (np.minimum.reduce(turns) >= 0.0) | (np.maximum.reduce(turns) <= 0.0)
                self._covered[i] = bool(inside.any())

    def _body_name(self, name: str) -> str:
        clean = re.sub(r"[^A-Za-z0-9_.\-]+", "_", name)[:80].strip("_") or "object"
        if clean in ("vehicle", "world", "ground"):
            clean += "_node"
        number = self._bodies.get(clean, 0)
        self._bodies[clean] = number + 1
        return self._body_name(f"{clean}_{number + 1}") if number else clean

    def _drawn(self, placed: Placed, parts: list[Surfaces]) -> list[tuple[str, str, tuple[float, float, float], str]]:
        """Return mesh asset, material, place and label of each visible geom."""
        result = []
        for part in parts:
            key = (id(part), placed.scales.tobytes())
            if key not in self._meshes:
                self._meshes[key] = self._add_meshes(part, placed.scales)
            result += self._meshes[key]
        return [(asset, material, centre, f"part_{i}") for i, (asset, material, centre, _) in enumerate(result)]

    def _add_meshes(self, part: Surfaces, scales: Float64) -> list[tuple[str, str, tuple[float, float, float], str]]:
        look = self._look(part.material)
        self._file.budget.memory(_DRAWN_BYTES * len(part.triangle), "a mesh at one of its scales")
        linear = scales @ _TURN
        vertex = part.vertex @ linear.T
        triangle = part.triangle if np.linalg.det(scales) > 0.0 else part.triangle[:, ::-1]
        normal = None
        if part.normal is not None and np.linalg.det(scales) != 0.0:
            normal = part.normal @ np.linalg.inv(linear)
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            normal = None if (length < 1e-12).any() else normal / length
        uv = part.uv[look.uv_set] if look.texture is not None and look.uv_set < 2 else None
        uv = None if uv is None else look.uv(uv)
        result: list[tuple[str, str, tuple[float, float, float], str]] = []
        for rgb, chosen in _by_colour(part.colour, triangle, look):
            material = self._material(part.material, rgb, textured=uv is not None)
            used, local = np.unique(triangle[chosen], return_inverse=True)
            local = local.reshape(-1, 3)
            if normal is None:  # flat faces, as glTF asks for
                used, local = used[local.ravel()], np.arange(local.size).reshape(-1, 3)
            middle = 0.5 * (vertex[used].min(axis=0) + vertex[used].max(axis=0))
            name = f"mesh_{len(self._meshes)}_{len(result)}"
            data = msh(
                vertex[used] - middle, local, None if uv is None else uv[used], None if normal is None else normal[used]
            )
            self._builder.mesh_file(f"{name}.msh", data)
            x, y, z = middle.tolist()
            result.append((name, material, (x, y, z), ""))
        return result

    def _material(self, index: int | None, rgb: tuple[float, float, float], *, textured: bool) -> str:
        key: tuple[int | None, tuple[float, ...]] = (index, rgb if textured else (*rgb, -1.0))
        if key in self._materials:
            return self._materials[key]
        look = self._look(index)
        name = re.sub(r"[^A-Za-z0-9_.\-]+", "_", look.name)[:80] or "material"
        while name in self._material_names or name in ("ground", "contact"):
            name += "_"
        self._material_names.add(name)
        surface = look.surface
        for pattern, chosen in (self._options.surfaces or {}).items():
            if fnmatch.fnmatchcase(look.name, pattern):
                surface = chosen
                self._used_surfaces.add(pattern)
        texture = ""
        if look.texture is not None and textured:
            image_key = (look.texture, look.holes)
            if image_key not in self._textures:
                png, holes = png_of(decoded(self._file, look.texture), look.holes)
                texture = f"image_{look.texture}" + (f"_{len(self._textures)}" if look.holes is not None else "")
                self._textures[image_key] = self._builder.texture(texture, png, holes=holes)
            texture = self._textures[image_key]
        self._builder.material(
            name, surface, rgb=rgb, texture=texture, specular=look.specular, shininess=look.shininess
        )
        self._materials[key] = name
        return name

    def _solid(self, placed: Placed, shown: list[Surfaces]) -> Pieces:
        up = placed.R.T @ np.array([0.0, 0.0, 1.0])
        up = np.array([0.0, 0.0, 1.0]) if np.allclose(up, (0.0, 0.0, 1.0), atol=1e-9) else up
        key = (placed.mesh, placed.scales.tobytes(), up.tobytes())
        if key not in self._pieces:
            linear = placed.scales @ _TURN
            corners = []
            for part in shown:
                triangle = part.triangle if np.linalg.det(placed.scales) > 0.0 else part.triangle[:, ::-1]
                corners.append((part.vertex @ linear.T)[triangle])
            every = np.concatenate(corners)
            cross = np.cross(every[:, 1] - every[:, 0], every[:, 2] - every[:, 0])
            every = every[np.linalg.norm(cross, axis=1) > 1e-9]
            self._pieces[key] = (
                contact_pieces(
                    every, error_m=self._options.contact_error_m, max_pieces=self._budget, up=up, max_wide=self._wide
                )
                if len(every)
                else Pieces(self._options.contact_error_m)
            )
        return self._pieces[key]

    def _add_pieces(self, body: Body, pieces: Pieces, *, classified: bool) -> None:
        b = self._builder
        material = b.material("contact", named_surfaces.CONCRETE)
        stem = self._stems.setdefault(id(pieces), f"solid_{len(self._stems)}")
        for i, hull in enumerate(pieces.hulls):
            middle = 0.5 * (hull.min(axis=0) + hull.max(axis=0))
            x, y, z = middle.tolist()
            b.hull(f"{stem}_{i}", hull - middle)
            body.proxy("mesh", asset=f"{stem}_{i}", material=material, pos=(x, y, z), part=f"solid_{i}")
        for i, (centre, half, axes) in enumerate(pieces.boxes):
            x, y, z = centre.tolist()
            body.proxy(
                "box", half.tolist(), material=material, pos=(x, y, z), quat=_quat_of(axes),
                part=f"solid_box_{i}",
            )  # fmt: skip
        if pieces.terrain is not None:
            field = pieces.terrain
            low, high = float(field.heights.min()), float(field.heights.max())
            rise = max(high - low, 1e-3)
            name = f"{stem}_terrain"
            b.hfield(name, (field.heights - low) / rise, (*field.half, rise, 1.0))
            body.proxy("hfield", asset=name, material=material, pos=(*field.centre, low), part="solid_terrain")
            if not classified:
                self._classes.setdefault("terrain", []).append(body.name)


def _bounds(shown: list[Surfaces], placed: Placed) -> tuple[Float64, Float64]:
    """Return the least and greatest corner of the box round a mesh's own box, at its place."""
    vertex = np.concatenate([s.vertex for s in shown])
    ends = np.stack([vertex.min(axis=0), vertex.max(axis=0)])
    corners = np.array([(ends[i, 0], ends[j, 1], ends[k, 2]) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    at = corners @ (placed.R @ placed.scales @ _TURN).T + placed.position
    return at.min(axis=0), at.max(axis=0)


def _within_reach(options: GltfOptions, low: Float64, high: Float64) -> str:
    """Return how a thing between two corners comes near the take-off place: by scale if it is large, else by origin."""
    size_m = float((high - low).max())
    if not np.isfinite(size_m):
        return "its place is no number: export it again"
    if size_m > 0.5 * MAX_EXTENT_M:
        scale = 10.0 ** np.floor(np.log10(options.scale * 0.1 * MAX_EXTENT_M / size_m))
        return f"in a scene's file, set map.scale: {scale:g}, or what a unit of the file is in metres"
    x, y, z = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2])
    if max(abs(x), abs(y), abs(z)) < MAX_ORIGIN_M:
        return f"in a scene's file, set map.origin_m: [{x:.1f}, {y:.1f}, {z:.1f}]"
    return "move the model to the origin of its file, and export it again"


def _by_colour(
    colour: Float64 | None, triangle: NDArray[np.int64], look: Look
) -> list[tuple[tuple[float, float, float], NDArray[np.bool_]]]:
    """Return the colours of a primitive, and the triangles of each: more than one if its vertices have colours."""
    everything = np.ones(len(triangle), bool)
    if colour is None:
        return [(look.rgb, everything)]
    of_triangle = np.clip(colour[triangle].mean(axis=1), 0.0, 1.0)
    for levels in (16, 8, 4, 2, 1):
        index = np.minimum((np.sqrt(of_triangle) * levels).astype(np.int64), levels - 1)
        keys, inverse = np.unique(index, axis=0, return_inverse=True)
        if len(keys) <= _MAX_COLOURS:
            break
    result = []
    for number in range(len(keys)):
        chosen = inverse.reshape(-1) == number
        r, g, b = (a * s for a, s in zip(look.rgb, srgb_of(of_triangle[chosen].mean(axis=0)), strict=True))
        result.append(((r, g, b), chosen))
    return result


def _quat_of(R: Float64) -> Quat:
    """Return the unit quaternion of a rotation matrix (Shepperd, J. Guidance and Control 1, 1978)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    options = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    k = int(options.argmax())
    root = np.sqrt(max(1.0 + 2.0 * options[k] - trace, 1e-12)) if k else np.sqrt(1.0 + trace)
    if k == 0:
        q = [root * root, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    elif k == 1:
        q = [R[2, 1] - R[1, 2], root * root, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]]
    elif k == 2:
        q = [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], root * root, R[1, 2] + R[2, 1]]
    else:
        q = [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], root * root]
    w, x, y, z = (float(v) for v in np.array(q) / np.linalg.norm(q))
    return (w, x, y, z)
