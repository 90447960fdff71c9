"""What clients can subscribe to: the ports of the bench, and the true state."""

from __future__ import annotations

from hil.config import BenchConfig
from hil.frame_stages import output_ports
from hil.signals.samples import TruthState
from hil.stages import Port

TRUTH = "truth"


def available_ports(config: BenchConfig) -> dict[str, Port]:
    """Topic -> port, of everything that clients may have."""
    ports = {port.name: port for name, sensor in config.sensors.items() for port in output_ports(name, sensor)}
    return {TRUTH: Port(TRUTH, TruthState)} | ports
