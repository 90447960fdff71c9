"""Radars in a bench file: valid ones are resolved, wrong values are named with their line and a hint."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.apps.radar.sources import settings_of, with_chirp
from hil.cli.app import run_command_line
from hil.config import Bench, load_bench, resolved_yaml, save_bench
from hil.run.loop.stages import plan_stages
from hil.run.sensors.frame_stages import stage_specs
from signals.errors import ConfigError
from sim.radar.chirp import Chirp
from sim.sensors.catalog import PRESETS
from tests.worlds import bench_files
from tests.worlds.bench_files import FLIGHT_SENSORS, elsewhere  # noqa: F401 (the fixture is for every test)

SENSORS = f"""scene: radar_range
{FLIGHT_SENSORS}  front: {{kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [rgb]}}
"""
REPOSITORY = Path(__file__).resolve().parents[4]


def file_of(radar: str, more: str = "") -> str:
    return f"{SENSORS}  radar: {radar}\n{more}"


def load(radar: str, more: str = "", settings: tuple[str, ...] = ()) -> Bench:
    return bench_files.load(file_of(radar, more), settings=settings)


def refused(radar: str, more: str = "") -> str:
    (problem,) = bench_files.refused(file_of(radar, more))
    return problem


def test_a_radar_reads_a_cameras_frames_wherever_it_stands_in_the_file() -> None:
    bench = load("{preset: bgt60tr13c, frame: front, rate_hz: 10}")
    radar = bench.config.sensors["radar"]
    assert (radar.kind, radar.preset, radar.autopilot) == ("radar", "bgt60tr13c", False)
    assert radar.parameters.frame == "front"
    Path("first.yaml").write_text(
        SENSORS.replace("sensors:\n", "sensors:\n  radar: {preset: bgt60tr13c, frame: front, rate_hz: 10}\n")
    )
    first = load_bench("first.yaml")
    assert first.config.sensors["radar"] == radar
    for config in (bench.config, first.config):
        plan = plan_stages(stage_specs(config))
        assert {f"radar/{name}" for name in ("raw", "range_doppler", "points", "tracks")} <= set(plan.order)


def test_each_output_is_a_port_of_its_own() -> None:
    config = load("{preset: bgt60tr13c, rate_hz: 10, outputs: [points, raw]}").config
    plan = plan_stages(stage_specs(config))
    assert [name for name in plan.order if name.startswith("radar")] == ["radar/points", "radar/raw"]
    dark = config.model_copy(update={"record": config.record.model_copy(update={"images": False})})
    left_out = plan_stages(stage_specs(dark)).skipped
    assert {"radar/points", "radar/raw"} <= {skipped.stage for skipped in left_out}


def test_sections_merge_key_by_key_and_survive_being_saved() -> None:
    text = """
    preset: bgt60tr13c
    rate_hz: 20
    resolution: [160, 120]
    fov_deg: 80
    mount_m: [0.1, 0, 0]
    mount_rpy_deg: [0, 10, 0]
    mask: {classes: [person], max_range_m: 10}
    processing: {clutter: mti2, cfar: {kind: ca}}
    impairments: {noise: null, adc: {odd_code_share: 0.2}}
    method: direct
    tolerance: 1.0e-6
