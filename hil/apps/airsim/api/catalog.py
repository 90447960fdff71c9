"""All groups of methods of the server: each is one file of this folder with a function `methods(simulation)`."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from hil.apps.airsim import api
from hil.apps.airsim.rpc.methods import Method, MethodTable
from hil.apps.airsim.simulation import Simulation

_MODULES = [import_module(f"{api.__name__}.{info.name}") for info in iter_modules(api.__path__)]
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

    groups = [module.methods(simulation) for module in _MODULES if hasattr(module, "methods")]
    methods = [marked(method) for group in groups for method in group]
    return MethodTable(methods, simulation.lock)
