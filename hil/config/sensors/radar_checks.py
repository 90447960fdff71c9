"""Checks of radars against the rest of the bench: the camera they read, their rate, and their masks."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from hil.config.layers import Settings
from hil.config.schema import BenchConfig, SensorConfig
from signals.documents.validate import at, nearest
from signals.errors import ConfigError, Problem
from sim.frame.shared_picture import SharedPicture
from sim.radar.scatterers import Scatterers
from sim.scene.scene import Scene
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.radar import max_frames_hz
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world


def radars(sensors: Mapping[str, SensorConfig]) -> dict[str, RadarParameters]:
    """Return the radars of a bench in the order of the file."""
    return {name: s.parameters for name, s in sensors.items() if isinstance(s.parameters, RadarParameters)}


def view_of(sensor: SensorConfig) -> SharedPicture:
    """Return the picture that a camera shares with its radars. Raises TypeError for any other sensor."""
    p = sensor.parameters
    if not isinstance(p, CameraParameters):
        raise TypeError(f"a {sensor.kind} has no pictures")
    return SharedPicture(p.model(), mount_m=p.mount_m, mount_rpy_deg=p.mount_rpy_deg, near_m=p.near_m, far_m=p.far_m)


def rate_problems(name: str, parameters: RadarParameters, rate_hz: float, settings: Settings) -> list[Problem]:
    """Report a rate at which frames would overlap, or that the board cannot capture."""
    frame_s = parameters.chirp.frame_s
    if frame_s * rate_hz <= 1.0:
        board, receivers = parameters.board, len(parameters.antenna.rx_positions_m)
        too_much = "" if board is None else board.capture_problem(parameters.chirp, receivers, rate_hz)
        return [at(settings, ("sensors", name, "rate_hz"), too_much)] if too_much else []
    message = (
        f"leaves {1.0 / rate_hz:.6g} s for a frame that takes {frame_s:.6g} s "
        f"({parameters.chirp.chirps} chirps every {parameters.chirp.repetition_s:.6g} s)"
    )
    hint = f"{max_frames_hz(parameters):g} Hz at most, or fewer chirps"
    return [at(settings, ("sensors", name, "rate_hz"), message, hint)]


def frame_problems(sensors: Mapping[str, SensorConfig], broken: Collection[str], settings: Settings) -> list[Problem]:
    """Report radars whose `frame` is not a camera. `broken`: sensors with problems of their own."""
    problems = []
    cameras = [name for name, sensor in sensors.items() if sensor.kind == "camera"]
    for name, parameters in radars(sensors).items():
        frame, place = parameters.frame, ("sensors", name, "frame")
        if frame is None or frame in cameras or frame in broken:
            continue
        if frame in sensors:
            message = f"is {frame!r}, a {sensors[frame].kind} and no camera"
        else:
            message = f"is unknown: {frame!r}"
        hint = nearest(frame, cameras) if cameras else "this bench has no camera: give the radar a view of its own"
        problems.append(at(settings, place, message, hint))
    return problems


def world_problems(config: BenchConfig, scene: Scene, settings: Settings) -> list[Problem]:
    """Report masks that leave no pixel, or only classes that this scene does not have."""
    problems = []
    for name, p in radars(config.sensors).items():
        if p.frame is not None and getattr(config.sensors.get(p.frame), "kind", "") != "camera":
            continue  # reported by frame_problems
        view = p.view() if p.frame is None else view_of(config.sensors[p.frame])
        try:
            Scatterers(view.camera, load_world(scene), p.chirp, p.antenna, p.receiver, p.mask)
        except ConfigError as error:
            problems += error.problems
        except ValueError as error:
            message = str(error).removeprefix("mask: ").removeprefix("mask.")
            problems.append(at(settings, ("sensors", name, "mask"), f": {message}"))
    return problems
