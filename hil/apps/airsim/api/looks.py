"""Methods that change textures and lights, which a scene keeps: each says once that it does nothing."""

from __future__ import annotations

from typing import Any

from hil.apps.airsim.rpc.arguments import BOOL, FLOAT, INT, NAME, TEXT
from hil.apps.airsim.rpc.methods import Method, Parameter, method, optional
from hil.apps.airsim.simulation import Simulation

_TEXTURES = "a scene keeps its materials; --scene and random appearances of the bench give other ones"
_LIGHTS = "no scene has lights that can be switched; simSetTimeOfDay moves the sun"


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    told: set[str] = set()  # methods that were logged

    def not_here(name: str, reason: str, result: Any) -> Any:
        if name not in told:
            told.add(name)
            simulation.log(f"{name} does nothing: {reason}")
        return result

    name = Parameter("object_name", NAME)
    component, light = optional("component_id", INT, 0), Parameter("light_name", TEXT)
    return [
        method(
            "simSwapTextures",
            lambda *_: not_here("simSwapTextures", _TEXTURES, []),
            Parameter("tag", TEXT),
            optional("tex_id", INT, 0),
            component,
            optional("material_id", INT, 0),
        ),
        method(
            "simSetObjectMaterial",
            lambda *_: not_here("simSetObjectMaterial", _TEXTURES, False),
            name,
            Parameter("material_name", TEXT),
            component,
        ),
        method(
            "simSetObjectMaterialFromTexture",
            lambda *_: not_here("simSetObjectMaterialFromTexture", _TEXTURES, False),
            name,
            Parameter("texture_path", TEXT),
            component,
        ),
        *(
            method(each, lambda *_, each=each: not_here(each, _LIGHTS, False), light, Parameter("intensity", FLOAT))
            for each in ("simSetLightIntensity", "simSetWorldLightIntensity")
        ),
        method(
            "simSetWorldLightVisibility",
            lambda *_: not_here("simSetWorldLightVisibility", _LIGHTS, False),
            light,
            optional("is_visible", BOOL, True),
        ),
        method(
            "simSetVehicleLightIntensity",
            lambda *_: not_here("simSetVehicleLightIntensity", _LIGHTS, False),
            Parameter("vehicle_name", TEXT),
            light,
            Parameter("intensity", FLOAT),
        ),
        method(
            "simSetVehicleLightVisibility",
            lambda *_: not_here("simSetVehicleLightVisibility", _LIGHTS, False),
            Parameter("vehicle_name", TEXT),
            light,
            optional("is_visible", BOOL, True),
        ),
    ]
