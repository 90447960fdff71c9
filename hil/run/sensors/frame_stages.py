"""Declares the stages of a bench and their ports. `plan_stages` drops the stages without a consumer.

Cameras and radars have one stage per channel, so that only the channels with a consumer are computed. A camera `front`
with the channels rgb and depth has the stages `front/rgb` and `front/depth`, and its samples hold the channels that the
plan kept. A radar has one stage per output, such as `radar/raw` and `radar/points`. A LiDAR is one stage.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from hil.config import Bench, BenchConfig, SensorConfig
from hil.run.loop.stages import Port, StagePlan, StageSpec
from hil.run.recorder.frame_description import FrameDescription, Projection, Sweep
from signals.samples import ActuatorFrame, TruthState
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.camera_model import CameraModel
from sim.frame.source import SharedFrames
from sim.radar.chirp import Chirp
from sim.sensors.catalog import KINDS

TRUTH = "truth"
_TRUTH = Port(TRUTH, TruthState)
_ACTUATORS = Port("actuators", ActuatorFrame)


def output_ports(name: str, sensor: SensorConfig) -> tuple[Port, ...]:
    """Return the output ports of a sensor: one per channel of a camera or output of a radar, otherwise one."""
    kind = KINDS[sensor.kind]
    if kind.parts is None:
        return (Port(name, kind.sample_type),)
    return tuple(Port(f"{name}/{part}", kind.sample_type) for part in getattr(sensor.parameters, kind.parts))


def available_ports(config: BenchConfig) -> dict[str, Port]:
    """Return topic -> port of the streams that companion clients can subscribe to: the true state and every sensor."""
    ports = {port.name: port for name, sensor in config.sensors.items() for port in output_ports(name, sensor)}
    return {TRUTH: _TRUTH} | ports


def stage_specs(config: BenchConfig, topics: Collection[str] = ()) -> list[StageSpec]:
    """Return the stages of a bench: physics -> sensors -> autopilot -> (one tick later) physics.

    The recorder consumes all recorded ports, the companion its `topics`.
    """
    to_autopilot = tuple(
        port for name in config.autopilot_sensors().values() for port in output_ports(name, config.sensors[name])
    )
    ports = available_ports(config)
    companion = [StageSpec("companion", inputs=tuple(ports[topic] for topic in sorted(topics)), sink=True)]
    return [
        StageSpec("physics", delayed_inputs=(_ACTUATORS,), outputs=(_TRUTH,)),
        *(StageSpec(name, inputs=(_TRUTH,), outputs=(port,)) for name, port in ports.items() if name != TRUTH),
        StageSpec("autopilot", inputs=to_autopilot, outputs=(_ACTUATORS,), sink=True),
        StageSpec("recorder", inputs=(_TRUTH, *recorded_ports(config), _ACTUATORS), sink=True),
        *(companion if topics else ()),
    ]


def recorded_ports(config: BenchConfig) -> tuple[Port, ...]:
    """Return the sensor ports that the recorder consumes."""
    if not config.record.mcap:
        return ()
    return tuple(
        port
        for name, sensor in config.sensors.items()
        if config.record.images or not KINDS[sensor.kind].needs_frames
        for port in output_ports(name, sensor)
    )


def wanted_parts(name: str, sensor: SensorConfig, plan: StagePlan) -> dict[str, tuple[str, ...]]:
    """Return the parameter that lists the sensor's channels or outputs -> those that the plan kept. Others: empty."""
    parts = KINDS[sensor.kind].parts
    if parts is None:
        return {}
    kept = [port.name for port in output_ports(name, sensor) if port.name in plan.order]
    return {parts: tuple(port.removeprefix(f"{name}/") for port in kept)}


def is_wanted(name: str, sensor: SensorConfig, plan: StagePlan) -> bool:
    """Return True if the plan kept any output of the sensor."""
    return any(port.name in plan.order for port in output_ports(name, sensor))


def needs_frames(config: BenchConfig, plan: StagePlan | None = None) -> bool:
    """Return True if a sensor needs the world's geometry. With a plan, only sensors in the plan count."""
    return any(
        KINDS[sensor.kind].needs_geometry(sensor.parameters) and (plan is None or is_wanted(name, sensor, plan))
        for name, sensor in config.sensors.items()
    )


def uses_other_renderer(config: BenchConfig, plan: StagePlan) -> bool:
    """Return True if a camera's colour comes from a renderer whose pictures differ between machines."""
    return any(
        getattr(sensor.parameters, "colour", "native") != "native"
        and "rgb" in wanted_parts(name, sensor, plan).get("channels", ())
        for name, sensor in config.sensors.items()
    )


def description(name: str, sensor: Any) -> FrameDescription:
    """Return the description of a sensor with a mount; a camera also has a `model`, a radar a `chirp`."""
    camera = getattr(sensor, "model", None)
    p_BC, q_BC = sensor.mount.p_BC, sensor.mount.q_BC
    chirp = getattr(sensor, "chirp", None)
    if isinstance(chirp, Chirp):
        sweep = Sweep(chirp.center_frequency_hz, chirp.bandwidth_hz, chirp.sample_rate_hz, chirp.repetition_s)
        return FrameDescription(name, p_BC, q_BC, sweep=sweep)
    if not isinstance(camera, CameraModel):
        return FrameDescription(name, p_BC, q_BC, sweep_ns=getattr(sensor, "sweep_ns", 0))
    projection = Projection(
        camera.width,
        camera.height,
        distortion_name(camera),
        coefficients(camera),
        camera.opencv_matrix,
        projection_matrix(camera),
    )
    return FrameDescription(f"{name}_optical", p_BC, q_BC, projection)


def make_frames(bench: Bench) -> SharedFrames:
    """Return the geometry for cameras, LiDARs and radars. Raises ConfigError if the scene's map is invalid."""
    from sim.world_loader import load_world  # loaded only for benches that need a map

    return SharedFrames(load_world(bench.scene))
