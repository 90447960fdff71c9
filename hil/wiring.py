"""The stages of a bench and what flows between them, for `plan_stages` to find out what nobody needs."""

from __future__ import annotations

from collections.abc import Collection

from hil.companion.topics import available_ports
from hil.config import BenchConfig
from hil.frame_stages import output_ports, recorded_ports, sensor_stages
from hil.signals.samples import ActuatorFrame, TruthState
from hil.stages import Port, StageSpec

_TRUTH = Port("truth", TruthState)
_ACTUATORS = Port("actuators", ActuatorFrame)


def stage_specs(config: BenchConfig, topics: Collection[str] = ()) -> list[StageSpec]:
    """The wiring of a bench: physics -> sensors -> autopilot -> (one tick later) physics; the recorder reads all, the
    companion its `topics`."""
    to_autopilot = tuple(
        port for name in config.autopilot_sensors().values() for port in output_ports(name, config.sensors[name])
    )
    ports = available_ports(config)
    companion = [StageSpec("companion", inputs=tuple(ports[topic] for topic in sorted(topics)), sink=True)]
    return [
        StageSpec("physics", delayed_inputs=(_ACTUATORS,), outputs=(_TRUTH,)),
        *sensor_stages(config),
        StageSpec("autopilot", inputs=to_autopilot, outputs=(_ACTUATORS,), sink=True),
        StageSpec("recorder", inputs=(_TRUTH, *recorded_ports(config), _ACTUATORS), sink=True),
        *(companion if topics else ()),
    ]
