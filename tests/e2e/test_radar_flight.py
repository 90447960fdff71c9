"""A radar in a run, and `hil radar` on its recording: the same bytes live, replayed and offline."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import hil.apps.radar.results
from hil.apps.radar.sources import open_source, pictures_at
from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import read_messages
from hil.run.recorder.reading_frames import radar_frame
from hil.run.replay import replay
from hil.run_files import MCAP_NAME
from sim.scene.maps.walk_path import there_and_back

# The vehicle stays on the ground; a mast carries camera and radar 1.8 m up. The person walks away from 1 m on.
BENCH = """scene: radar_range
duration_s: 2
autopilot: {transport: loopback}
record: {tlog: false, report: REPORT}
sensors:
  radar: {preset: bgt60tr13c, frame: front, rate_hz: 20}
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  front:
    kind: camera
    resolution: [160, 120]
    fov_deg: 90
    rate_hz: 20
    mount_m: [0, 0, 1.57]
    channels: [rgb, range, normal, material, radial_velocity]
"""
OWN_VIEW = (
    "{preset: bgt60tr13c, rate_hz: 20, resolution: [160, 120], fov_deg: 90, mount_m: [0, 0, 1.57], outputs: [raw]}"
)
FRAMES = 40


def fly(folder: Path, text: str) -> dict[str, Any]:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "b.yaml").write_text(text)
    run = run_bench(load_bench(folder / "b.yaml"), folder / "run", quiet=True).run
    assert run["error"] is None, run["error"]
    return run


def raw_of(run: Path) -> NDArray[np.uint16]:
    return np.array([radar_frame(m).raw for m in read_messages(run / MCAP_NAME) if m.topic == "/radar/raw"])


@pytest.fixture(autouse=True)
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hil.apps.radar.results, "PICTURES", 2)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a run with all radar outputs on."""
    folder = tmp_path_factory.mktemp("flown")
    return folder / "run", fly(folder, BENCH.replace("REPORT", "true"))


