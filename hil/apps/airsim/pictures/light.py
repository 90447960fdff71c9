"""Light and air of the scene at the time of day and in the weather that clients set.

The sun stands where it is at the time of day and the place of the settings; the sky fades from 6 degrees above the
horizon to 6 degrees below it. Fog, rain, snow and dust shorten the view (hil/apps/airsim/world/surroundings.py).
"""

from __future__ import annotations

from datetime import timedelta
from typing import NamedTuple

from hil.apps.airsim.settings.surroundings import Origin
from hil.apps.airsim.world.surroundings import Surroundings
from signals.time import NS_PER_S
from sim.scene.light import Light
from sim.scene.scene import Scene
from sim.scene.sun_position import sun_position_deg

_NIGHT, _TWILIGHT_DEG = 0.04, 6.0


class LightState(NamedTuple):
    """All that the light of a picture depends on."""

    version: int
    step: int  # updates of the time of day


def light_state(around: Surroundings, t_ns: int) -> LightState:
    """Return the state; two equal ones have the same light."""
    moves = around.clock is not None and around.move_sun
    return LightState(around.version, (t_ns - around.clock_t_ns) // around.update_ns if moves else 0)


def present_light(scene: Scene, around: Surroundings, origin: Origin, t_ns: int) -> Light:
    """Return the light, with the extinction of the whole air as its fog."""
    light = scene.light
    changed: dict[str, object] = {"fog_per_m": min(around.present(scene).extinction_per_m, 1.0)}
    if around.clock is not None and around.move_sun:
        step_ns = (t_ns - around.clock_t_ns) // around.update_ns * around.update_ns
        since_s = step_ns * around.clock_speed / NS_PER_S
        try:
            time = around.clock + timedelta(seconds=since_s)
        except OverflowError:
            time = around.clock
        azimuth, elevation = sun_position_deg(time, origin.latitude_deg, origin.longitude_deg)
        day = min(max((elevation + _TWILIGHT_DEG) / (2.0 * _TWILIGHT_DEG), _NIGHT), 1.0)
        changed |= {"sun_azimuth_deg": azimuth, "sun_elevation_deg": elevation}
        for name in ("ambient_rgb", "sky_zenith_rgb", "sky_horizon_rgb"):
            changed[name] = tuple(day * component for component in getattr(light, name))
    return light.model_copy(update=changed)
