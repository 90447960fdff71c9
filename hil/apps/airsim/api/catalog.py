"""All groups of methods of the server. A new group is a file with a function `methods(simulation)`, and a line here."""

from __future__ import annotations

from collections.abc import Callable

from hil.apps.airsim.api import (
    cameras,
    control,
    drawings,
    environment,
    images,
    labels,
    objects,
    recording,
    sensors,
    session,
    state,
)
from hil.apps.airsim.rpc.methods import Method, MethodTable
from hil.apps.airsim.simulation import Simulation

GROUPS: tuple[Callable[[Simulation], list[Method]], ...] = (
    session.methods,
    control.methods,
    state.methods,
    sensors.methods,
    images.methods,
    cameras.methods,
    labels.methods,
    recording.methods,
    environment.methods,
    drawings.methods,
    objects.methods,
)


def method_table(simulation: Simulation) -> MethodTable:
    """Return all methods of a server."""
    return MethodTable(method for group in GROUPS for method in group(simulation))
