"""Gymnasium environments of the bench. `import hil.gym` registers them (docs/gym.md).

    hil/Hover-v0       hold a position
    hil/Waypoints-v0   fly through waypoints
    hil/Explore-v0     fly to a goal between obstacles, by LiDAR or depth pictures
    hil/Bench-v0       any bench file: its ports are the observation, reward and end are functions of the user

This package and its classes are a public interface. It needs the extra `gym`.
"""

from __future__ import annotations

try:
    import gymnasium
except ImportError as error:
    raise ImportError("hil.gym needs gymnasium, which is missing: pip install 'hil-bench[gym]'") from error

import hil.own_packages  # noqa: F401 (before every import of a package beside hil)
from hil.gym.env import FlightEnv
from hil.gym.registration import IDS, register_all
from hil.gym.transition import Transition
from hil.gym.vector_env import FlightVectorEnv

__all__ = ["IDS", "FlightEnv", "FlightVectorEnv", "Transition", "gymnasium"]

register_all()
