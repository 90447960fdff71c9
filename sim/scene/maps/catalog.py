"""Map generators that a scene file may name: one file and one line here for each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from signals.documents.validate import StrictModel
from sim.scene.maps import (
    airsim_nh,
    airstrip,
    blocks,
    city_park,
    landscape_mountains,
    radar_range,
    training_village,
    urban_delivery,
)
from sim.scene.scene_map import SceneMap


@dataclass(frozen=True)
class Generator:
    """Map generator. `generate(parameters, seed)` is a pure function of its arguments."""

    parameters: type[StrictModel]
    generate: Callable[[Any, int], SceneMap]


GENERATORS: dict[str, Generator] = {
    "city_park": Generator(city_park.CityParkParameters, city_park.generate),
    "urban_delivery": Generator(urban_delivery.UrbanDeliveryParameters, urban_delivery.generate),
    "training_village": Generator(training_village.TrainingVillageParameters, training_village.generate),
    "radar_range": Generator(radar_range.RadarRangeParameters, radar_range.generate),
    "blocks": Generator(blocks.BlocksParameters, blocks.generate),
    "airsim_nh": Generator(airsim_nh.AirSimNHParameters, airsim_nh.generate),
    "airstrip": Generator(airstrip.AirstripParameters, airstrip.generate),
    "landscape_mountains": Generator(landscape_mountains.LandscapeMountainsParameters, landscape_mountains.generate),
}
