"""The radar as a sensor: shared pictures, independence, what is computed, and what a recording keeps of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.run.parts.simulated.sensors import radar_counts, radar_rows
from hil.run.recorder.frame_description import FrameDescription, Sweep
from hil.run.recorder.reading import read_messages
from hil.run.recorder.reading_frames import image, radar_frame
from hil.run.recorder.recorder import Recorder
from hil.run_files import MCAP_NAME
from signals.errors import RecordingError
from signals.samples import RADAR_UNITS, RadarSample, TruthState, arrays_of
from signals.time import RateAccumulator, is_due
from sim.frame.camera_pose import CameraPose
from sim.frame.mount import Mount
from sim.frame.shared_picture import SharedPicture
from sim.frame.source import Renderer, SharedFrames
from sim.radar.processing.processor import Processor
from sim.scene.scene import load_scene
from sim.sensors.camera import Camera
from sim.sensors.catalog import PRESETS
from sim.sensors.radar import Radar
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world
from tests.worlds.installed_sensor import installed
from tests.worlds.synthetic_flight import TICK_NS, decoded, make_flight

SCENE = load_scene("radar_range")
RADARS = sorted(name for name, preset in PRESETS.items() if preset.kind == "radar")
ZERO = (0.0, 0.0, 0.0)
VIEW: dict[str, Any] = {"resolution": (64, 48), "fov_deg": 90.0, "mount_m": (0.1, 0.0, 1.5)}
TURNED = VIEW | {"mount_rpy_deg": (3.0, 10.0, -5.0), "near_m": 0.3, "far_m": 60.0}


class CountedFrames(SharedFrames):
    """A run's geometry; `drawn` lists the channels of every drawing."""

    def __init__(self) -> None:
        super().__init__(load_world(SCENE))
        self.drawn: list[tuple[str, ...]] = []

    def renderer(self, *arguments: Any, **options: Any) -> Renderer:
        return _Counted(super().renderer(*arguments, **options), self.drawn)


class _Counted:
    def __init__(self, renderer: Renderer, drawn: list[tuple[str, ...]]) -> None:
        self._renderer, self._drawn = renderer, drawn

    def render(self, pose: CameraPose, out: Any, *, rows: tuple[int, int] | None = None) -> None:
        self._drawn.append(tuple(out))
        self._renderer.render(pose, out, rows=rows)


def made(name: str, preset: str, frames: SharedFrames | None, shared: SharedPicture | None, **values: Any) -> Any:
    seed, rate_hz = values.pop("seed", 1), values.pop("rate_hz", 10.0)
    return installed(
        name, SCENE, preset=preset, overrides=values, rate_hz=rate_hz, seed=seed, frames=frames, shared=shared
    )


def radar(
    frames: SharedFrames | None = None, *, preset: str = "bgt60tr13c", name: str = "radar", **values: Any
) -> Radar:
    sensor = made(name, preset, frames or CountedFrames(), None, **(VIEW | values))
    assert isinstance(sensor, Radar)
    return sensor


def pair(
    frames: SharedFrames, *, view: dict[str, Any] = VIEW, due: Any = lambda _: True, outputs: Any = None, **camera: Any
) -> tuple[Camera, Radar]:
    """A camera, and a radar that reads its frames."""
    shared = _shared(view)
    front = made("front", "camera_320x240", frames, shared, **({"channels": ("rgb", "range")} | view | camera))
    more = {} if outputs is None else {"outputs": outputs}
    reader = made("radar", "bgt60tr13c", frames, shared, frame="front", **more)
    shared.add_reader(reader.channels, due)
    return front, reader


def _shared(view: dict[str, Any]) -> SharedPicture:
    own = RadarParameters.model_validate(PRESETS["bgt60tr13c"].parameters.model_dump() | view).view()
    if "far_m" in view:
        return own
    # A camera's own limits where nothing is said.
    return SharedPicture(
        own.camera, mount_m=own.mount_m, mount_rpy_deg=own.mount_rpy_deg, near_m=own.near_m, far_m=own.far_m
    )


def truth(k: int = 0, **values: Any) -> TruthState:
    p = (0.02 * k, 0.0, 0.3)
    state = TruthState(
        k, k * TICK_NS, p, (0.9992, 0.02, 0.01, 0.03), (0.5, 0.1, 0.2), (0.1, -0.2, 0.3), ZERO, ZERO, (0.0,) * 4, False
    )
    return state._replace(**values)


