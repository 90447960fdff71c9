"""The folder of a run: one writer at a time, and no link is followed out of it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

import pytest

from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.report.run_folder import remove_earlier, run_folder, write_unbegun
from signals.errors import ConfigError, RecordingError

SHORT = ("duration_s=0.1", "record.report=false", "autopilot.transport=loopback", "mission=null")


def test_a_second_run_into_one_folder_is_an_error_and_changes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with run_folder(tmp_path):
        with pytest.raises(RecordingError, match="another run is writing here"):
            run_bench(load_bench(None, settings=SHORT), tmp_path, quiet=True)
        assert run_command_line(["run", "-q", "--out", str(tmp_path)]) == 3
        assert run_command_line(["run", "-q", "--out", str(tmp_path), "--rig", "nonsense"]) == 2
        assert "another run is writing here" in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []
    assert run_bench(load_bench(None, settings=SHORT), tmp_path, quiet=True).run["error"] is None


@pytest.mark.parametrize("link", [os.symlink, pytest.param(os.link, marks=pytest.mark.slow)])
def test_links_in_the_folder_are_replaced(link: object, tmp_path: Path) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    out.mkdir()
    victim.write_text("mine")
    names = ["report.html", "run.mcap", "run.json", "autopilot.log", "bench.yaml", "bench.part", "flight.tlog"]
    for name in names:
        link(victim, out / name)  # type: ignore[operator]
    (out / "notes").symlink_to(victim)
    settings = ("duration_s=0.1", "record.report=true", "mission=null")
    assert run_bench(load_bench(None, settings=settings), out, quiet=True).run["error"] is None
    assert victim.read_text() == "mine"
    assert (out / "notes").is_symlink()
    assert not any((out / name).is_symlink() for name in names)
    assert (out / "report.html").stat().st_size > 1000


def test_a_link_in_place_of_a_folder_of_the_run_is_replaced(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    (out / "calibration").symlink_to(elsewhere)
    (out / "scene_map").mkdir()
    (out / "scene_map" / "map.xml").symlink_to(elsewhere / "map.xml")
    with run_folder(out):
        assert not (out / "calibration").exists()
        assert list((out / "scene_map").iterdir()) == []


def test_folders_of_vehicles_are_locked_and_links_in_their_place_removed(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    (out / "a").symlink_to(elsewhere)
    with run_folder(out, ("a", "b")):
        assert not (out / "a").is_symlink()
        with pytest.raises(RecordingError, match=r"out/b: another run is writing here"), run_folder(out / "b"):
            pass
    (out / "c").write_text("mine")
    with pytest.raises(RecordingError, match=r"out/c: cannot be used as a folder for results"), run_folder(out, ("c",)):
        pass
    assert (out / "c").read_text() == "mine"


def test_results_of_vehicles_of_an_earlier_run_are_removed(tmp_path: Path) -> None:
    earlier = {"vehicles": {name: {} for name in ("a", "b", "../c")}}
    out = tmp_path / "out"
    for folder in (out, out / "a", out / "b", out / "mine", tmp_path / "c"):
        folder.mkdir()
        (folder / "run.json").write_text(json.dumps(earlier))
    with run_folder(out):  # as after an error in a bench file
        assert (out / "b" / "run.json").exists()
    with run_folder(out, ("a",)):
        pass
    assert not (out / "b" / "run.json").exists()
    assert all((folder / "run.json").exists() for folder in (out, out / "a", out / "mine", tmp_path / "c"))


def test_what_belongs_to_no_earlier_run_or_is_read_is_not_removed(tmp_path: Path) -> None:
    names = {"report.html", "run.mcap", "flight.tlog", "companion.jsonl", "people.json"}

    def left(folder: Path, *beside: str, kept: Iterable[str] = ()) -> set[str]:
        for place in (folder, folder / "a"):
            place.mkdir(parents=True)
            for name in names:
                (place / name).write_text("mine")
        for name in beside:
            (folder / name).write_text("{}")
        remove_earlier(folder, ("a",), kept)
        return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.name in names}

    both = {str(Path(place, name)) for place in ("", "a") for name in names}
    assert left(tmp_path / "of_the_user") == both
    assert left(tmp_path / "data_set", "run.json", "dataset.json") == both
    assert left(tmp_path / "run", "run.json") == set()
    assert left(tmp_path / "log", "run.json", kept=[str(tmp_path / "log" / "a" / "run.mcap")]) == {"a/run.mcap"}
    trace = tmp_path / "trace" / "companion.jsonl"
    assert left(trace.parent, "run.json", kept=[str(trace)]) == {trace.name}
    assert left(tmp_path / "folder", "run.json", kept=[str(tmp_path / "folder")]) == names


def test_what_a_link_of_an_earlier_run_leads_to_is_not_removed(tmp_path: Path) -> None:
    out, log = tmp_path / "out", tmp_path / "mine.mcap"
    out.mkdir()
    log.write_text("mine")
    (out / "run.json").write_text("{}")
    (out / "run.mcap").symlink_to(log)
    remove_earlier(out, (), ())
    assert not (out / "run.mcap").is_symlink()
    assert log.read_text() == "mine"


def test_pictures_and_output_of_an_earlier_runs_clients_are_removed(tmp_path: Path) -> None:
    """The report showed the pictures as those of this run's clients."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    for folder in (out / "companion_a", out / "v" / "companion_b", elsewhere):
        folder.mkdir(parents=True)
        for name in ("report.png", "report_map.png", "model.onnx"):
            (folder / name).write_text("mine")
    (out / "companion_c").symlink_to(elsewhere)
    for name in ("run.json", "companion_a.log", "v/companion_b.log", "companion.txt"):
        (out / name).write_text("{}")
    (tmp_path / "latest").symlink_to(out)
    remove_earlier(tmp_path / "latest", ("v",), [str(out / "companion_a" / "report_map.png")])
    left = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file() and path.name != "run.json"}
    kept = {"companion_a/model.onnx", "companion_a/report_map.png", "v/companion_b/model.onnx", "companion.txt"}
    assert left == kept
    assert (elsewhere / "report.png").exists()


def test_a_run_that_never_began_leaves_no_report_of_an_earlier_one(tmp_path: Path) -> None:
    for name in ("run.json", "report.html", "run.mcap"):
        (tmp_path / name).write_text("{}")
    write_unbegun(ConfigError.at("x", "is wrong"), tmp_path, rig=None, scene=None, seed=None)
    assert {path.name for path in tmp_path.iterdir()} == {"run.json", "run.mcap"}
