"""Configuration: strict, every problem at once, each with file and line. `load_bench` is the way in."""

from hil.config.load import Bench, load_bench, resolved_yaml, save_bench, site_of
from hil.config.schema import BenchConfig, SensorConfig

__all__ = ["Bench", "BenchConfig", "SensorConfig", "load_bench", "resolved_yaml", "save_bench", "site_of"]
