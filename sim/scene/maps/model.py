"""Model of a vehicle, a person, a plant or an object: meshes by piece and material, and facts about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from signals.samples import Vec3
from sim.scene.maps.shipped_mesh import ShippedMesh, joined
from sim.scene.scene_map import Surface

CONTACT = "contact"  # beginning of the names of pieces that are solid and not drawn


@dataclass(frozen=True)
class Look:
    """Colour, texture and surface of a material of the user's own file."""

    rgb: tuple[float, float, float]
    png: bytes  # empty: no texture
    holes: bool
    specular: float
    shininess: float
    surface: Surface


@dataclass(frozen=True)
class Contact:
    """Solid shape that is not drawn: a box, a cylinder across y, or the convex hull of a mesh."""

    kind: str
    size: tuple[float, ...] = ()
    pos: Vec3 = (0.0, 0.0, 0.0)
    hull: ShippedMesh | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """Contents of one file: meshes by piece and material, and what else is known of them."""

    name: str
    pieces: Mapping[str, Mapping[str, ShippedMesh]]
    facts: Mapping[str, Any]
    looks: Mapping[str, Look] = field(default_factory=dict)  # materials of the user's own file
    is_own: bool = False

    def mesh(self, piece: str) -> ShippedMesh:
        """Return the mesh of a piece, all its materials together."""
        return joined(list(self.pieces[piece].values()))

    def by_material(self, without: tuple[str, ...] = ()) -> dict[str, ShippedMesh]:
        """Return what is drawn, by material, without pieces whose names begin with one of `without`."""
        found: dict[str, list[ShippedMesh]] = {}
        for piece, meshes in self.pieces.items():
            if not piece.startswith((CONTACT, *without)):
                for material, mesh in meshes.items():
                    found.setdefault(material, []).append(mesh)
        return {material: joined(meshes) for material, meshes in found.items()}

    @property
    def contacts(self) -> list[Contact]:
        """Solid shapes: those that the facts name, else hulls."""
        found = []
        for shape in self.facts["contact"]:
            if shape["kind"] == "hull":
                found.append(Contact("hull", hull=self.mesh(shape["piece"])))
            else:
                found.append(Contact(shape["kind"], tuple(shape["size"]), tuple(shape["pos"])))
        return found