@pytest.mark.parametrize("preset", RADARS)
def test_a_sample_holds_the_outputs_in_their_form(preset: str) -> None:
    sensor = radar(preset=preset, latency_s=0.01)
    sample = sensor.sample(truth(25), 3)
    parameters = PRESETS[preset].parameters
    assert isinstance(parameters, RadarParameters)
    chirp = sensor.chirp
    assert isinstance(sample, RadarSample)
    assert sample.seq == 3
    assert sample.t_capture_ns == 25 * TICK_NS
    assert sample.t_available_ns == sample.t_capture_ns + round((0.5 * chirp.frame_s + 0.01) * 1e9)
    assert set(sample.channels) == set(RADAR_UNITS)
    raw, power = sample.channels["raw"], sample.channels["range_doppler"]
    assert (raw.dtype, raw.shape) == (np.uint16, parameters.raw_shape)
    assert raw.shape[1:] == (chirp.chirps, chirp.samples)
    assert (power.dtype, power.shape) == (np.float32, parameters.map_shape)
    assert np.all(np.isfinite(power))
    assert {"x_R", "range_m", "speed_mps", "snr_db"} <= set(sample.channels["points"].dtype.names or ())
    assert not any(array.flags.writeable for _, array in arrays_of(sample))
    # R has the axes of B for a radar that looks forward, and sits where the camera does.
    expected = Mount(VIEW["mount_m"], ZERO).pose(truth(25)).p_WC
    assert sample.p_WR == expected
    assert sample.q_WR == pytest.approx(truth().q_WB)


CAMERAS: dict[str, dict[str, Any]] = {
    "plain": {},
    "noise": {
        "noise": {"electrons_at_white": 300.0},
        "vignetting": 0.5,
        "channels": ("rgb", "depth", "range"),
        "depth_noise": {"sigma_m": 0.5},
    },
    "colour alone": {"channels": ("rgb",)},
    "blur": {"motion_blur": {"exposure_s": 0.02, "frames": 3}},
    "blurred colour alone": {"motion_blur": {"exposure_s": 0.02, "frames": 3}, "channels": ("rgb",)},
    "fine": {"supersample": 2, "channels": ("rgb", "normal")},
    "rolling": {"rolling_shutter_s": 0.03},
    "shadows": {"shadows": True},
    "classes": {"channels": ("segmentation", "material", "range", "normal", "radial_velocity")},
}
SHARED = ("plain", "noise", "colour alone", "blur", "fine", "shadows", "classes")


@pytest.mark.parametrize(
    "options",
    # `make test` leaves out what another one holds too.
    [
        pytest.param(options, id=name, marks=pytest.mark.slow if name == "colour alone" else [])
        for name, options in CAMERAS.items()
    ],
)
def test_the_cameras_frames_and_a_view_of_its_own_give_the_same_bytes(
    options: dict[str, Any], request: pytest.FixtureRequest
) -> None:
    frames = CountedFrames()
    front, reader = pair(frames, view=TURNED, outputs=("raw", "points"), **options)
    alone = radar(outputs=("raw", "points"), **TURNED)
    plain_front = made(
        "front", "camera_320x240", CountedFrames(), None, **({"channels": ("rgb", "range")} | TURNED | options)
    )
    for k in (0, 1, 2):
        moment = truth(25 * k)
        picture = front.sample(moment, k)
        assert reader.sample(moment, k) == alone.sample(moment, k)
        assert picture == plain_front.sample(moment, k)  # nor does the camera notice who reads
    name = request.node.callspec.id
    assert reader.counts.shared == (3 if name in SHARED else 0)
    if name in ("plain", "noise", "shadows"):
        assert len(frames.drawn) == 3  # the scene once, for both
    assert reader.counts.frames == 3


def test_neither_order_nor_rates_matter() -> None:
    def frames_of(order: str, camera_every: int) -> tuple[list[RadarSample], list[Any], int]:
        frames = CountedFrames()
        front, reader = pair(frames, due=lambda tick: tick % 50 == 0, outputs=("raw",))
        heard, seen = [], []
        for tick in range(0, 151, 25):
            for who in order:
                if who == "c" and tick % camera_every == 0:
                    seen.append(front.sample(truth(tick), len(seen)))
                if who == "r" and tick % 50 == 0:
                    heard.append(reader.sample(truth(tick), len(heard)))
        return heard, seen, len(frames.drawn)

    first = frames_of("cr", 25)
    assert first[2] == 7  # what the radar wants is drawn with the camera, and no oftener
    second = frames_of("rc", 25)
    assert second[2] == 11
    assert first[:2] == second[:2]
    assert frames_of("cr", 75)[0] == first[0]
    assert frames_of("r", 1)[0] == first[0]


