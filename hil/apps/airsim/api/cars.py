"""Methods that drive cars, of which there are none here."""

from __future__ import annotations

from typing import Any, NoReturn

from hil.apps.airsim.api.session import VEHICLE
from hil.apps.airsim.rpc.arguments import Type
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method
from hil.apps.airsim.simulation import Simulation

_ANYTHING = Type("anything", lambda value: value)


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def refused(*_: Any) -> NoReturn:
        known = ", ".join(simulation.drones)
        raise RpcError(f"there are no cars here; the vehicles are {known}: take MultirotorClient, not CarClient")

    return [
        method("setCarControls", refused, Parameter("controls", _ANYTHING), VEHICLE),
        method("getCarControls", refused, VEHICLE),
        method("getCarState", refused, VEHICLE),
    ]
