"""All groups of methods of the server. A new group is a file with a function `methods(simulation)`, and a line here."""

from __future__ import annotations

from collections.abc import Callable

from hil.apps.airsim.api import (
    attitude,
    cameras,
    cars,
    control,
    drawings,
    environment,
    geometry,
    images,
    inventory,
    labels,
    looks,
    objects,
    ranging,
    recording,
    sensors,
    session,
    state,
    sticks,
)
from hil.apps.airsim.rpc.methods import Method, MethodTable
from hil.apps.airsim.simulation import Simulation

GROUPS: tuple[Callable[[Simulation], list[Method]], ...] = (
    session.methods,
    control.methods,
    attitude.methods,
    sticks.methods,
    state.methods,
    sensors.methods,
    ranging.methods,
    images.methods,
    cameras.methods,
    labels.methods,
    recording.methods,
    environment.methods,
    drawings.methods,
    objects.methods,
    inventory.methods,
    geometry.methods,
    looks.methods,
    cars.methods,
)


# Answered also during a long call: they need nothing of the world.
_FREE = frozenset({"ping", "getServerVersion", "getMinRequiredClientVersion"})
# These wait for the world with all objects, if it must be made anew.
_SEEING = frozenset(
    {
        *("simGetImages", "simGetImage", "simGetDetections", "getLidarData", "getDistanceSensorData", "getRadarData"),
        *("simTestLineOfSightToPoint", "simTestLineOfSightBetweenPoints"),
        *("simGetWorldExtents", "simGetMeshPositionVertexBuffers"),
    }
)


def method_table(simulation: Simulation) -> MethodTable:
    """Return all methods of a server."""
    frames = simulation.frames

    def marked(method: Method) -> Method:
        if method.name in _FREE:
            return method._replace(is_free=True)
        if method.name not in _SEEING:
            return method
        is_long = method.is_long
        return method._replace(is_long=lambda *arguments: not frames.is_made or is_long(*arguments))

    methods = [marked(method) for group in GROUPS for method in group(simulation)]
    return MethodTable(methods, simulation.lock)
