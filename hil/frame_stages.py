"""Cameras and LiDARs in the wiring of a bench: one stage per channel, so that what nobody reads is not drawn.

A camera `front` with the channels rgb and depth is the stages `front/rgb` and `front/depth`; its samples hold the
channels that the plan kept. A LiDAR is one stage.
"""

from __future__ import annotations

from typing import Any

from hil.config import BenchConfig, SensorConfig
from hil.recorder.frame_description import FrameDescription, Projection
from hil.signals.samples import ImageSample, Quat, TruthState, Vec3
from hil.stages import Port, StagePlan, StageSpec
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.camera_model import CameraModel
from sim.sensors.catalog import KINDS

_TRUTH = Port("truth", TruthState)


def output_ports(name: str, sensor: SensorConfig) -> tuple[Port, ...]:
    """What a sensor can deliver: a port per channel of a camera, one of any other sensor."""
    kind = KINDS[sensor.kind].sample_type
    if kind is ImageSample:
        return tuple(Port(f"{name}/{channel}", ImageSample) for channel in sensor.parameters.channels)
    return (Port(name, kind),)


def sensor_stages(config: BenchConfig) -> list[StageSpec]:
    """The stages of all sensors, in the order of the bench file."""
    return [
        StageSpec(port.name, inputs=(_TRUTH,), outputs=(port,))
        for name, sensor in config.sensors.items()
        for port in output_ports(name, sensor)
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


def wanted_channels(name: str, sensor: SensorConfig, plan: StagePlan) -> tuple[str, ...] | None:
    """The channels of a camera that the plan kept, in the order of the bench file; None for any other sensor."""
    ports = output_ports(name, sensor)
    if ports[0].type is not ImageSample:
        return None
    return tuple(port.name.removeprefix(f"{name}/") for port in ports if port.name in plan.order)


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
        and "rgb" in (wanted_channels(name, sensor, plan) or ())
        for name, sensor in config.sensors.items()
    )


def description(name: str, sensor: Any) -> FrameDescription:
    """What the recording says about a camera or LiDAR. `sensor` tells by its `mount` and, a camera, its `model`."""
    camera = getattr(sensor, "model", None)
    mount = getattr(sensor, "mount", None)
    p_BC: Vec3 = getattr(mount, "p_BC", (0.0, 0.0, 0.0))
    q_BC: Quat = getattr(mount, "q_BC", (1.0, 0.0, 0.0, 0.0))
    if not isinstance(camera, CameraModel):
        return FrameDescription(name, p_BC, q_BC, None)
    projection = Projection(
        camera.width,
        camera.height,
        distortion_name(camera),
        coefficients(camera),
        camera.opencv_matrix,
        projection_matrix(camera),
    )
    return FrameDescription(f"{name}_optical", p_BC, q_BC, projection)