@pytest.mark.parametrize("rates", [(10_000, 250_000), (100_000, 250_000), (29_970, 1_000_000), (250_000, 250_000)])
def test_the_ticks_of_a_rate_can_be_told_beforehand(rates: tuple[int, int]) -> None:
    event_millihz, tick_millihz = rates
    rate = RateAccumulator(event_millihz=event_millihz, tick_millihz=tick_millihz)
    assert [rate.due() for _ in range(500)] == [
        is_due(k, event_millihz=event_millihz, tick_millihz=tick_millihz) for k in range(500)
    ]


def test_nobody_reads_what_cameras_change() -> None:
    with pytest.raises(ValueError, match="depth, rgb"):
        _shared(VIEW).add_reader(("range", "rgb", "depth"), lambda _: True)


def test_only_wanted_outputs_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = radar()
    everything = [whole.sample(truth(25 * k), k).channels for k in range(5)]
    for outputs in (("raw",), ("range_doppler",), ("points", "raw"), ("tracks",)):
        sensor = radar(outputs=outputs)
        for k in range(5):
            channels = sensor.sample(truth(25 * k), k).channels
            assert set(channels) == set(outputs)
            assert all(channels[name].tobytes() == everything[k][name].tobytes() for name in outputs)
    steps: list[str] = []
    process = Processor.process

    def noted(self: Processor, raw: Any, t_ns: int, *, until: Any = "tracks") -> Any:
        steps.append(until)
        return process(self, raw, t_ns, until=until)

    monkeypatch.setattr(Processor, "process", noted)
    for outputs in (("raw",), ("raw", "range_doppler"), ("range_doppler", "points"), tuple(RADAR_UNITS)):
        radar(outputs=outputs).sample(truth(), 0)
    assert steps == ["range_doppler", "points", "tracks"]  # raw data alone needs none


def test_an_empty_scene_gives_leakage_and_noise() -> None:
    sensor = radar(mount_rpy_deg=(0.0, -90.0, 0.0))  # nothing but the sky
    a, b = (sensor.sample(truth(25 * k), k).channels for k in range(2))
    assert sensor.counts.echoes == 0
    assert sensor.counts.pixels_dropped["sky"] == sensor.counts.pixels == 2 * 64 * 48
    raw = a["raw"].astype(float)
    assert raw.mean() > 500.0  # of 4096
    assert 0.3 < (raw - b["raw"]).std() < 10.0
    assert np.all(np.isfinite(a["range_doppler"]))


def test_dropped_pixels_are_reported() -> None:
    sensor = radar(mask={"max_range_m": 3.0, "azimuth_deg": (-20.0, 20.0)})
    sensor.sample(truth(), 0)
    told = radar_counts(sensor)
    assert told["pixels"] == 64 * 48
    assert told["pixels_dropped"]["outside the mask's angles"] > 1000
    assert told["pixels_dropped"]["beyond the mask's range"] > 10
    rows = {row["why"]: row for row in radar_rows({"radar": sensor})}
    assert rows["sky"]["what"] == "radar: pixels"
    assert rows["sky"]["saved"].endswith(f"of {64 * 48} pixels")
    kept = told["pixels"] - sum(told["pixels_dropped"].values())
    assert 0 <= told["echoes"] - kept <= 3  # corner reflectors come on top


def test_the_person_is_where_it_is() -> None:
    sensor = radar(outputs=("points",), resolution=(160, 120), mount_m=(0.0, 0.0, 1.5))
    still = [
        truth(5 * k, p_WB=(0.0, 0.0, 0.3), v_WB_W=ZERO, w_WB_B=ZERO, q_WB=(1.0, 0.0, 0.0, 0.0)) for k in range(100, 130)
    ]
    frames = [sensor.sample(t, k).channels["points"] for k, t in enumerate(still)]
    strongest = [points[points["speed_mps"] > 0.3][:1] for points in frames]  # limbs echo too, more weakly
    moving = np.concatenate(strongest)
    # It has walked for 2 to 2.6 s at 1.2 m/s, on the right-hand side of the way.
    assert len(moving) >= 20
    assert np.median(moving["range_m"]) == pytest.approx(3.7, abs=0.4)
    assert np.median(moving["speed_mps"]) == pytest.approx(1.2, abs=0.15)
    assert np.median(moving["y_R"]) < 0.0


