"""Methods about what pictures are labelled with: segmentation ids and detections."""

from __future__ import annotations

from hil.apps.airsim.rpc.arguments import BOOL, INT, TEXT
from hil.apps.airsim.rpc.methods import Caller, Method, Parameter, method, optional
from hil.apps.airsim.world.simulation import Simulation


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    ids = simulation.cameras.segmentation
    of_cosys: set[int] = set()  # clients that list instances, as only those of Cosys-AirSim do

    def instances(caller: Caller) -> list[str]:
        of_cosys.add(caller.number)
        return list(ids.names[1:])

    mesh = Parameter("mesh_name", TEXT)
    return [
        method(
            "simSetSegmentationObjectID",
            ids.set,
            mesh,
            Parameter("object_id", INT),
            optional("is_name_regex", BOOL, False),
        ),
        method(
            "simGetSegmentationObjectID",
            lambda caller, name: ids.of(name, caller.number in of_cosys),
            mesh,
            with_caller=True,
        ),
        method("simListInstanceSegmentationObjects", instances, with_caller=True),
    ]
