"""Sources of radar frames for `hil radar`.

    RUN_DIR or run.mcap with a radar's raw data    the recorded frames
    RUN_DIR whose camera recorded range, normal,   frames made from these pictures with the run's seed; their bytes are
      material and radial_velocity                 those of a radar that uses the camera during the run
    .npz or .npy with its .json                    a recording of a real sensor, or of `hil radar` itself
    .bin                                           a capture of a TI board: dca1000_source.py

Each source gives its settings, the number of its frames, and the frames.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import BenchConfig, load_bench
from hil.config.layers import Settings, merge_options
from hil.config.sensors.preset_values import find_preset, merge_keys
from hil.config.sensors.radar_checks import view_of
from hil.run.recorder.reading import RecordedMessage, Recording
from hil.run.recorder.reading_frames import RADAR_FRAME, capture_ns, image, radar_frame
from hil.run_files import BENCH_NAME, MCAP_NAME
from signals.documents.validate import nearest, validate
from signals.documents.yaml_lines import parse_yaml
from signals.errors import ConfigError, Problem, RecordingError
from signals.samples import TruthState
from signals.time import NS_PER_S
from sim.frame.mount import Mount
from sim.radar.chirp import Chirp
from sim.radar.recording import load_recording
from sim.sensors.radar import RadarFrames
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world

LIVE_PRESET = "bgt60tr13c"
RECORDING_PRESET = "bgt60tr13c_wideband"
_ARRAYS = (".npz", ".npy")
_DEFAULT_PERIOD_S = 0.1  # for recordings without a frame period
_NEEDED = ("range", "normal", "material", "radial_velocity")
_ZERO = (0.0, 0.0, 0.0)
_MAX_LATENCY_NS = 10 * NS_PER_S  # maximum delay of a picture after its capture


class Frame(NamedTuple):
    """One frame, its middle at `t_ns`; `raw` is (channels, chirps, samples) in ADC counts."""

    t_ns: int
    raw: NDArray[np.uint16]


@dataclass(frozen=True)
class Source:
    """Frames of one radar, read or made one by one.

    `camera` names the recording and topic of the colour pictures taken along the radar's view, if there are any.
    """

    description: str  # for titles
    parameters: RadarParameters
    count: int
    from_pictures: bool  # True: frames are made from pictures
    frames: Iterator[Frame]
    camera: tuple[Recording, str] | None = None
    part: str = "radar"  # preset of the device, where it is known


def pictures_at(source: Source, times_ns: Container[int]) -> dict[int, NDArray[np.uint8]]:
    """Return the recorded colour pictures of exactly these times, by time; (height, width, 3) each."""
    if source.camera is None:
        return {}
    recording, topic = source.camera
    pictures = (image(message) for message in recording.messages() if message.topic == topic)
    return {t_ns: np.asarray(rgb, np.uint8) for t_ns, rgb in pictures if t_ns in times_ns}


def _colour_topic(recording: Recording, topics: Container[str], camera: str | None) -> tuple[Recording, str] | None:
    topic = f"/{camera}/rgb"
    return (recording, topic) if topic in topics else None


def open_source(target: Path, *, preset: str | None, texts: Sequence[str], sensor: str | None = None) -> Source:
    """Open a run's folder, an MCAP file or a recorded array as a source of frames.

    `sensor` selects one of several radars; `texts` are `KEY=VALUE` settings laid over the recorded ones. Raises
    ConfigError, RecordingError.
    """
    if target.suffix in _ARRAYS:
        if sensor is not None:
            raise ConfigError.at("--sensor", f"{target} holds one radar without a name", "leave it out")
        return _open_arrays(target, preset, texts)
    path, vehicle = target / MCAP_NAME if target.is_dir() else target, ""
    if target.is_dir() and not path.is_file() and (target.parent / MCAP_NAME).is_file():
        path, vehicle = target.parent / MCAP_NAME, target.name  # one vehicle of a run with several
    if not path.is_file():
        message = f"holds no {MCAP_NAME}" if target.is_dir() else "does not exist"
        raise ConfigError.at(str(target), message, "give the folder of a run, its run.mcap, an .npz, .npy or .bin")
    try:
        recording = Recording(path, vehicle)
        topics = _topics(recording)
    except RecordingError as error:
        raise ConfigError.at(str(path), str(error).removeprefix(f"{path}: ")) from error
    if vehicle not in (names := recording.vehicles or [""]):
        hint = f"hil radar {path.parent}/{names[0]}"
        raise ConfigError.at(str(path), f"is of several vehicles ({', '.join(names)}): name the folder of one", hint)
    raw = [topic for topic, (kind, _) in topics.items() if kind == RADAR_FRAME]
    if raw:
        name = _selected_radar([topic.strip("/").split("/")[0] for topic in raw], sensor, path)
        return _open_raw(
            recording, next(topic for topic in raw if topic.startswith(f"/{name}/")), topics, preset, texts
        )
    return _open_pictures(recording, topics, preset, texts, sensor)


def _selected_radar(names: Sequence[str], wanted: str | None, path: Path) -> str:
    """Return the radar to use: the wanted one, or the only one. Raises ConfigError."""
    if wanted is not None and wanted not in names:
        raise ConfigError.at("--sensor", f"{path} has no radar {wanted!r}", nearest(wanted, names))
    if wanted is None and len(names) > 1:
        raise ConfigError.at(str(path), f"has the radars {', '.join(names)}", "say which: --sensor NAME")
    return wanted or names[0]


def _open_arrays(path: Path, preset: str | None, texts: Sequence[str]) -> Source:
    recording = load_recording(path)
    parameters = settings_of(None, preset=preset, default_preset=RECORDING_PRESET, texts=texts)
    parameters = with_chirp(parameters, recording.chirp, recording.receivers, str(path))
    period_ns = round((recording.frame_repetition_s or _DEFAULT_PERIOD_S) * NS_PER_S)
    frames = (Frame(i * period_ns, np.ascontiguousarray(raw)) for i, raw in enumerate(recording.adc))
    return Source(f"recording {path.name}", parameters, recording.frames, False, frames)


def _topics(recording: Recording) -> dict[str, tuple[str, int]]:
    """Return message type and number of messages of every topic."""
    topics: dict[str, tuple[str, int]] = {}
    for message in recording.messages():
        kind, count = topics.get(message.topic, (message.type_name, 0))
        topics[message.topic] = (kind, count + 1)
    return topics


def _open_raw(
    recording: Recording, topic: str, topics: Mapping[str, tuple[str, int]], preset: str | None, texts: Sequence[str]
) -> Source:
    first = radar_frame(next(message for message in recording.messages() if message.topic == topic))
    name = topic.strip("/").split("/")[0]
    recorded = _section(recording, name)
    parameters = settings_of(recorded, preset=preset, default_preset=LIVE_PRESET, texts=texts)
    parameters = with_chirp(parameters, first.chirp, len(first.raw), f"{recording.path}: {topic}")

    def frames() -> Iterator[Frame]:
        for message in recording.messages():
            if message.topic == topic:
                frame = radar_frame(message)
                yield Frame(frame.t_capture_ns, frame.raw)

    colour = _colour_topic(recording, topics, parameters.frame)
    part = preset or (recorded or {}).get("preset") or LIVE_PRESET
    return Source(f"raw frames of {name!r}", parameters, topics[topic][1], False, frames(), colour, str(part))


def _section(recording: Recording, name: str) -> Mapping[str, Any] | None:
    """Return the section of a sensor in the bench file attached to the recording or of its vehicle, if there is one."""
    text = recording.scan().attachments.get(BENCH_NAME, b"{}")
    if recording.vehicle:
        file = recording.path.parent / recording.vehicle / BENCH_NAME
        text = file.read_bytes() if file.is_file() else b"{}"
    data = parse_yaml(text.decode(errors="replace"), BENCH_NAME).data
    section = data.get("sensors", {}).get(name) if isinstance(data, dict) else None
    return section if isinstance(section, dict) else None


def _open_pictures(
    recording: Recording, topics: Mapping[str, Any], preset: str | None, texts: Sequence[str], sensor: str | None
) -> Source:
    path = recording.path
    bench_file = path.parent / recording.vehicle / BENCH_NAME
    cameras = _cameras(topics)
    if not cameras or not bench_file.is_file():
        hint = f"record a radar's raw data, or a camera with the channels {', '.join(_NEEDED)}"
        message = "holds no raw radar data and no pictures to make them of"
        if cameras:
            message, hint = "needs the bench.yaml of the run beside it", "give the run's folder"
        raise ConfigError.at(str(path), message, hint)
    bench = load_bench(bench_file, flown=False)
    radars = {n: s for n, s in bench.config.sensors.items() if isinstance(s.parameters, RadarParameters)}
    name, recorded = "radar", None
    if radars or sensor is not None:
        name = _selected_radar(list(radars), sensor, path)
        recorded = radars[name].parameters.model_dump(mode="json")
    parameters = settings_of(recorded, preset=preset, default_preset=LIVE_PRESET, texts=texts)
    camera = parameters.frame or cameras[0]
    if camera not in cameras:
        problem = f"frame {camera!r}: that camera's {', '.join(_NEEDED)} were not recorded"
        raise ConfigError.at(str(path), problem, nearest(camera, cameras))
    view = view_of(bench.config.sensors[camera])
    if parameters.bounces is not None:
        message = "pictures do not show paths with more than one bounce; record the radar's raw frames for them"
        raise ConfigError.at(str(path), message, "or --set bounces=null")
    try:
        radar = RadarFrames(view, load_world(bench.scene), parameters, seed=bench.config.seed, name=name)
    except ValueError as error:
        raise ConfigError.at("--set mask", str(error)) from error
    missing = [channel for channel in radar.channels if f"/{camera}/{channel}" not in topics]
    if missing:
        raise ConfigError.at(
            str(path), f"holds no {', '.join(missing)} of the camera {camera!r}", "record these channels"
        )
    frames = _frames_from_pictures(recording, camera, radar, Mount(view.mount_m, view.mount_rpy_deg), bench.config)
    count = topics[f"/{camera}/range"][1]
    colour = _colour_topic(recording, topics, camera)
    return Source(f"frames made from the pictures of {camera!r}", parameters, count, True, frames, colour)


def _cameras(topics: Mapping[str, Any]) -> list[str]:
    """Return the cameras with all recorded channels that echoes need."""
    names = {topic.split("/")[1] for topic in topics if topic.endswith("/range")}
    return sorted(name for name in names if all(f"/{name}/{channel}" in topics for channel in _NEEDED))


def _frames_from_pictures(
    recording: Recording, camera: str, radar: RadarFrames, mount: Mount, config: BenchConfig
) -> Iterator[Frame]:
    """Yield the frame of each picture, once all its channels and the true state of its tick have been read."""
    channel_by_topic = {f"/{camera}/{channel}": channel for channel in radar.channels}
    waiting: dict[int, dict[str, NDArray[Any]]] = {}
    truths: dict[int, dict[str, RecordedMessage]] = {}
    for message in recording.messages():
        if message.topic in ("/truth/pose", "/truth/velocity", "/truth/angular_velocity"):
            t_ns = message.log_time_ns
            if t_ns not in truths:
                truths = {t: messages for t, messages in truths.items() if t > t_ns - _MAX_LATENCY_NS}
            truths.setdefault(t_ns, {})[message.topic] = message
        elif message.topic in channel_by_topic:
            t_ns, picture = image(message)
            pictures = waiting.setdefault(message.sequence, {})
            pictures[channel_by_topic[message.topic]] = picture
            if len(pictures) == len(channel_by_topic):
                del waiting[message.sequence]
                truth = _truth(t_ns, t_ns // config.tick_ns, truths.get(t_ns, {}), recording.path)
                yield Frame(t_ns, radar.raw(pictures, mount.pose(truth), message.sequence))


def _truth(t_ns: int, tick: int, messages: Mapping[str, RecordedMessage], path: Path) -> TruthState:
    """Return the recorded pose and velocity of the vehicle as a true state; its other fields are zero."""
    if len(messages) < 3:
        raise RecordingError(f"{path}: has no complete true state of the vehicle at {t_ns / NS_PER_S:.3f} s")
    pose = messages["/truth/pose"].decode()
    v, w = messages["/truth/velocity"].decode(), messages["/truth/angular_velocity"].decode()
    assert capture_ns(pose) == t_ns
    q = "pose.orientation"
    return TruthState(
        tick,
        t_ns,
        (pose["pose.position.x"], pose["pose.position.y"], pose["pose.position.z"]),
        (pose[f"{q}.w"], pose[f"{q}.x"], pose[f"{q}.y"], pose[f"{q}.z"]),
        (v["vector.x"], v["vector.y"], v["vector.z"]),
        (w["vector.x"], w["vector.y"], w["vector.z"]),
        _ZERO,
        _ZERO,
        (),
        False,
    )


_SENSOR_KEYS = frozenset({"preset", "kind", "autopilot", "rate_hz"})  # keys of a sensor's section beside parameters


def settings_of(
    recorded: Mapping[str, Any] | None, *, preset: str | None, default_preset: str, texts: Sequence[str]
) -> RadarParameters:
    """Return a radar's parameters: those of `preset` or `recorded`, with `texts` merged over them.

    `recorded` is the radar's complete section in a bench; a given `preset` replaces it, and `default_preset` is used if
    both are None. Raises ConfigError with every problem.
    """
    settings = Settings()
    problems: list[Problem] = merge_options(settings, texts)
    base: dict[str, Any] = {}
    if preset is not None or recorded is None:
        settings.set(("preset",), preset or default_preset, "--preset")
        preset_values = find_preset(preset or default_preset, settings, ("preset",), problems)
        if preset_values is not None and not isinstance(preset_values.parameters, RadarParameters):
            problems.append(Problem("--preset", f"is a {preset_values.kind}, not a radar"))
        elif preset_values is not None:
            base = preset_values.parameters.model_dump(mode="json")
    else:
        base = {key: value for key, value in recorded.items() if key not in _SENSOR_KEYS}
    if problems:
        raise ConfigError(problems)
    overrides = {key: value for key, value in settings.data.items() if key != "preset"}
    parameters, problems = validate(RadarParameters, merge_keys(RadarParameters, base, overrides), settings)
    if problems or parameters is None:
        raise ConfigError(problems)
    return parameters


def with_chirp(parameters: RadarParameters, chirp: Chirp, channels: int, where: str) -> RadarParameters:
    """Return the parameters for recorded frames: with the chirp of the frames and without simulated impairments.

    Real or complex samples: as the parameters say, for frames do not tell. Raises ConfigError if the antenna's
    receivers or the processing do not suit the frames.
    """
    chirp = chirp.model_copy(update={"sampling": parameters.chirp.sampling})
    expected = parameters.antenna.channels(chirp)
    if expected != channels:
        message = f"has {channels} receivers, but the radar's antenna.rx_positions_m has {expected}"
        if chirp.sampling == "complex":
            message = f"has {channels} channels, but the radar's receivers have {expected}, two each"
        raise ConfigError.at(where, message, "--set antenna.rx_positions_m=[[x,y,z],...] of these receivers")
    unfit = parameters.antenna.problems_with(chirp)
    if unfit:
        raise ConfigError([Problem(where, f"its frames do not suit the antenna: {problem}") for problem in unfit])
    problem = parameters.processing.problem_with(parameters.antenna.array.seen(chirp))
    if problem:
        raise ConfigError.at(where, f"its frames do not suit processing.{problem}", "--set processing.KEY=VALUE")
    impairments = type(parameters.impairments)()
    return parameters.model_copy(update={"chirp": chirp, "impairments": impairments})
