"""Descriptions of the sensors in mav0: headers of the tables, each sensor's sensor.yaml, and the radar's chirp."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from hil.apps.dataset.formats import euroc
from hil.apps.dataset.formats.pictures import FARTHER, NOTHING, palette_csv
from hil.apps.dataset.formats.radar_npy import CONFIG_NAME, radar_json
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.tables import TABLES, TRUTH, other_truth
from hil.config import SensorConfig
from hil.config.sensors.radar_checks import view_of
from hil.run.recorder.frame_description import FrameDescription
from hil.run.sensors.simulated_sensors import transform
from signals.classes import Classes
from signals.samples import CHANNEL_UNITS, RADAR_UNITS, SkySample
from sim.frame.mount import Mount
from sim.sensors.catalog import KINDS, PRESETS
from sim.sensors.radar_parameters import RadarParameters

CLASSES_NAME = "classes.csv"
_COMMENTS = {
    "rgb": "colour, 8-bit RGB PNG",
    "depth": "distance along the optical axis, 16-bit PNG in steps of depth_step_m",
    "segmentation": "class ids, 8-bit PNG; names: ../classes.csv",
    "instance": "instance ids, 16-bit PNG",
    "normal": "unit normal in the camera's frame as floor(127 n + 128.5), RGB PNG; 0 0 0: nothing",
}
# Keys of a sensor.yaml and the parameters they hold. Other kinds list every numeric parameter by its own name.
_SENSOR_KEYS: dict[str, dict[str, str]] = {
    "lidar": {k: k for k in ("range_noise_m", "range_resolution_m", "min_range_m", "max_range_m", "rolling")},
    "imu": {
        "gyroscope_noise_density": "gyro_noise_radps_per_rthz",
        "gyroscope_random_walk": "gyro_walk_radps2_per_rthz",
        "accelerometer_noise_density": "accel_noise_mps2_per_rthz",
        "accelerometer_random_walk": "accel_walk_mps3_per_rthz",
    },
}


def headers(plan: DatasetPlan) -> dict[str, str]:
    """Return the first line of each data.csv, by folder in mav0."""
    lines = {TRUTH: euroc.TRUTH_HEADER}
    lines |= {other_truth(name): euroc.TRUTH_HEADER for name in plan.other_vehicles}
    for name, sensor in plan.flight_sensors.items():
        lines[plan.folder(name)] = TABLES[KINDS[sensor.kind].sample_type][0]
    lines |= dict.fromkeys(_skies(plan).values(), TABLES[SkySample][0])
    for name, sensor in plan.frame_sensors.items():
        parts = KINDS[sensor.kind].parts
        for channel in getattr(sensor.parameters, parts) if parts else ("",):
            lines[plan.folder(name, channel)] = euroc.FILE_HEADER
    return lines


def flight_folders(plan: DatasetPlan) -> dict[str, str]:
    """Return the folder in mav0 of each port whose samples are taken in the flight."""
    return {name: plan.folder(name) for name in plan.flight_sensors} | _skies(plan)


def _skies(plan: DatasetPlan) -> dict[str, str]:
    """Return the folder of the sky of each GPS that sees it, by its port."""
    return {
        f"{name}/sky": f"sky{plan.numbers[name]}"
        for name, sensor in plan.flight_sensors.items()
        if getattr(sensor.parameters, "sky", None) is not None
    }


def sensor_files(plan: DatasetPlan, classes: Classes) -> dict[str, str]:
    """Return the text of each description file, by its path in the tree."""
    vehicle = f"{plan.vehicle}, {plan.config.vehicle}" if plan.vehicle else plan.config.vehicle
    body = f"{vehicle}, simulated; x forward, y left, z up"
    texts = {
        f"{euroc.ROOT}/body.yaml": f"comment: {json.dumps(body)}\n",
        f"{euroc.ROOT}/{CLASSES_NAME}": palette_csv(classes.names, classes.colours),
    }
    state = "the simulator's state"
    for folder, comment in {TRUTH: state, **{other_truth(n): f"{state} of {n}" for n in plan.other_vehicles}}.items():
        texts[f"{euroc.ROOT}/{folder}/sensor.yaml"] = euroc.sensor_yaml(
            "ground_truth", comment=comment, T_BS=euroc.IDENTITY, rate_hz=float(plan.config.tick_hz)
        )
    makers = {"camera": _camera, "radar": _radar}
    for name, sensor in plan.config.sensors.items():
        files = makers.get(sensor.kind, _other_sensor)(plan, name, sensor)
        texts |= {f"{euroc.ROOT}/{path}": text for path, text in files.items()}
    return texts


def _description(name: str, sensor: SensorConfig) -> str:
    preset = PRESETS.get(sensor.preset) if sensor.preset is not None else None
    return f"{name}: {preset.part}" if preset is not None else f"{name}: simulated {sensor.kind}"


def _mount(p: Any) -> Mount:
    """Return the mount of a sensor without an optical frame. One without angles has the axes of the vehicle."""
    origin = (0.0, 0.0, 0.0)
    return Mount(getattr(p, "mount_m", origin), getattr(p, "mount_rpy_deg", origin), optical=False)


def flight_mounts(plan: DatasetPlan) -> dict[str, FrameDescription]:
    """Return the descriptions of the flight sensors whose mount has angles, by name."""
    mounts = {
        name: _mount(sensor.parameters)
        for name, sensor in plan.flight_sensors.items()
        if hasattr(sensor.parameters, "mount_rpy_deg")
    }
    return {name: FrameDescription(name, mount.p_BC, mount.q_BC) for name, mount in mounts.items()}


def _camera(plan: DatasetPlan, name: str, sensor: SensorConfig) -> dict[str, str]:
    p = sensor.parameters
    mount = Mount(p.mount_m, p.mount_rpy_deg)
    T_BS = transform(mount.p_BC, mount.q_BC)
    files = {}
    for channel in p.channels:
        unit, frame = CHANNEL_UNITS[channel]
        more: dict[str, object] = {"channel": channel, "unit": unit, "frame": frame}
        if channel == "depth":
            step_m = plan.config.dataset.depth_step_m
            more = {"depth_step_m": step_m, "nothing": NOTHING, "farther": FARTHER, **more}
        noise = p.noise if channel == "rgb" else p.depth_noise if channel == "depth" else None
        if noise is not None:
            more["noise"] = noise.model_dump(mode="json")
        text = euroc.picture_yaml(
            p.model(),
            "camera" if channel == "rgb" else channel,
            comment=f"{_description(name, sensor)}: {_COMMENTS.get(channel, channel + ', numpy')}",
            T_BS=T_BS,
            rate_hz=sensor.rate_hz,
            more=more,
        )
        files[f"{plan.folder(name, channel)}/sensor.yaml"] = text
    return files


def _radar(plan: DatasetPlan, name: str, sensor: SensorConfig) -> dict[str, str]:
    p: RadarParameters = sensor.parameters
    view = p.view() if p.frame is None else view_of(plan.config.sensors[p.frame])
    mount = Mount(view.mount_m, view.mount_rpy_deg, optical=False)
    files = {}
    for channel in p.outputs:
        unit, _ = RADAR_UNITS[channel]
        more = {"channel": channel, "unit": unit, "config": CONFIG_NAME}
        folder = plan.folder(name, channel)
        files[f"{folder}/sensor.yaml"] = euroc.sensor_yaml(
            "radar",
            comment=f"{_description(name, sensor)}; data/*.npy",
            T_BS=transform(mount.p_BC, mount.q_BC),
            rate_hz=sensor.rate_hz,
            more=more,
        )
        files[f"{folder}/{CONFIG_NAME}"] = radar_json(p.chirp, p.antenna.array, rate_hz=sensor.rate_hz)
    return files


def _other_sensor(plan: DatasetPlan, name: str, sensor: SensorConfig) -> dict[str, str]:
    p, mount, comment = sensor.parameters, _mount(sensor.parameters), _description(name, sensor)
    T_BS = transform(mount.p_BC, mount.q_BC)
    if KINDS[sensor.kind].sweeps:
        comment += "; data/*.bin: float32 x, y, z [m], intensity; labels/*.label: uint32, class and instance"
    elif sensor.kind == "imu":
        T_BS = transform(p.lever_arm_m, (1.0, 0.0, 0.0, 0.0))
    keys = _SENSOR_KEYS.get(sensor.kind)
    more = {key: getattr(p, source) for key, source in keys.items()} if keys else _numbers(p.model_dump(mode="json"))
    text = euroc.sensor_yaml(sensor.kind, comment=comment, T_BS=T_BS, rate_hz=sensor.rate_hz, more=more)
    return {f"{plan.folder(name)}/sensor.yaml": text}


def _numbers(values: Mapping[str, Any]) -> dict[str, int | float]:
    return {k: v for k, v in values.items() if isinstance(v, int | float) and not isinstance(v, bool)}