"""
    bench = load(text)
    p, preset = bench.config.sensors["radar"].parameters, PRESETS["bgt60tr13c"].parameters
    assert p.chirp == preset.chirp  # type: ignore[attr-defined]
    assert p.impairments.leakage == preset.impairments.leakage  # type: ignore[attr-defined]
    assert (p.impairments.noise, p.impairments.adc.odd_code_share) == (None, 0.2)
    assert (p.processing.clutter, p.processing.cfar.kind) == ("mti2", "ca")
    assert p.processing.cfar.guard_range == type(p.processing)().cfar.guard_range
    Path("again.yaml").write_text(resolved_yaml(bench.config))
    assert load_bench("again.yaml").config.sensors == bench.config.sensors
    framed = load("{preset: bgt60tr13c, frame: front, rate_hz: 10}")
    saved = save_bench(framed, Path("run"))
    assert load_bench(saved).config.sensors == framed.config.sensors


def test_one_key_can_be_set_on_the_command_line() -> None:
    settings = ("sensors.radar.processing.cfar.kind=ca", "sensors.radar.impairments.noise=null")
    p = load("{preset: bgt60tr13c, rate_hz: 10}", settings=settings).config.sensors["radar"].parameters
    assert (p.processing.cfar.kind, p.impairments.noise) == ("ca", None)
    assert p.impairments.adc is not None


PRESET = "preset: bgt60tr13c"
AWR = "preset: awr1843boost, rate_hz: 10"
WIDE_ROW = "rx_positions_m: [[0, 0, 0], [0, 0.0024, 0], [0, 0.0048, 0], [0, 0.0072, 0]], tx_positions_m: [[0, 0, 0]]"
FASTER = "rate_hz leaves 0.02 s for a frame that takes 0.0250224 s (64 chirps every 0.000390975 s)"


@pytest.mark.parametrize(
    ("radar", "expected"),
    [
        (f"{{{PRESET}, frame: frnt, rate_hz: 10}}", "frame is unknown: 'frnt' (did you mean 'front'?)"),
        (f"{{{PRESET}, frame: gps, rate_hz: 10}}", "is 'gps', a gps and no camera (the only one there is: front)"),
        (f"{{{PRESET}, rate_hz: 50}}", f"{FASTER} (39.964 Hz at most, or fewer chirps)"),
        (f"{{{PRESET}, frame: front, fov_deg: 90, rate_hz: 10}}", "leave out fov_deg"),
        (f"{{{PRESET}, rate_hz: 10, chirp: {{samples: 800}}}}", "take 0.0004 s, longer than repetition_s 0.000390975"),
        (f"{{{PRESET}, rate_hz: 10, chirp: {{samples: 63}}}}", "samples must be even"),
        (f"{{{PRESET}, rate_hz: 10, chirp: {{bandwith_hz: 1}}}}", "did you mean 'bandwidth_hz'?"),
        (f"{{{PRESET}, rate_hz: 10, outputs: [raw, rwa]}}", "there is no output 'rwa'"),
        (f"{{{PRESET}, rate_hz: 10, outputs: []}}", "must name at least one output"),
        (f"{{{PRESET}, rate_hz: 10, outputs: [raw, raw]}}", "named twice"),
        (f"{{{PRESET}, rate_hz: 10, near_m: 5, far_m: 2}}", "far_m 2 must be above near_m 5"),
        (f"{{{PRESET}, rate_hz: 10, bounces: {{spacing_deg: 9}}}}", "spacing_deg must be at most 5 deg, not 9"),
        (f"{{{PRESET}, rate_hz: 10, bounces: {{floor_db: 0}}}}", "floor_db must be at most -3, not 0"),
        (f"{{{PRESET}, rate_hz: 10, bounces: {{spacing: 1}}}}", "did you mean 'spacing_deg'?"),
        (f"{{{PRESET}, rate_hz: 10, interference: {{clock_ppm: 2000}}}}", "clock_ppm must be at most 1000, not 2000"),
        (f"{{{PRESET}, rate_hz: 10, rain_mm_per_h: 300}}", "rain_mm_per_h must be at most 200, not 300"),
        (f"{{{PRESET}, rate_hz: 10, impairments: {{compression: {{limit_counts: 0}}}}}}", "must be at least 1, not 0"),
        (
            f"{{{PRESET}, rate_hz: 10, impairments: {{sweep: {{nonlinearity: [[0, -9.0e6], [1, 9.0e6]]}}}}}}",
            "the limit is 0.3",
        ),
        (
            f"{{{PRESET}, rate_hz: 10, impairments: {{coupling: {{rows: [[1, 5, -20, 0]]}}}}}}",
            "names receiver 5, but the antenna has 3",
        ),
        (f"{{{PRESET}, rate_hz: 10, fov_deg: 1.0e-9}}", "the focal length fx must be 0.001 to 1e7 pixels"),
        (f"{{{PRESET}, rate_hz: 10, mask: {{azimuth_deg: [60, 70]}}}}", "leave no pixel"),
        (f"{{{PRESET}, rate_hz: 10, mask: {{azimuth_deg: [20, 10]}}}}", "is empty"),
        (f"{{{PRESET}, rate_hz: 10, mask: {{classes: [persn]}}}}", "did you mean 'person'"),
        (f"{{{PRESET}, rate_hz: 10, antenna: {{rx_positions_m: [[0, 0, 0]]}}}}", "but the antenna has 1"),
        (f"{{{PRESET}, rate_hz: 10, chirp: {{chirps: 8}}}}", "training cells on each side are more than the 8 Doppler"),
        (f"{{{PRESET}, rate_hz: 10, processing: {{cfar: {{guard_doppler: 40}}}}}}", "more than the 64 Doppler rows"),
        (f"{{{PRESET}, rate_hz: 10, chirp: {{chirps: 3}}, processing: {{clutter: mti3}}}}", "fewer than two of 3"),
        (f"{{{PRESET}, rate_hz: 10, autopilot: true}}", "no flight controller takes a radar"),
        (f"{{{AWR}, chirp: {{chirps: 128}}}}", "must be a multiple of the 3 transmitters that take turns, 6 at least"),
        (f"{{{AWR}, chirp: {{center_frequency_hz: 80.8e+9}}}}", "the board's band is 76 to 81 GHz"),
        (f"{{{AWR}, chirp: {{bandwidth_hz: 1.6e+9}}}}", "one oscillator of the board covers 76 to 78 or 77 to 81 GHz"),
        (
            f"{{{AWR}, chirp: {{samples: 32, bandwidth_hz: 0.1e+9, repetition_s: 14.2e-6}}}}",
            "repetition_s: 14.2 us; the board's limit is 15 us",
        ),
        (
            f"{{{AWR}, antenna: {{rx_cuts: [{{}}]}}}}",
            "rx_cuts has 1 elements; rx_positions_m has 4",
        ),
        (f"{{{AWR}, chirp: {{bandwidth_hz: 4.2e+9}}}}", "a slope of 102.5 MHz/us; the board's limit is 100 MHz/us"),
        (f"{{{AWR}, chirp: {{sample_rate_hz: 13.0e+6}}}}", "13 million complex samples a second; the board's limit is"),
        (f"{{{AWR}, chirp: {{repetition_s: 49.0e-6}}}}", "leave 1.04 us between ramps of 47.96 us; the board needs 2"),
        (f"{{{AWR}, antenna: {{{WIDE_ROW}}}}}", "is ambiguous within the stated field of +-60 degrees"),
        (f"{{{AWR}, antenna: {{mimo: ddm, doppler_bands: 2}}}}", "doppler_bands 2 are fewer than 3 transmitters"),
        (f"{{{AWR}, antenna: {{doppler_bands: 4}}}}", "doppler_bands is for mimo: ddm, not tdm"),
        (f"{{{AWR}, antenna: {{tx_positions_m: [[0, 2, 0]]}}}}", "holds a transmitter more than 1 m away"),
        ("{preset: awr1843boost, rate_hz: 100}", "leaves 0.01 s for a frame that takes 0.011136 s"),
        ("{preset: awr2243boost, rate_hz: 70}", "880.8 Mbit/s of samples; the board's limit is 706 Mbit/s"),
        ("{preset: bgt60tr13, rate_hz: 10}", "did you mean 'bgt60tr13c'?"),
        ("{preset: ./mine.yaml, rate_hz: 10}", "names a file that does not exist: ./mine.yaml"),
    ],
)  # fmt: skip
def test_wrong_values_are_named_with_their_line(radar: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    told = bench_files.refused(file_of(radar))
    assert any(expected in text for text in told), told
    assert all(text.startswith("b.yaml:8:") for text in told)
    assert run_command_line(["check", "b.yaml"]) == 2
    assert expected.replace("\n", "") in capsys.readouterr().err.replace("\n", "")


def test_raw_data_alone_needs_no_map() -> None:
    few = load(f"{{{PRESET}, rate_hz: 10, chirp: {{chirps: 8}}, outputs: [raw]}}").config.sensors["radar"].parameters
    assert few.chirp.chirps == 8


def test_a_radar_that_names_a_camera_of_a_bench_without_cameras() -> None:
    Path("b.yaml").write_text(
        "\n".join(SENSORS.splitlines()[:-1]) + "\n  radar: {preset: bgt60tr13c, frame: a, rate_hz: 9}\n"
    )
    with pytest.raises(ConfigError, match="this bench has no camera: give the radar a view of its own"):
        load_bench("b.yaml")


def test_a_broken_camera_is_reported_once() -> None:
    radar = "{preset: bgt60tr13c, frame: rear, rate_hz: 10}"
    assert "resolution" in refused(radar, "  rear: {kind: camera, rate_hz: 10, fov_deg: 90}\n")


def test_a_users_preset_of_any_kind_is_found_beside_the_file_that_names_it(tmp_path: Path) -> None:
    folder = tmp_path / "benches"
    folder.mkdir()
    (folder / "mine.yaml").write_text((REPOSITORY / "sim/sensors/preset_files/bgt60tr13c.yaml").read_text())
    (folder / "ms.yaml").write_text((REPOSITORY / "sim/sensors/preset_files/ms5611.yaml").read_text())
    text = SENSORS.replace("preset: ms5611", "preset: ms.yaml")
    (folder / "b.yaml").write_text(f"{text}  radar: {{preset: ./mine.yaml, rate_hz: 10, chirp: {{chirps: 32}}}}\n")
    bench = load_bench(folder / "b.yaml")
    radar, baro = bench.config.sensors["radar"], bench.config.sensors["baro"]
    assert baro.parameters == PRESETS["ms5611"].parameters
    assert radar.parameters.antenna == PRESETS["bgt60tr13c"].parameters.antenna  # type: ignore[attr-defined]
    assert radar.parameters.chirp.chirps == 32
    # A saved run contains the values and needs the file no more.
    saved = save_bench(bench, tmp_path / "run")
    (folder / "mine.yaml").unlink()
    assert load_bench(saved).config.sensors == bench.config.sensors
    # On the command line the path is relative to the working directory.
    (tmp_path / "here.yaml").write_text((REPOSITORY / "sim/sensors/preset_files/ms5611.yaml").read_text())
    other = load_bench(saved.parent / "bench.yaml", settings=["sensors.baro.preset=here.yaml"])
    assert other.config.sensors["baro"].parameters == PRESETS["ms5611"].parameters


def test_a_mistake_in_a_users_preset_has_the_line_of_that_file(tmp_path: Path) -> None:
    head = 'kind: radar\npart: "x"\nsources: {}\n'
    (tmp_path / "mine.yaml").write_text(f"{head}parameters:\n  chirp: {{value: 1, status: typical, nte: x}}\n")
    message = refused("{preset: ./mine.yaml, rate_hz: 10}")
    assert message == "mine.yaml:5: parameters.chirp.nte: unknown key (did you mean 'note'?)"
    (tmp_path / "mine.yaml").write_text(f"{head}parameters: {{}}\n")
    with pytest.raises(ConfigError, match=r"mine.yaml:4: parameters.chirp is missing"):
        load("{preset: ./mine.yaml, rate_hz: 10}")
    assert "is 'camera', but the preset" in refused(f"{{preset: {'bgt60tr13c'}, kind: camera, rate_hz: 10}}")


def test_recorded_frames_too_short_for_the_map_are_refused() -> None:
    p = settings_of(None, preset=None, default_preset="bgt60tr13c", texts=())
    few = Chirp.model_validate(p.chirp.model_dump() | {"chirps": 8})
    with pytest.raises(ConfigError, match=r"r.npz: its frames do not suit processing.cfar: .* the 8 Doppler rows"):
        with_chirp(p, few, 3, "r.npz")


@pytest.mark.parametrize("name", ["radar_away", "radar_towards"])
def test_the_radar_scenes_can_be_flown(name: str) -> None:
    bench = load_bench(REPOSITORY / "rigs" / "benches" / f"{name}.yaml")
    assert bench.script is not None
    assert bench.config.sensors["radar"].rate_hz == 20.0
    assert bench.scene.name == f"radar_walk_{name.removeprefix('radar_')}"
