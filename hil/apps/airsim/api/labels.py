"""Methods about what pictures are labelled with: segmentation ids and detections."""

from __future__ import annotations

from typing import Any, NamedTuple

from hil.apps.airsim.api.images import CAMERA, EXTERNAL_OR_ANNOTATION, IMAGE_TYPE
from hil.apps.airsim.api.objects import NO_POSE, object_names
from hil.apps.airsim.api.session import VEHICLE, geo_point
from hil.apps.airsim.pictures.detections import Detection, Detections
from hil.apps.airsim.pictures.segmentation import NOT_FOUND
from hil.apps.airsim.rpc.arguments import BOOL, FLOAT, INT, TEXT, Pose, Quaternion, Vector
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.objects.names import matching
from signals.frames import frd_from_flu
from signals.rotation import conjugate, product

_MOST_RADIUS_M = 1e6


class Pixel(NamedTuple):
    """AirSim's Vector2r."""

    x_val: float
    y_val: float


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    ids = simulation.cameras.segmentation
    cosys = simulation.settings.added.cosys  # a file of Cosys-AirSim: objects are numbered by their place in the list

    def colour_map() -> list[Vector]:
        return [Vector(*colour) for colour in ids.instance_palette().astype(float).tolist()]

    def instance_poses(ned: bool, only_visible: bool) -> list[Pose]:  # noqa: ARG001
        known = set(object_names(simulation))
        return [
            simulation.frame.pose(*detections.box(number)[2:]) if name in known else NO_POSE
            for number, name in enumerate(ids.names)
            if number
        ]

    def set_id(mesh: str, number: int, is_regex: bool) -> bool:
        known = object_names(simulation)
        found = matching(mesh, known, any_case=True) if is_regex else [name for name in known if name == mesh]
        ids.give(found, number)
        return bool(found)

    def get_id(name: str) -> int:
        if cosys:
            return ids.number_of(name)
        return ids.id_of(name) if name in object_names(simulation) else NOT_FOUND

    detections = Detections(simulation.cameras, simulation.frames)
    find = simulation.cameras.find

    def add(camera: str, image_type: int, pattern: str, vehicle: str, external: bool | str) -> None:
        detections.add(find(camera, vehicle, external is True), image_type, pattern)

    def set_radius(camera: str, image_type: int, radius_cm: float, vehicle: str, external: bool | str) -> None:
        if not 0.0 <= radius_cm <= 100.0 * _MOST_RADIUS_M:
            raise RpcError(f"the radius must be 0 to {100.0 * _MOST_RADIUS_M:g} cm, not {radius_cm:g}")
        detections.filter(find(camera, vehicle, external is True), image_type).radius_m = 0.01 * radius_cm

    def clear(camera: str, image_type: int, vehicle: str, external: bool | str) -> None:
        detections.filter(find(camera, vehicle, external is True), image_type).patterns.clear()

    def found(camera: str, image_type: int, vehicle: str, external: bool | str) -> list[dict[str, Any]]:
        seen = detections.found(find(camera, vehicle, external is True), image_type)
        return [_detection_info(simulation, each) for each in seen]

    mesh = Parameter("mesh_name", TEXT)
    where = (CAMERA, Parameter("image_type", IMAGE_TYPE))
    whose = (VEHICLE, EXTERNAL_OR_ANNOTATION)
    return [
        method(
            "simSetSegmentationObjectID",
            set_id,
            mesh,
            Parameter("object_id", INT),
            optional("is_name_regex", BOOL, False),
        ),
        method(
            "simGetSegmentationObjectID",
            get_id,
            mesh,
        ),
        method("simAddDetectionFilterMeshName", add, *where, mesh, *whose),
        method("simSetDetectionFilterRadius", set_radius, *where, Parameter("radius_cm", FLOAT), *whose),
        method("simClearDetectionMeshNames", clear, *where, *whose),
        method("simGetDetections", found, *where, *whose),
        method("simListInstanceSegmentationObjects", lambda: list(ids.names[1:])),
        method("simGetInstanceSegmentationColorMap", colour_map),
        method(
            "simListInstanceSegmentationPoses",
            instance_poses,
            optional("ned", BOOL, True),
            optional("only_visible", BOOL, False),
        ),
    ]


def _detection_info(sim: Simulation, detection: Detection) -> dict[str, Any]:
    """Return AirSim's DetectionInfo.

    The relative pose has the position of the object in the camera's frame, and the orientation of the camera in the
    object's (UDetectionComponent::getRelativeRotation), FRD.
    """
    w, x, y, z = product(conjugate(detection.box.q_WO), detection.q_WC)
    return {
        "name": detection.name,
        "geo_point": geo_point(sim, detection.box.p_WO),
        "box2D": {"min": Pixel(*detection.low_px), "max": Pixel(*detection.high_px)},
        "box3D": {"min": Vector(*detection.low_F), "max": Vector(*detection.high_F)},
        "relative_pose": Pose(Vector(*frd_from_flu(detection.p_CO)), Quaternion(w, x, -y, -z)),
    }
