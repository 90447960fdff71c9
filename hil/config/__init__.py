"""Typed settings of a bench, read from bench, rig, mission and sensor files.

`load_bench` reads and checks a whole bench and reports every problem at once, each with its file and line.
"""

import hil.own_packages  # noqa: F401 (before every import of a package beside hil)
from hil.config.bench import Bench, site_of
from hil.config.load import load_bench
from hil.config.saved import resolved_yaml, save_bench
from hil.config.schema import BenchConfig, SensorConfig

__all__ = ["Bench", "BenchConfig", "SensorConfig", "load_bench", "resolved_yaml", "save_bench", "site_of"]
