"""Shape of an object, from which scaled copies are added to a world.

A template holds the geoms of one object of a compiled map, in the object's frame. A copy of another scale S = diag(s)
has the vertices S (R v + p) of every mesh, and primitives whose axes are scaled likewise: exactly where all components
of s are equal or the primitive's axes are those of the object; else the shear of a primitive is left out. A sphere
becomes an ellipsoid; cylinders and capsules keep a round section of the same area.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import applied_to_rows, matrix_of, product
from signals.samples import Quat, Vec3
from sim.scene.budget import Budget
from sim.scene.compile_process import compile_mjcf
from sim.scene.maps.map_builder import numbers
from sim.scene.placed.actor import FixedBody
from sim.scene.scene_map import SceneMap, Surface

Float64 = NDArray[np.float64]
_G = mujoco.mjtGeom
_KINDS = {
    int(_G.mjGEOM_SPHERE): "sphere",
    int(_G.mjGEOM_CAPSULE): "capsule",
    int(_G.mjGEOM_ELLIPSOID): "ellipsoid",
    int(_G.mjGEOM_CYLINDER): "cylinder",
    int(_G.mjGEOM_BOX): "box",
    int(_G.mjGEOM_MESH): "mesh",
}


@dataclass(frozen=True)
class Part:
    """Geom of a template, in the object's frame."""

    geom: int  # of the template's model
    kind: str
    p_BG: Float64
    R_BG: Float64
    q_BG: Quat


@dataclass(frozen=True)
class Materials:
    """Materials of a copy, if the world does not have them: elements of MJCF, their files and surfaces."""

    prefix: str = ""  # of the names of materials
    elements: tuple[ET.Element, ...] = ()
    files: Mapping[str, bytes] = field(default_factory=dict)
    surfaces: Mapping[str, Surface] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Template:
    """Shape of an object. `key` is unique among the templates of one world."""

    key: str
    class_name: str
    model: mujoco.MjModel
    parts: tuple[Part, ...]
    materials: Materials = Materials()
    from_file: bool = False  # as that of a SceneMap
    checked: set[Vec3] = field(default_factory=set)  # scales of copies that were compiled

    def geoms(self, name: str, scale: Vec3) -> tuple[list[ET.Element], list[ET.Element], dict[str, bytes]]:
        """Return the geoms of a copy, its mesh assets, and their files. `name`: prefix of the geoms' names."""
        geoms, meshes, files = [], [], {}
        model = self.model
        for index, part in enumerate(self.parts):
            geom = part.geom
            material = int(model.geom_matid[geom])
            attributes = {
                "name": f"{name}_{index}",
                "type": part.kind,
                "contype": str(int(model.geom_contype[geom] != 0)),
                "conaffinity": str(int(model.geom_conaffinity[geom] != 0)),
                "condim": "3",
                "group": str(int(model.geom_group[geom])),
                "rgba": numbers(model.geom_rgba[geom].tolist()),
            }
            if material >= 0:
                name_of = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MATERIAL, material)
                attributes["material"] = self.materials.prefix + name_of
            if part.kind == "mesh":
                asset = f"{self.key}:{'_'.join(f'{s!r}' for s in scale)}:{index}"
                meshes.append(ET.Element("mesh", name=asset, file=f"{asset}.obj", inertia="shell"))
                files[f"{asset}.obj"] = _scaled_obj(model, part, scale)
                attributes["mesh"] = asset
            else:
                kind, size = _scaled_size(part, model.geom_size[geom].tolist(), scale)
                position = [s * float(p) for s, p in zip(scale, part.p_BG, strict=True)]
                attributes |= {"type": kind, "size": numbers(size)}
                attributes |= {"pos": numbers(position), "quat": numbers(part.q_BG)}
            geoms.append(ET.Element("geom", attributes))
        return geoms, meshes, files

    def check(self, scale: Vec3) -> None:
        """Raise ValueError if a copy of this scale cannot be compiled, ConfigError if that exceeds a limit."""
        if scale in self.checked:
            return
        geoms, meshes, files = self.geoms("copy", scale)
        root = ET.Element("mujoco")
        ET.SubElement(root, "compiler", autolimits="true", balanceinertia="false")
        ET.SubElement(root, "asset").extend(meshes)
        world = ET.SubElement(root, "worldbody")
        for geom in geoms:
            geom.attrib.pop("material", None)
        ET.SubElement(world, "body", name="copy", mocap="true").extend(geoms)
        budget = Budget(self.key) if self.from_file else None
        compile_mjcf(ET.tostring(root, encoding="unicode"), files, budget)
        self.checked.add(scale)

    def radius_m(self, scale: Vec3) -> float:
        """Return the radius of a sphere about the object's origin that encloses a copy."""
        greatest = 0.0
        for part in self.parts:
            box = self.model.geom_aabb[part.geom]
            middle = applied_to_rows(part.R_BG, box[:3]) + part.p_BG
            reach = np.linalg.norm(middle) + np.linalg.norm(box[3:])
            greatest = max(greatest, float(reach))
        return max(scale) * greatest * 1.0001 + 1e-6