def test_wrong_installations_are_refused() -> None:
    with pytest.raises(ValueError, match=r"lower its rate_hz to 39\.964 or less"):
        radar(rate_hz=50.0)
    with pytest.raises(ValueError, match="pictures of its camera 'front' are missing"):
        made("radar", "bgt60tr13c", CountedFrames(), None, frame="front")


SWEEP = Sweep(60.8e9, 0.4e9, 2e6, 390.975e-6)


def recorded(folder: Path, samples: list[RadarSample]) -> None:
    recorder = Recorder(folder, mcap=True, tlog=False, tick_ns=TICK_NS)
    recorder.describe("radar", FrameDescription("radar", (0.1, 0.0, 1.5), sweep=SWEEP))
    for tick in make_flight(120):
        recorder.truth(tick.truth)
        for sample in samples:
            if 0 <= tick.t_ns - sample.t_available_ns < TICK_NS:
                recorder.sample("radar", sample)
    recorder.close("PASS")


def test_a_recording_keeps_every_bit(tmp_path: Path) -> None:
    sensor = radar()
    samples = [sensor.sample(truth(25 * k), k) for k in range(4)]
    samples += [sensor.sample(truth(100, q_WB=(0.7071, 0.0, -0.7071, 0.0)), 4)]  # the sky: no points
    recorded(tmp_path, samples)
    found = decoded(tmp_path / MCAP_NAME)
    for k, (sample, (message, ros)) in enumerate(zip(samples, found["/radar/raw"], strict=True)):
        assert (message.sequence, message.publish_time) == (k, sample.t_available_ns)
        assert ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec == sample.t_capture_ns
        assert ros.header.frame_id == "radar"
        assert (ros.center_frequency_hz, ros.repetition_s) == (60.8e9, 390.975e-6)
        assert (ros.receivers, ros.chirps, ros.samples) == sample.channels["raw"].shape
        assert np.array_equal(np.array(ros.data, np.uint16), sample.channels["raw"].reshape(-1))
        assert (ros.position.x, ros.position.y, ros.position.z) == sample.p_WR
        assert (ros.orientation.w, ros.orientation.x) == sample.q_WR[:2]
    for sample, (_, ros) in zip(samples, found["/radar/range_doppler"], strict=True):
        assert (ros.height, ros.width, ros.encoding) == (64, 32, "32FC1")
        assert bytes(ros.data) == sample.channels["range_doppler"].tobytes()
    for name, first in (("points", ["x", "y", "z"]), ("tracks", ["id", "age_frames", "x"])):
        for sample, (_, ros) in zip(samples, found[f"/radar/{name}"], strict=True):
            records = sample.channels[name]
            assert (ros.height, ros.width, ros.point_step) == (1, len(records), records.dtype.itemsize)
            assert [field.name for field in ros.fields][:3] == first
            assert bytes(ros.data) == records.tobytes()
            x = next(field for field in ros.fields if field.name == "x")
            theirs = [
                np.frombuffer(bytes(ros.data), "<f4", 1, i * ros.point_step + x.offset)[0] for i in range(ros.width)
            ]
            assert theirs == (records["x_R"] if name == "points" else records["p_R_m"][:, 0]).tolist()
    assert len(found["/radar/pose"]) == 5
    mine = list(read_messages(tmp_path / MCAP_NAME))
    raw = [radar_frame(m) for m in mine if m.topic == "/radar/raw"]
    assert [(f.seq, f.t_capture_ns, f.chirp) for f in raw] == [(s.seq, s.t_capture_ns, sensor.chirp) for s in samples]
    assert all(np.array_equal(f.raw, s.channels["raw"]) for f, s in zip(raw, samples, strict=True))
    maps = [image(m) for m in mine if m.topic == "/radar/range_doppler"]
    assert all(np.array_equal(m, s.channels["range_doppler"]) for (_, m), s in zip(maps, samples, strict=True))


