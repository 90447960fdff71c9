"""The stages of a bench and what flows between them, for `plan_stages` to find out what nobody needs.

Cameras, LiDARs and radars have one stage per channel, so that what nobody reads is not made.

A camera `front` with the channels rgb and depth is the stages `front/rgb` and `front/depth`; its samples hold the
channels that the plan kept. So it is with the outputs of a radar: `radar/raw`, `radar/points`. A LiDAR is one stage.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from hil.config import Bench, BenchConfig, SensorConfig
from hil.recorder.frame_description import FrameDescription, Projection, Sweep
from hil.signals.samples import ActuatorFrame, Quat, TruthState, Vec3
from hil.stages import Port, StagePlan, StageSpec
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.camera_model import CameraModel
from sim.frame.source import FrameSource, SharedFrames
from sim.radar.chirp import Chirp
from sim.sensors.catalog import KINDS

TRUTH = "truth"
_TRUTH = Port(TRUTH, TruthState)
_ACTUATORS = Port("actuators", ActuatorFrame)


def output_ports(name: str, sensor: SensorConfig) -> tuple[Port, ...]:
    """What a sensor can deliver: a port per channel of a camera or output of a radar, one of any other sensor."""
    kind = KINDS[sensor.kind]
    if kind.parts is None:
        return (Port(name, kind.sample_type),)
    return tuple(Port(f"{name}/{part}", kind.sample_type) for part in getattr(sensor.parameters, kind.parts))


def available_ports(config: BenchConfig) -> dict[str, Port]:
    """Topic -> port, of everything that a companion's clients can subscribe to: the true state and every sensor."""
    ports = {port.name: port for name, sensor in config.sensors.items() for port in output_ports(name, sensor)}
    return {TRUTH: _TRUTH} | ports


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
        *(StageSpec(name, inputs=(_TRUTH,), outputs=(port,)) for name, port in ports.items() if name != TRUTH),
        StageSpec("autopilot", inputs=to_autopilot, outputs=(_ACTUATORS,), sink=True),
        StageSpec("recorder", inputs=(_TRUTH, *recorded_ports(config), _ACTUATORS), sink=True),
        *(companion if topics else ()),
    ]


def recorded_ports(config: BenchConfig) -> tuple[Port, ...]:
    """What the recorder wants."""
    if not config.record.mcap:
        return ()
    return tuple(
        port
        for name, sensor in config.sensors.items()
        if config.record.images or not KINDS[sensor.kind].needs_frames
        for port in output_ports(name, sensor)
    )


def wanted_parts(name: str, sensor: SensorConfig, plan: StagePlan) -> dict[str, tuple[str, ...]]:
    """Of a sensor whose samples have parts: its parameter that lists them, with those that the plan kept, in order."""
    parts = KINDS[sensor.kind].parts
    if parts is None:
        return {}
    kept = [port.name for port in output_ports(name, sensor) if port.name in plan.order]
    return {parts: tuple(port.removeprefix(f"{name}/") for port in kept)}


def is_wanted(name: str, sensor: SensorConfig, plan: StagePlan) -> bool:
    """Whether anything of a sensor is."""
    return any(port.name in plan.order for port in output_ports(name, sensor))


def needs_frames(config: BenchConfig, plan: StagePlan | None = None) -> bool:
    """Whether a sensor looks at the world's geometry; with a plan, one that it kept."""
    return any(
        KINDS[sensor.kind].needs_frames and (plan is None or is_wanted(name, sensor, plan))
        for name, sensor in config.sensors.items()
    )


def draws_elsewhere(config: BenchConfig, plan: StagePlan) -> bool:
    """Whether a camera's colour comes from a renderer whose pictures differ between machines."""
    return any(
        getattr(sensor.parameters, "colour", "native") != "native"
        and "rgb" in wanted_parts(name, sensor, plan).get("channels", ())
        for name, sensor in config.sensors.items()
    )


def description(name: str, sensor: Any) -> FrameDescription:
    """What the recording says about a camera, LiDAR or radar. `sensor` tells by its `mount`, `model`, `chirp`."""
    camera = getattr(sensor, "model", None)
    mount = getattr(sensor, "mount", None)
    p_BC: Vec3 = getattr(mount, "p_BC", (0.0, 0.0, 0.0))
    q_BC: Quat = getattr(mount, "q_BC", (1.0, 0.0, 0.0, 0.0))
    chirp = getattr(sensor, "chirp", None)
    if isinstance(chirp, Chirp):
        sweep = Sweep(chirp.center_frequency_hz, chirp.bandwidth_hz, chirp.sample_rate_hz, chirp.repetition_s)
        return FrameDescription(name, p_BC, q_BC, sweep=sweep)
    if not isinstance(camera, CameraModel):
        return FrameDescription(name, p_BC, q_BC)
    projection = Projection(
        camera.width,
        camera.height,
        distortion_name(camera),
        coefficients(camera),
        camera.opencv_matrix,
        projection_matrix(camera),
    )
    return FrameDescription(f"{name}_optical", p_BC, q_BC, projection)


def make_frames(bench: Bench) -> FrameSource:
    """The geometry that cameras and LiDARs look at. Raises ConfigError where the scene's map is wrong."""
    from sim.scene.world import load_world  # benches without such sensors need no map

    return SharedFrames(load_world(bench.scene))