def template_of(
    key: str, class_name: str, model: mujoco.MjModel, top: int, materials: Materials, *, from_file: bool = False
) -> Template | None:
    """Return the template of a body and its descendants; None if it holds a plane or a height field, or nothing."""
    parts = []
    for body, (p_TB, q_TB) in poses_below(model, top).items():
        R_TB = np.array(matrix_of(q_TB)).reshape(3, 3)
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        for geom in range(first, first + count):
            kind = _KINDS.get(int(model.geom_type[geom]))
            if kind is None:
                return None
            q: Quat = product(q_TB, tuple(model.geom_quat[geom].tolist()))
            R = np.array(matrix_of(q)).reshape(3, 3)
            parts.append(Part(geom, kind, applied_to_rows(R_TB, model.geom_pos[geom]) + np.array(p_TB), R, q))
    return Template(key, class_name, model, tuple(parts), materials, from_file) if parts else None


def poses_below(model: mujoco.MjModel, top: int) -> dict[int, tuple[Vec3, Quat]]:
    """Return the poses of a body and its descendants in the frame of that body, joints at their reference."""
    found: dict[int, tuple[Vec3, Quat]] = {top: ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))}
    for body in range(top + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent not in found:
            continue
        p, q = found[parent]
        R = np.array(matrix_of(q)).reshape(3, 3)
        x, y, z = (applied_to_rows(R, model.body_pos[body]) + np.array(p)).tolist()
        found[body] = ((x, y, z), product(q, tuple(model.body_quat[body].tolist())))
    return found


def fixed_bodies(model: mujoco.MjModel, top: int) -> list[FixedBody] | None:
    """Return a body and its descendants as bodies of an actor; None if one has no name or moves in a joint."""
    bodies = []
    for body, (p, q) in poses_below(model, top).items():
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
        if not name or model.body_jntnum[body]:
            return None
        bodies.append(FixedBody(name, p, q))
    return bodies


def materials_of(scene_map: SceneMap, prefix: str) -> Materials:
    """Return all materials of a generated map, with their textures; `prefix` is put before all names."""
    asset = ET.fromstring(scene_map.mjcf).find("asset")  # noqa: S314 (own text)
    assert asset is not None
    elements, files = [], {}
    for element in asset:
        if element.tag not in ("texture", "material") or element.get("name") == "sky":
            continue
        for each in element.iter():
            for key in ("name", "texture", "file"):
                if key in each.attrib:
                    each.set(key, prefix + each.attrib[key])
        file = element.get("file")
        if file is not None:
            files[file] = scene_map.assets[file.removeprefix(prefix)]
        elements.append(element)
    return Materials(prefix, tuple(elements), files, {prefix + name: each for name, each in scene_map.surfaces.items()})


def _scaled_size(part: Part, size: list[float], scale: Vec3) -> tuple[str, Iterable[float]]:
    """Return kind and size of a scaled primitive: along its own axes the scale is diag(R^T S R)."""
    sx, sy, sz = applied_to_rows(part.R_BG.T**2, np.array(scale)).tolist()
    if part.kind == "sphere":
        r = size[0]
        return ("sphere", (r * sx,)) if sx == sy == sz else ("ellipsoid", (r * sx, r * sy, r * sz))
    if part.kind in ("capsule", "cylinder"):
        return part.kind, (size[0] * (sx * sy) ** 0.5, size[1] * sz)
    return part.kind, (size[0] * sx, size[1] * sy, size[2] * sz)


def _scaled_obj(model: mujoco.MjModel, part: Part, scale: Vec3) -> bytes:
    """Return a mesh in the object's frame, scaled, as OBJ with normals."""
    mesh = int(model.geom_dataid[part.geom])

    def rows(array: NDArray, begin: NDArray, count: NDArray) -> NDArray:
        return array[int(begin[mesh]) : int(begin[mesh]) + int(count[mesh])].astype(np.float64)

    s = np.array(scale)
    vertex = (applied_to_rows(part.R_BG, rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum)) + part.p_BG) * s
    normal = applied_to_rows(part.R_BG, rows(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum)) / s
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    faces = [rows(model.mesh_face, model.mesh_faceadr, model.mesh_facenum)]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertex.tolist()]
    has_uv = model.mesh_texcoordadr[mesh] >= 0
    if has_uv:
        # MuJoCo counts v downwards.
        uv = rows(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum)
        lines += [f"vt {u!r} {1.0 - v!r}" for u, v in uv.tolist()]
        faces.append(rows(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum))
    lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in normal.tolist()]
    faces.append(rows(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum))
    join = "/" if has_uv else "//"
    for corners in np.stack(faces, axis=-1).astype(np.int64).tolist():
        lines.append("f " + " ".join(join.join(str(i + 1) for i in corner) for corner in corners))
    return ("\n".join(lines) + "\n").encode()