def test_a_frame_that_is_none_is_refused(tmp_path: Path) -> None:
    sample = radar(outputs=("raw",)).sample(truth(5), 0)
    recorded(tmp_path, [sample])
    (message,) = [m for m in read_messages(tmp_path / MCAP_NAME) if m.topic == "/radar/raw"]
    broken = message.data.replace(np.float64(0.4e9).tobytes(), np.float64(0.0).tobytes())
    with pytest.raises(RecordingError, match="not a valid radar frame"):
        radar_frame(message._replace(data=broken))


def test_bounces_add_ghosts_with_labels_and_leave_the_rest_alone() -> None:
    still = {"v_WB_W": ZERO, "w_WB_B": ZERO, "q_WB": (1.0, 0.0, 0.0, 0.0)}
    off, on = radar(impairments=QUIET), radar(impairments=QUIET, bounces={"floor_db": -50.0})
    for sensor in (off, on):
        sensor.label_objects()
    plain, ghostly = (sensor.sample(truth(500, **still), 0).channels["raw"] for sensor in (off, on))
    assert (
        radar(impairments=QUIET, bounces=None).sample(truth(500, **still), 0).channels["raw"].tobytes()
        == plain.tobytes()
    )
    assert np.any(plain != ghostly)
    assert on.objects == off.objects
    assert not off.ghosts
    assert {ghost.path for ghost in on.ghosts} == {"both ways", "out", "back"}
    direct = {o.instance: o for o in on.objects}
    names = load_world(SCENE).instance_names
    for ghost in on.ghosts:
        assert names[ghost.mirror].startswith(("ground", "marking", "reflector"))
        if ghost.echo.instance in direct:
            assert ghost.echo.nearest_m > direct[ghost.echo.instance].nearest_m - 0.05
    counts = radar_counts(on)
    assert counts["ghosts"] > 100
    assert counts["rays"] > counts["ghosts"]
    assert "ghosts" not in radar_counts(off)


def test_bounces_by_several_transmitters_are_those_of_each() -> None:
    """The frame of a transmitter alone is the chirps of its turn, but for what moves between the turns."""
    still = {"v_WB_W": ZERO, "w_WB_B": ZERO, "q_WB": (1.0, 0.0, 0.0, 0.0)}
    place = {"preset": "awr1843boost", "impairments": QUIET, "bounces": {}, "outputs": ("raw",), "method": "direct"}
    parameters = PRESETS["awr1843boost"].parameters
    assert isinstance(parameters, RadarParameters)
    chirp = parameters.chirp.model_dump() | {"chirps": 12, "samples": 64, "bandwidth_hz": 0.4e9}
    antenna = parameters.antenna.model_dump() | {"field_deg": None}
    mask = {"classes": ("reflector",)}
    together = radar(**place, chirp=chirp, mask=mask).sample(truth(0, **still), 0).channels["raw"].astype(np.int64)
    for p, at in enumerate(antenna["tx_positions_m"]):
        alone = radar(**place, chirp=chirp, mask=mask, antenna=antenna | {"tx_positions_m": (at,)})
        raw = alone.sample(truth(0, **still), 0).channels["raw"].astype(np.int64)
        assert np.abs(together[:, p::3] - raw[:, p::3]).max() <= 1
        assert np.ptp(raw) > 20


QUIET = {"leakage": None, "frame_start": None, "dc_wander": None, "noise": None, "adc": None}


def test_rain_is_a_switch() -> None:
    dry, none, wet = (radar(impairments=QUIET, outputs=("raw",), rain_mm_per_h=rate) for rate in (None, 0.0, 50.0))
    frames = [sensor.sample(truth(0), 0).channels["raw"] for sensor in (dry, none, wet)]
    assert frames[0].tobytes() == frames[1].tobytes() != frames[2].tobytes()


def test_sweep_errors_and_compression_are_switches() -> None:
    plain = radar(impairments=QUIET, outputs=("raw",)).sample(truth(0), 0).channels["raw"]
    for more in (
        {"sweep": {"phase_noise": [[1e4, -60.0], [1e6, -80.0]]}},
        {"sweep": {"nonlinearity": [[0.0, -2e5], [0.5, 2e5], [1.0, -2e5]]}},
        {"compression": {"limit_counts": 200.0}},
    ):
        changed = radar(impairments=QUIET | more, outputs=("raw",)).sample(truth(0), 0).channels["raw"]
        assert np.any(changed != plain)
    off = radar(impairments=QUIET | {"sweep": None, "compression": None}, outputs=("raw",))
    assert off.sample(truth(0), 0).channels["raw"].tobytes() == plain.tobytes()
