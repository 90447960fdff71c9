"""Collects the parts of a map and writes them as MJCF.

Conventions that every map keeps:

* Each thing (a tree, a bench, a house) is one child body of the world named `<class>_<number>[_...]`; each limb of an
  actor is one mocap body `<actor>_<limb>`. Names of bodies and of geoms are unique.
* Solid geoms have contype = conaffinity = 1, all others 0. Collision-only shapes go to group 3.
* `texuniform` materials repeat every `tile_m` metres. MuJoCo lays a 2D texture on primitives along their local z, one
  image per 2 m at texrepeat 1, from the corner of least x and greatest y.
* Orientations are quaternions and numbers are written in full, so that compiling uses no angle functions.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from hil.signals._kernel import det_cos, det_sin
from hil.signals.rotation import NO_TURN
from hil.signals.samples import Quat, Vec3
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.scene_map import Actor, CornerReflector, SceneMap, Surface

# Edge of the view that the lights and MuJoCo's clip planes refer to [m]; near 0.05 m and far 1200 m follow from it.
_EXTENT_M = 50.0
# MuJoCo's own defaults, and those that this builder sets; exactly this grey means the colour of the material.
_PLAIN_GEOM = {"contype": "1", "conaffinity": "1", "condim": "3", "group": "0", "rgba": "0.5 0.5 0.5 1"}


def numbers(values: Iterable[float]) -> str:
    """Shortest text that reads back to the same doubles."""
    return " ".join(repr(float(v)) for v in values)


def yaw_quat(angle_rad: float) -> Quat:
    return (det_cos(0.5 * angle_rad), 0.0, 0.0, det_sin(0.5 * angle_rad))


def pitch_quat(angle_rad: float) -> Quat:
    """About y: positive turns z towards x."""
    return (det_cos(0.5 * angle_rad), 0.0, det_sin(0.5 * angle_rad), 0.0)


def roll_quat(angle_rad: float) -> Quat:
    return (det_cos(0.5 * angle_rad), det_sin(0.5 * angle_rad), 0.0, 0.0)


class Body:
    """A body under construction: geoms are added to it in its own frame."""

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
        mesh: str = "",
        part: str = "",
        fromto: tuple[float, ...] = (),
        hfield: str = "",
    ) -> None:
        """One geom, named after the body. `size` as in MJCF: radii and half lengths."""
        name = f"{self.name}_{part or self._count}"
        self._count += 1
        self._builder.claim_geom(name)
        attributes = {"name": name, "type": kind, "material": self._builder.known_material(material)}
        size = tuple(size)
        if size:
            attributes["size"] = numbers(size)
        if mesh:
            attributes["mesh"] = mesh
        if hfield:
            attributes["hfield"] = hfield
        if fromto:
            attributes["fromto"] = numbers(fromto)
        else:
            if pos != (0.0, 0.0, 0.0):
                attributes["pos"] = numbers(pos)
            if quat != NO_TURN:
                attributes["quat"] = numbers(quat)
        if not solid:
            attributes |= {"contype": "0", "conaffinity": "0"}
        ET.SubElement(self._element, "geom", attributes)


class MapBuilder:
    """Materials, textures, meshes, bodies and actors of one map, in the order of their making."""

    def __init__(self, name: str) -> None:
        self._root = ET.Element("mujoco", model=name)
        ET.SubElement(self._root, "compiler", autolimits="true", balanceinertia="false")
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
        self._textures: set[str] = set()
        self._meshes: set[str] = set()
        self._bodies: set[str] = set()
        self._geoms: set[str] = set()
        self._classes: dict[str, tuple[str, ...]] = {}
        self._actors: list[Actor] = []
        self._corners: list[CornerReflector] = []
        self._numbers: dict[str, int] = {}

    def texture(self, name: str, png: bytes, *, cube: bool = False) -> str:
        """A texture from a PNG; `cube` wraps it round all six sides (for balls), else it is a flat sheet."""
        if name not in self._textures:
            self._textures.add(name)
            self._assets[f"{name}.png"] = png
            ET.SubElement(self._asset, "texture", name=name, type="cube" if cube else "2d", file=f"{name}.png")
        return name

    def material(
        self,
        name: str,
        surface: Surface,
        *,
        rgb: tuple[float, float, float] = (1.0, 1.0, 1.0),
        alpha: float = 1.0,
        texture: str = "",
        tile_m: float | tuple[float, float] = 0.0,
        specular: float = 0.1,
        shininess: float = 0.2,
    ) -> str:
        """A material. With `tile_m` its texture repeats in metres; without, it fills each geom once."""
        if name in self._materials:
            return name
        self._materials[name] = surface
        attributes = {
            "name": name,
            "rgba": numbers((*rgb, alpha)),
            "specular": repr(specular),
            "shininess": repr(shininess),
        }
        if texture:
            if texture not in self._textures:
                raise ValueError(f"material {name}: no texture {texture}; make it with texture() first")
            attributes["texture"] = texture
            if tile_m:
                u, v = tile_m if isinstance(tile_m, tuple) else (tile_m, tile_m)
                attributes |= {"texuniform": "true", "texrepeat": numbers((2.0 / u, 2.0 / v))}
        ET.SubElement(self._asset, "material", attributes)
        return name

    def mesh(self, name: str, mesh: Mesh) -> str:
        """A mesh asset; the first of a name counts, so shared ones may be asked for again."""
        if name not in self._meshes:
            self._meshes.add(name)
            self._assets[f"{name}.obj"] = mesh.obj()
            ET.SubElement(self._asset, "mesh", name=name, file=f"{name}.obj", inertia="shell")
        return name

    def has_mesh(self, name: str) -> bool:
        return name in self._meshes

    def hfield(self, name: str, rows: list[list[float]], size: tuple[float, float, float, float]) -> str:
        """A height field: elevations 0..1 by row from -y, size (half x, half y, height, base) [m]."""
        flat = numbers(value for row in rows for value in row)
        ET.SubElement(
            self._asset, "hfield", name=name, nrow=str(len(rows)), ncol=str(len(rows[0])), size=numbers(size),
            elevation=flat,
        )  # fmt: skip
        return name

    def ground(self, kind: str, size: Iterable[float], *, material: str, name: str = "ground", **more: Vec3) -> None:
        """A geom on the worldbody: an instance of its own, classed by its own name."""
        self.claim_geom(name)
        attributes = {"name": name, "type": kind, "size": numbers(size), "material": self.known_material(material)}
        attributes |= {key: numbers(value) for key, value in more.items()}
        ET.SubElement(self._world, "geom", attributes)

    def body(self, kind: str, pos: Vec3 = (0.0, 0.0, 0.0), quat: Quat = NO_TURN) -> Body:
        """A thing of class `kind`, numbered in the order of making."""
        self.classify(kind, f"{kind}_*")
        return self._add_body(self.next_name(kind), pos, quat)

    def next_name(self, kind: str, *, digits: int = 3) -> str:
        number = self._numbers.get(kind, 0)
        self._numbers[kind] = number + 1
        return f"{kind}_{number:0{digits}d}"

    def named_body(self, name: str, pos: Vec3, quat: Quat) -> Body:
        """A static body under a name from `next_name`; its class is the caller's business."""
        return self._add_body(name, pos, quat)

    def limb(self, name: str, pos: Vec3, quat: Quat) -> Body:
        """A mocap body of an actor."""
        return self._add_body(name, pos, quat, mocap=True)

    def _add_body(self, name: str, pos: Vec3, quat: Quat, *, mocap: bool = False) -> Body:
        if name in self._bodies:
            raise ValueError(f"two bodies named {name}")
        self._bodies.add(name)
        attributes = {"name": name}
        if pos != (0.0, 0.0, 0.0):
            attributes["pos"] = numbers(pos)
        if quat != NO_TURN:
            attributes["quat"] = numbers(quat)
        if mocap:
            attributes["mocap"] = "true"
        return Body(self, ET.SubElement(self._world, "body", attributes), name)

    def actor(self, actor: Actor) -> None:
        missing = [name for name in actor.bodies if name not in self._bodies]
        if missing:
            raise ValueError(f"actor {actor.name}: no body {missing[0]}")
        self._actors.append(actor)

    def corner(self, corner: CornerReflector) -> None:
        """What three plates do together; the plates are geoms of their own."""
        self._corners.append(corner)

    def classify(self, name: str, *globs: str) -> None:
        known = self._classes.get(name, ())
        self._classes[name] = known + tuple(glob for glob in globs if glob not in known)

    def claim_geom(self, name: str) -> None:
        if name in self._geoms:
            raise ValueError(f"two geoms named {name}")
        self._geoms.add(name)

    def known_material(self, name: str) -> str:
        if name not in self._materials:
            raise ValueError(f"no material {name}; make it with material() first")
        return name

    def sections(self) -> str:
        """Materials and bodies as MJCF sections that may follow those of another map.

        Geoms say in full what a default of that map could change.
        """
        asset, world = ET.Element("asset"), ET.Element("worldbody")
        asset.extend(self._asset.findall("material"))
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
