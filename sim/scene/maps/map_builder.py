"""Builder of a map: collects its parts and writes them as MJCF.

Conventions of every map:

* Each object (a tree, a bench, a house) is one child body of the world named `<class>_<number>[_...]`; each limb of an
  actor is one mocap body `<actor>_<limb>`. Names of bodies and of geoms are unique.
* Solid geoms have contype = conaffinity = 1, all others 0. Collision-only shapes go to group 3.
* `texuniform` materials repeat every `tile_m` metres. MuJoCo lays a 2D texture on primitives along their local z, one
  image per 2 m at texrepeat 1, from the corner of smallest x and largest y.
* Orientations are quaternions, and numbers are written in full, so that compiling calls no angle functions.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._kernel import det_cos, det_sin
from signals.rotation import NO_TURN
from signals.samples import Quat, Vec3
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.season import Season
from sim.scene.maps.shipped_mesh import ShippedMesh
from sim.scene.scene_map import Actor, CornerReflector, SceneMap, Surface, actor_pose

# Size of the scene [m] by which MuJoCo scales lights and clip planes: near at 0.05 m, far at 1200 m.
_EXTENT_M = 50.0
# Defaults of MuJoCo and of this builder. A geom of exactly this grey has the colour of its material.
_PLAIN_GEOM = {"contype": "1", "conaffinity": "1", "condim": "3", "group": "0", "rgba": "0.5 0.5 0.5 1"}


def numbers(values: Iterable[float]) -> str:
    """Return the shortest text that reads back to the same doubles."""
    return " ".join(repr(float(v)) for v in values)


def yaw_quat(angle_rad: float) -> Quat:
    """Return a rotation about z: a positive angle turns x towards y."""
    return (det_cos(0.5 * angle_rad), 0.0, 0.0, det_sin(0.5 * angle_rad))


def pitch_quat(angle_rad: float) -> Quat:
    """Return a rotation about y: a positive angle turns z towards x."""
    return (det_cos(0.5 * angle_rad), 0.0, det_sin(0.5 * angle_rad), 0.0)


def roll_quat(angle_rad: float) -> Quat:
    """Return a rotation about x: a positive angle turns y towards z."""
    return (det_cos(0.5 * angle_rad), det_sin(0.5 * angle_rad), 0.0, 0.0)


def _placing(kind: str, pos: Vec3, quat: Quat, asset: str) -> dict[str, str]:
    """Return the attributes of a geom's asset and pose, without those of MuJoCo's defaults."""
    placing = {kind: asset} if asset else {}
    if pos != (0.0, 0.0, 0.0):
        placing["pos"] = numbers(pos)
    if quat != NO_TURN:
        placing["quat"] = numbers(quat)
    return placing


class Body:
    """Body under construction; its geoms are in its own frame."""

    def __init__(self, builder: MapBuilder, element: ET.Element, name: str) -> None:
        self._builder = builder
        self._element = element
        self.name = name
        self._count = 0

    def geom(
        self,
        kind: str,
        size: Iterable[float] = (),
        *,
        material: str,
        pos: Vec3 = (0.0, 0.0, 0.0),
        quat: Quat = NO_TURN,
        solid: bool = True,
        asset: str = "",
        part: str = "",
    ) -> None:
        """Add a geom, named after the body; its `pos` and `quat` are in the body's frame.

        `size` as in MJCF: radii and half lengths. `asset`: name of the mesh or height field of a geom of that kind.
        """
        self._add(kind, tuple(size), material, part, _placing(kind, pos, quat, asset), solid=solid)

    def proxy(
        self,
        kind: str,
        size: Iterable[float] = (),
        *,
        material: str,
        pos: Vec3 = (0.0, 0.0, 0.0),
        quat: Quat = NO_TURN,
        asset: str = "",
        part: str = "",
    ) -> None:
        """Add a geom for contact only: it is in group 3, which is not drawn. Arguments as of `geom`."""
        extra = {"group": "3"} | _placing(kind, pos, quat, asset)
        self._add(kind, tuple(size), material, part, extra, solid=True)

    def rod(
        self,
        radius_m: float,
        ends_m: tuple[float, ...],
        *,
        material: str,
        solid: bool = True,
        drawn: bool = True,
        part: str = "",
    ) -> None:
        """Add a capsule between two points; `ends_m`: x, y, z of both. `drawn=False`: a proxy."""
        extra: dict[str, str] = {} if drawn else {"group": "3"}
        extra["fromto"] = numbers(ends_m)
        self._add("capsule", (radius_m,), material, part, extra, solid=solid)

    def _add(
        self, kind: str, size: tuple[float, ...], material: str, part: str, extra: dict[str, str], *, solid: bool
    ) -> None:
        name = f"{self.name}_{part or self._count}"
        self._count += 1
        self._builder.claim_geom(name)
        attributes = {"name": name, "type": kind, "material": self._builder.known_material(material)}
        if size:
            attributes["size"] = numbers(size)
        attributes |= extra
        if not solid:
            attributes |= {"contype": "0", "conaffinity": "0"}
        ET.SubElement(self._element, "geom", attributes)


class MapBuilder:
    """Materials, textures, meshes, bodies and actors of one map, in the order in which they are added."""

    def __init__(self, name: str, *, assets: str = "", flat_meshes: bool = False) -> None:
        """`assets`: prefix of the names of materials, meshes, textures and numbered bodies, for a map that is added to
        another.

        `flat_meshes`: allow meshes without a thickness, whose inertia is at the limit of what MuJoCo accepts.
        """
        self._prefix = assets
        self._root = ET.Element("mujoco", model=name)
        ET.SubElement(self._root, "compiler", autolimits="true", balanceinertia=str(flat_meshes).lower())
        visual = ET.SubElement(self._root, "visual")
        ET.SubElement(visual, "headlight", ambient="0.35 0.37 0.42", diffuse="0.15 0.15 0.15", specular="0 0 0")
        ET.SubElement(visual, "map", znear="0.001", zfar="24.0", shadowclip="1.6")
        ET.SubElement(visual, "global", offwidth="1920", offheight="1080")
        ET.SubElement(self._root, "statistic", extent=numbers([_EXTENT_M]), center="0 0 0")
        default = ET.SubElement(self._root, "default")
        ET.SubElement(default, "geom", contype="1", conaffinity="1", condim="3")
        self._asset = ET.SubElement(self._root, "asset")
        ET.SubElement(
            self._asset, "texture", name="sky", type="skybox", builtin="gradient", rgb1="0.36 0.55 0.82",
            rgb2="0.85 0.90 0.96", width="64", height="384",
        )  # fmt: skip
        self._world = ET.SubElement(self._root, "worldbody")
        ET.SubElement(
            self._world, "light", name="sun", type="directional", pos="-20 -30 60", dir="0.45 0.6 -0.9",
            diffuse="0.75 0.72 0.66", specular="0.1 0.1 0.1", castshadow="true",
        )  # fmt: skip
        self._assets: dict[str, bytes] = {}
        self._materials: dict[str, Surface] = {}
        self._looks: dict[str, tuple[object, ...]] = {}
        self._textures: set[str] = set()
        self._meshes: set[str] = set()
        self._hfields: set[str] = set()
        self._bodies: set[str] = set()
        self._last_body = ""
        self._geoms: set[str] = set()
        self._classes: dict[str, tuple[str, ...]] = {}
        self._actors: list[Actor] = []
        self._corners: list[CornerReflector] = []
        self._numbers: dict[str, int] = {}
        self.season: Season = "summer"  # of plants

    def _own(self, name: str) -> str:
        """Return the name of an asset with this builder's prefix."""
        return name if name.startswith(self._prefix) else self._prefix + name

    def texture(self, name: str, png: bytes, *, cube: bool = False, holes: bool = False) -> str:
        """Add a texture from a PNG, unless the name exists. `cube`: on all six sides (for balls), else a flat sheet.

        `holes`: the PNG has an alpha channel, and meshes with texture coordinates are open where it is below one half.
        """
        name = self._own(name)
        if name not in self._textures:
            self._textures.add(name)
            self._assets[f"{name}.png"] = png
            texture = ET.SubElement(
                self._asset, "texture", name=name, type="cube" if cube else "2d", file=f"{name}.png"
            )
            if holes:
                texture.set("nchannel", "4")
        return name

    def material(
        self,
        name: str,
        surface: Surface,
        *,
        rgb: tuple[float, float, float] = (1.0, 1.0, 1.0),
        texture: str = "",
        tile_m: float | tuple[float, float] = 0.0,
        specular: float = 0.1,
        shininess: float = 0.2,
    ) -> str:
        """Add a material, unless the same one exists. `tile_m`: period of its texture; 0: it fills each geom once.

        Raises ValueError if another material has the name.
        """
        name, texture = self._own(name), self._own(texture) if texture else ""
        look = (surface, rgb, texture, tile_m, specular, shininess)
        if self._looks.get(name, look) != look:
            raise ValueError(f"two materials named {name}")
        if name in self._materials:
            return name
        if texture and texture not in self._textures:
            raise ValueError(f"material {name}: no texture {texture}; make it with texture() first")
        self._materials[name], self._looks[name] = surface, look
        attributes = {
            "name": name,
            "rgba": numbers((*rgb, 1.0)),
            "specular": repr(specular),
            "shininess": repr(shininess),
        }
        if texture:
            attributes["texture"] = texture
            if tile_m:
                u, v = tile_m if isinstance(tile_m, tuple) else (tile_m, tile_m)
                attributes |= {"texuniform": "true", "texrepeat": numbers((2.0 / u, 2.0 / v))}
        ET.SubElement(self._asset, "material", attributes)
        return name

    def mesh(self, name: str, mesh: Mesh | ShippedMesh, *, scale: float = 1.0, source: str = "") -> str:
        """Add a mesh asset, unless the name exists: shared meshes may be added repeatedly.

        `source`: name of the file, if meshes of several scales share one.
        """
        file = f"{self._own(source or name)}{mesh.suffix}"
        name = self._own(name)
        if name not in self._meshes:
            self._meshes.add(name)
            if file not in self._assets:
                self._assets[file] = mesh.data()
            size = {"scale": numbers((scale, scale, scale))} if scale != 1.0 or self._prefix else {}
            ET.SubElement(self._asset, "mesh", {"name": name, "file": file, "inertia": "shell", **size})
        return name

    def mesh_file(self, file: str, data: bytes) -> None:
        """Add a mesh asset named like its file without the suffix."""
        name = file.rpartition(".")[0]
        self._meshes.add(name)
        self._assets[file] = data
        ET.SubElement(self._asset, "mesh", name=name, file=file, inertia="shell")

    def hull(self, name: str, corners: NDArray[np.float64]) -> str:
        """Add the convex hull of points (n, 3) as a mesh asset, unless the name exists."""
        if name not in self._meshes:
            self._meshes.add(name)
            ET.SubElement(self._asset, "mesh", name=name, vertex=numbers(corners.ravel().tolist()), inertia="shell")
        return name

    def has_mesh(self, name: str) -> bool:
        return self._own(name) in self._meshes

    def hfield(self, name: str, heights: ArrayLike, size: tuple[float, float, float, float]) -> str:
        """Add a height field, unless the name exists: elevations 0..1 by row from -y.

        `size`: half x, half y, height, base [m].
        """
        if name not in self._hfields:
            self._hfields.add(name)
            elevations = np.asarray(heights, np.float64)
            rows, columns = elevations.shape
            ET.SubElement(
                self._asset, "hfield", name=name, nrow=str(rows), ncol=str(columns), size=numbers(size),
                elevation=numbers(elevations[::-1].ravel().tolist()),  # the file's first row is that of +y
            )  # fmt: skip
        return name

    def ground(self, kind: str, size: Iterable[float], *, material: str, name: str = "ground", **more: Vec3) -> None:
        """Add a geom to the worldbody: an instance of its own, whose class follows from its own name."""
        self.claim_geom(name)
        attributes = {"name": name, "type": kind, "size": numbers(size), "material": self.known_material(material)}
        attributes |= {key: numbers(value) for key, value in more.items()}
        ET.SubElement(self._world, "geom", attributes)

    def ground_hfield(self, asset: str, *, material: str, pos: Vec3) -> None:
        """Add a height field to the worldbody, as `ground` does with other geoms."""
        self.claim_geom("ground")
        attributes = {"name": "ground", "type": "hfield", "hfield": asset, "pos": numbers(pos)}
        ET.SubElement(self._world, "geom", attributes | {"material": self.known_material(material)})

    @property
    def last_body(self) -> str:
        """Name of the child body of the world that was added last."""
        return self._last_body

    def body(self, kind: str, pos: Vec3 = (0.0, 0.0, 0.0), quat: Quat = NO_TURN) -> Body:
        """Add an object of class `kind`, numbered in the order of adding."""
        self.classify(kind, f"{self._prefix}{kind}_*")
        return self._add_body(self.next_name(kind), pos, quat)

    def next_name(self, kind: str, *, digits: int = 3) -> str:
        """Return `<kind>_<number>`, a number higher with each call."""
        number = self._numbers.get(kind, 0)
        self._numbers[kind] = number + 1
        return f"{self._prefix}{kind}_{number:0{digits}d}"

    def named_body(self, name: str, pos: Vec3, quat: Quat) -> Body:
        """Add a static body under a name from `next_name`; the caller assigns its class."""
        return self._add_body(name, pos, quat)

    def _add_body(self, name: str, pos: Vec3, quat: Quat, *, mocap: bool = False) -> Body:
        if name in self._bodies:
            raise ValueError(f"two bodies named {name}")
        self._bodies.add(name)
        self._last_body = name
        attributes = {"name": name}
        if pos != (0.0, 0.0, 0.0):
            attributes["pos"] = numbers(pos)
        if quat != NO_TURN:
            attributes["quat"] = numbers(quat)
        if mocap:
            attributes["mocap"] = "true"
        return Body(self, ET.SubElement(self._world, "body", attributes), name)

    def actor(self, actor: Actor, *, at_origin: bool = False) -> list[Body]:
        """Register an actor, and add its mocap bodies at their poses of t = 0, or at the origin."""
        p, q, _, _ = actor_pose(actor, 0)
        if at_origin:
            p[:], q[:] = 0.0, NO_TURN
        self._actors.append(actor)
        poses = zip(actor.bodies, p.tolist(), q.tolist(), strict=True)
        return [self._add_body(name, (*pos,), (*quat,), mocap=True) for name, pos, quat in poses]

    def corner(self, corner: CornerReflector) -> None:
        """Register the triple bounce of a corner reflector; its plates are geoms of their own."""
        self._corners.append(corner)

    def classify(self, name: str, *globs: str) -> None:
        """Give the class `name` to all names that match the patterns."""
        known = self._classes.get(name, ())
        self._classes[name] = known + tuple(glob for glob in globs if glob not in known)

    def claim_geom(self, name: str) -> None:
        """Reserve the name of a geom. Raises ValueError if it exists."""
        if name in self._geoms:
            raise ValueError(f"two geoms named {name}")
        self._geoms.add(name)

    def known_material(self, name: str) -> str:
        """Return the name of a material. Raises ValueError if it does not exist."""
        name = self._own(name)
        if name not in self._materials:
            raise ValueError(f"no material {name}; make it with material() first")
        return name

    def added_to(self, base: SceneMap) -> SceneMap:
        """Return the map `base` with the assets, bodies and actors of this builder at its end."""
        return replace(
            base,
            mjcf=with_sections(base.mjcf, self._sections()),
            assets={**base.assets, **self._assets},
            surfaces={**base.surfaces, **self._materials},
            actors=(*base.actors, *self._actors),
        )

    def _sections(self) -> str:
        """Return assets and bodies as MJCF sections that may follow those of another map.

        Geoms state every attribute that a default of that map could change.
        """
        asset, world = ET.Element("asset"), ET.Element("worldbody")
        asset.extend(element for element in self._asset if element.get("name") != "sky")
        world.extend(copy.deepcopy(self._world.findall("body")))
        for geom in world.iter("geom"):
            for key, value in _PLAIN_GEOM.items():
                geom.attrib.setdefault(key, value)
        return ET.tostring(asset, encoding="unicode") + ET.tostring(world, encoding="unicode")

    def build(self) -> SceneMap:
        return SceneMap(
            mjcf=ET.tostring(self._root, encoding="unicode"),
            assets=dict(self._assets),
            classes=dict(self._classes),
            surfaces=dict(self._materials),
            actors=tuple(self._actors),
            corners=tuple(self._corners),
        )


def with_sections(mjcf: str, sections: str) -> str:
    """Return the text with `sections` at its end: MJCF allows a section twice, and no line number changes."""
    end = mjcf.rfind("</mujoco>")
    if end < 0:  # an empty element: <mujoco/>
        return f"{mjcf.rstrip().removesuffix('/>')}>{sections}</mujoco>"
    return mjcf[:end] + sections + mjcf[end:]