@pytest.fixture(scope="module")
def processed(flown: tuple[Path, dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the output of `hil radar` for that run."""
    folder = tmp_path_factory.mktemp("processed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hil.apps.radar.results, "PICTURES", 2)
        assert run_command_line(["radar", str(flown[0]), "--out", str(folder)]) == 0
    return folder


def test_run_json_reports_the_radar(flown: tuple[Path, dict[str, Any]]) -> None:
    out, run = flown
    assert run["deterministic"]
    assert run["sensors"]["radar"]["samples"] == FRAMES
    assert run["sensors"]["radar"]["radar"]["shared_pictures"] == FRAMES
    told = {(row["what"], row["why"]): row["saved"] for row in run["skipped"]}
    assert (
        told["radar: pictures", "read from the picture that its camera has just rendered"]
        == f"{FRAMES} of {FRAMES} pictures"
    )
    assert told["radar: pixels", "sky"].endswith(f"of {FRAMES * 160 * 120} pixels")
    assert (out / "frame_radar.png").read_bytes().startswith(b"\x89PNG")
    assert "Frame of radar with the most points or tracks" in (out / "report.html").read_text()
    assert not (out / "calibration" / "radar.camera_info.yaml").exists()
    # A frame is complete half a frame after its middle and delivered at the next tick.
    for message in read_messages(out / MCAP_NAME):
        if message.topic == "/radar/raw":
            late_ns = message.publish_time_ns - radar_frame(message).t_capture_ns
            assert late_ns == round(0.5 * 64 * 390.975e-6 * 1e9)
            assert 0 <= message.log_time_ns - message.publish_time_ns < 4_000_000


def test_offline_processing_repeats_the_live_result(flown: tuple[Path, dict[str, Any]], processed: Path) -> None:
    out, _ = flown
    found = np.load(processed / "radar.npz")
    for name in ("points", "tracks"):
        live = [bytes(m.decode()["data"]) for m in read_messages(out / MCAP_NAME) if m.topic == f"/radar/{name}"]
        assert b"".join(live) == found[name].tobytes()
        assert [len(data) // found[name].dtype.itemsize for data in live] == found[f"{name}_per_frame"].tolist()
    rows = list(csv.DictReader((processed / "points.csv").open()))
    assert len(rows) == len(found["points"]) > FRAMES
    assert {"frame", "t_s", "range_m", "speed_mps", "snr_db"} <= set(rows[0])
    summary = json.loads((processed / "summary.json").read_text())
    assert summary["frames"] == FRAMES
    assert summary["max_speed_mps"] == pytest.approx(3.15, abs=0.01)
    assert found["speed_time"].shape == (FRAMES, 64)
    pictures = sorted(path.name for path in processed.glob("*.png"))
    assert pictures[-1] == "summary.png"
    assert pictures[:2] == ["micro_doppler.png", "range_doppler_00000.png"]
    assert len(pictures) == 4
    assert summary["source"] == "run: raw frames of 'radar'"


def test_a_time_span_is_processed_with_other_settings(
    flown: tuple[Path, dict[str, Any]], processed: Path, tmp_path: Path
) -> None:
    out, _ = flown
    options = ["--from", "0.5", "--until", "0.96", "--set", "processing.clutter=none"]
    assert run_command_line(["radar", str(out), "--out", str(tmp_path), "--quiet", *options]) == 0
    found = np.load(tmp_path / "radar.npz")
    assert not np.array_equal(found["range_time"], np.load(processed / "radar.npz")["range_time"][10:20])
    assert np.round(found["t_ns"] * 1e-9, 2).tolist() == [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95]
    assert len(list(tmp_path.glob("range_doppler_*.png"))) == 2
    # Camera pictures of the same instants stand beside the maps.
    wanted = found["t_ns"][[0, -1]].tolist()
    seen = pictures_at(open_source(out, preset=None, texts=()), {*wanted, 1})
    assert list(seen) == wanted
    assert seen[wanted[0]].shape == (120, 160, 3)
    assert not np.array_equal(*seen.values())


def test_the_person_is_tracked(processed: Path) -> None:
    found = np.load(processed / "radar.npz")
    ends = np.cumsum(found["tracks_per_frame"])
    path = there_and_back((1.0, 0.0), (7.0, 0.0), 1.2, lane_m=0.5)
    seen, range_errors, frames = 0, [], 0
    for k, t_ns in enumerate(found["t_ns"].tolist()):
        if t_ns < 300_000_000:  # a track is confirmed after some frames
            continue
        frames += 1
        tracks = found["tracks"][ends[k] - found["tracks_per_frame"][k] : ends[k]]
        x, y = path.place(path.progress(t_ns)[1])[:2]
        range_m = np.hypot(np.hypot(x, y), 0.6)  # the chest, 1.2 m up
        errors = np.abs(tracks["range_m"] - range_m)
        if len(errors) and errors.min() < 0.5:
            seen += 1
            range_errors.append(errors.min())
    assert seen >= 0.95 * frames
    assert np.median(range_errors) < 0.2


def test_frames_do_not_depend_on_other_outputs(flown: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    out, run = flown
    expected = raw_of(out)
    assert len(expected) == FRAMES
    lines = BENCH.replace("REPORT", "false").splitlines(keepends=True)
    alone = [*[line for line in lines if "radar: " not in line][:-6], f"  radar: {OWN_VIEW}\n"]
    fly(tmp_path / "alone", "".join(alone))
    assert np.array_equal(raw_of(tmp_path / "alone" / "run"), expected)
    again = replay(
        out, lambda config, folder: run_bench(load_bench(config), folder, quiet=True), out_dir=tmp_path / "again"
    )
    assert again.identical, again
    assert again.digests == (run["digest"], run["digest"])


def test_recorded_pictures_give_the_frames_of_a_live_radar(
    flown: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, _ = flown
    monkeypatch.setattr(hil.apps.radar.results.Results, "_write_pictures", lambda *_: [])
    pictures = BENCH.replace("REPORT", "false").replace("rate_hz: 20}\n", "rate_hz: 20, outputs: [points]}\n")
    fly(tmp_path / "seen", pictures)
    assert run_command_line(["radar", str(tmp_path / "seen" / "run"), "--out", str(tmp_path / "made")]) == 0
    made = np.load(tmp_path / "made" / "raw.npz")["adc"]
    assert np.array_equal(made, raw_of(out))
    # Its output is a recording like a real sensor's.
    recording = str(tmp_path / "made" / "raw.npz")
    assert run_command_line(["radar", recording, "--preset", "bgt60tr13c", "--out", str(tmp_path / "twice")]) == 0
    first, second = np.load(tmp_path / "made" / "radar.npz"), np.load(tmp_path / "twice" / "radar.npz")
    assert first["points"].tobytes() == second["points"].tobytes()


def test_runs_that_cannot_be_processed_are_refused(
    flown: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, _ = flown
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("no recording")
    np.savez(tmp_path / "alone.npz", adc=np.zeros((2, 3, 64, 64), np.uint16))
    run = str(out)
    for arguments, expected in (
        (["nowhere"], "does not exist"),
        ([str(tmp_path / "empty")], "holds no run.mcap"),
        ([str(tmp_path / "text.mcap")], "not an MCAP recording"),
        ([str(tmp_path / "alone.npz")], "alone.json"),
        ([run, "--preset", "bgt60"], "did you mean 'bgt60tr13c'?"),
        ([run, "--preset", "ms5611"], "is a barometer, not a radar"),
        ([run, "--set", "processing.cfar.kid=ca"], "unknown key"),
        ([run, "--set", "processing"], "has no value"),
        ([run, "--from", "5"], "the frames are from 0.000 to 1.9"),
        ([run, "--set", "antenna.rx_positions_m=[[0,0,0]]"], "receivers"),
    ):
        assert run_command_line(["radar", *arguments, "--out", str(tmp_path / "out")]) == 2
        assert expected in capsys.readouterr().err.replace("\n", " ")
